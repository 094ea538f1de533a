"""Adaptive inverse dynamics that never inverts an estimate that moves."""

from __future__ import annotations

import numpy as np

from .estimated_velocity import EstimatedVelocityLaw
from .inertia import solve_inertia
from .law import Command, Gradients, Signals


class AdaptiveInverseDynamicsImproved(EstimatedVelocityLaw):
    """Improved adaptive inverse dynamics: Wang and Xie (2009), section 4, after Spong and Ortega (1990).

    Law:          tau = M_0 v + C_hat qd + g_hat + delta (32), delta = (M_hat - M_0) qdd (34),
                  M_0(q) from the initial estimate.
    Adaptation:   da_d/dt = -Gamma_d Phi_1^T e, Phi_1 = J_hat M_0^-1 Y(q, qd, qdd) (36); da_k/dt by
                  (37) = (19).
    Closed loop:  de/dt = -(K_v - alpha I) dxd_hat - K_P dx + Phi_1 da_d.
    V:            that of adaptive inverse dynamics, and the same dV/dt.
    Assumptions:  constant parameters; J_hat of full row rank; joint acceleration known and fed
                  back, so M + M_0 - M_hat
                  must stay invertible (a filtered acceleration breaks that algebraic loop); K_v -
                  alpha I > 0.
    """

    name = "adaptive-inverse-dynamics-improved"

    def command(self, s: Signals) -> Command:
        """Return M_0 v + C_hat qd + g_hat, (32), with feedthrough M_hat - M_0, (34)."""
        g_k = self.kinematic_gradient(s)
        v = self.commanded_acceleration(s, g_k)
        s.dynamics.load(s.a_0)
        M_0 = s.dynamics.mass_matrix(s.q)
        s.dynamics.load(s.a_d)
        bias = s.dynamics.torque(s.q, s.v, np.zeros(s.v.size))  # C_hat qd + g_hat
        delta = s.dynamics.mass_matrix(s.q) - M_0  # (34)
        return Command(M_0.dot(v) + bias, delta, memo=(g_k, M_0))  # (32)

    def gradients(self, s: Signals, command: Command, a: np.ndarray) -> Gradients:
        """Return g_d = Phi_1^T e, (36), and g_k, (37)."""
        g_k, M_0 = command.memo
        force = solve_inertia(M_0, self.error_force(s), s.watch)  # M_0^-1 J_hat^T e
        return Gradients(force.dot(s.dynamics.regressor(s.q, s.v, a)), g_k)  # (36), (37)
