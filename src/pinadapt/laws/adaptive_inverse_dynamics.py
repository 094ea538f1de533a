"""Adaptive inverse dynamics, the main law of Wang and Xie (2009)."""

from __future__ import annotations

from ..adaptation.adaptation import Drives
from ..signals import Signals
from .acceleration_law import EstimatedVelocityLaw
from .law import Command, EstimatedModel


class AdaptiveInverseDynamics(EstimatedVelocityLaw):
    """Adaptive inverse dynamics without task velocity: Wang and Xie (2009), theorem 1.

    Law:          tau = M_hat v + C_hat qd + g_hat (11), v = J_hat^+ (xdd_d - K_v dxd_hat - K_P dx -
                  dJ_hat/dt qd).
    Adaptation:   da_d/dt = -Gamma_d Phi^T e, Phi = J_hat M_hat^-1 Y(q, qd, qdd) (18); da_k/dt by
                  (19).
    Closed loop:  de/dt = -(K_v - alpha I) dxd_hat - K_P dx + Phi da_d - alpha Y_k da_k (17).
    V:            e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2 + D_d(a_d) + D_k(a_k),
                  dV/dt = -dxd_hat^T (K_v - alpha I) dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k
                  W_k da_k.
    Assumptions:  constant parameters; J_hat of full row rank; M_hat invertible, which natural
                  adaptation guarantees and plain gradient adaptation does not; joint acceleration
                  known; K_v - alpha I > 0.
    """

    name = "adaptive-inverse-dynamics"
    sources = ("WangXie2009",)
    inverts_estimate = True

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return tau, (11), with the drives of both estimates, (18) and (19)."""
        e, kinematic = self.errors(s)
        a_k_rate = model.adaptation_k.rate(model.kinematic, kinematic).value
        v = self.commanded_acceleration(s, a_k_rate)
        # tau = M_hat v + C_hat qd + g_hat (11)
        torque = model.dynamics.torque(s.q, s.v, v)
        # g_d = Phi^T e, Phi = J_hat M_hat^-1 Y(q, qd, qdd) (18)
        M_hat, Y = model.dynamics.mass_matrix(s.q), model.dynamics.regressor(s.q, s.v, s.a)
        dynamic = model.acceleration_drive(M_hat, s.J, e, Y)
        return Command(torque, Drives(dynamic, kinematic))
