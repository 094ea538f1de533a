"""The laws for a known robot: resolved acceleration, and computed torque in joint space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..adaptation.adaptation import Drives
from ..signals import Signals
from .acceleration_law import EstimatedVelocityLaw
from .law import Command, EstimatedModel


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
    uses_acceleration = False

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return M v + C qd + g, (8); nothing drives the estimates."""
        v = self.commanded_acceleration_unchecked(s, np.zeros(s.a_k.size))
        return Command(
            model.dynamics.torque_unchecked(s.q, s.v, v), Drives.none(s.a_d.size, s.a_k.size)
        )  # (8)


@dataclass(frozen=True, eq=False)
class ComputedTorque(ResolvedAcceleration):
    """Computed torque: B. Markiewicz, JPL Technical Memorandum 33-601 (1973); J. Luh et al. (1980).

    Resolved acceleration on a joint task, x = q and J = I.

    Law:          tau = M (qdd_d - K_v ed - K_P e) + C qd + g, true parameters, e = q - q_d on the
                  manifold.
    Adaptation:   none.
    Closed loop:  edd + K_v ed + K_P e = 0.
    V:            |ed + alpha e|^2 / 2 + e^T (K_P + alpha K_v - alpha^2 I) e / 2,
                  dV/dt = -ed^T (K_v - alpha I) ed - alpha e^T K_P e.
    Assumptions:  M, C and g known exactly. With wrong estimates it is the unadapted baseline.
    """

    posture: Any = None

    name = "computed-torque"
    sources = ("Markiewicz1973", "LuhWalkerPaul1980")
    joint_space = True
    units = ("1/s", "1/s^2")
