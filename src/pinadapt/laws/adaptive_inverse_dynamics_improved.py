"""Adaptive inverse dynamics that never inverts an estimate that moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..adaptation.adaptation import Drive, Drives
from ..signals import Signals
from .estimated_velocity import AccelerationCommand, EstimatedVelocityLaw
from .inertia import solve_inertia
from .law import Believed


@dataclass(slots=True, eq=False)
class ImprovedCommand(AccelerationCommand):
    """A command with what it took.

    Attributes:
        M_0: (n, n) mass matrix at the initial estimate.
    """

    M_0: np.ndarray = None  # type: ignore[assignment]  # always given


class AdaptiveInverseDynamicsImproved(EstimatedVelocityLaw):
    """Improved adaptive inverse dynamics: Wang and Xie (2009), section 4.

    After Spong and Ortega (1990).

    Law:          tau = M_0 v + C_hat qd + g_hat + delta (32), delta = (M_hat - M_0) qdd (34),
                  M_0(q) from the initial estimate.
    Adaptation:   da_d/dt = -Gamma_d Phi_1^T e, Phi_1 = J_hat M_0^-1 Y(q, qd, qdd) (36); da_k/dt by
                  (37) = (19).
    Closed loop:  de/dt = -(K_v - alpha I) dxd_hat - K_P dx + Phi_1 da_d - alpha Y_k da_k.
    V:            that of adaptive inverse dynamics, and the same dV/dt.
    Assumptions:  constant parameters; J_hat of full row rank; joint acceleration known and fed
                  back, so M + M_0 - M_hat
                  must stay invertible (a filtered acceleration breaks that algebraic loop); K_v -
                  alpha I > 0.
    """

    name = "adaptive-inverse-dynamics-improved"
    sources: ClassVar[tuple[str, ...]] = ("WangXie2009", "SpongOrtega1990")

    def command(self, s: Signals, believed: Believed) -> ImprovedCommand:
        """Return M_0 v + C_hat qd + g_hat, (32), with feedthrough M_hat - M_0, (34)."""
        (e, kinematic), dynamics = self.errors(s), believed.dynamics
        v = self.commanded_acceleration(s, believed.kinematic_rate(s, kinematic))
        dynamics.load(s.a_0)
        M_0 = dynamics.mass_matrix(s.q)
        dynamics.load(s.a_d)
        bias = dynamics.torque(s.q, s.v, np.zeros(s.v.size))  # C_hat qd + g_hat
        delta = dynamics.mass_matrix(s.q) - M_0  # (34)
        return ImprovedCommand(M_0.dot(v) + bias, delta, kinematic, e, M_0)  # (32)

    def drives(
        self, s: Signals, believed: Believed, command: ImprovedCommand, a: np.ndarray
    ) -> Drives:
        """Return g_d = Phi_1^T e = Y^T M_0^-1 J_hat^T e, (36), and g_k, (37)."""
        error = solve_inertia(command.M_0, s.J, command.e, believed.watch)  # M_0^-1 J_hat^T e
        Y = believed.dynamics.regressor(s.q, s.v, a)
        return Drives(Drive(Y, error), command.kinematic)  # (36), (37)
