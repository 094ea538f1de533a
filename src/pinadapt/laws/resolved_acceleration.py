"""Resolved acceleration control, the law for a known robot."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..adaptation.adaptation import Drive, Drives
from ..signals import Signals
from .estimated_velocity import EstimatedVelocityLaw
from .law import Believed, Command


class ResolvedAcceleration(EstimatedVelocityLaw):
    """Resolved acceleration: J. Luh, M. Walker, R. Paul, IEEE TAC 25 (1980) 468-474.

    Wang and Xie (2009), equation (8).

    Law:          tau = M v + C qd + g, v = J^+ (xdd_d - K_v dxd - K_P dx - dJ/dt qd), true
                  parameters.
    Adaptation:   none.
    Closed loop:  dxdd + K_v dxd + K_P dx = 0 (10).
    V:            e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2, with dV/dt as in
                  ``EstimatedVelocityLaw``.
    Assumptions:  J and M known exactly; J of full row rank. With wrong estimates it is the
                  unadapted baseline.
    """

    name = "resolved-acceleration"
    sources: ClassVar[tuple[str, ...]] = ("LuhWalkerPaul1980",)
    adapts = False
    needs_acceleration = False

    def command(self, s: Signals, believed: Believed) -> Command:
        """Return M v + C qd + g, (8)."""
        v = self.commanded_acceleration(s, np.zeros(s.a_k.size))
        return Command(believed.dynamics.torque(s.q, s.v, v))  # (8)

    def drives(self, s: Signals, believed: Believed, command: Command, a: np.ndarray) -> Drives:
        """Return drives without any part: nothing adapts."""
        return Drives(Drive(np.zeros((0, s.a_d.size)), None), Drive(s.Y_k, None))
