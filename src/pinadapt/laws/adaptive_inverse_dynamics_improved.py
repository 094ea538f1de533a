"""Adaptive inverse dynamics that never inverts a moving estimate; Spong and Ortega's law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..adaptation.adaptation import Drives
from ..signals import Signals
from .acceleration_law import EstimatedVelocityLaw
from .law import Command, EstimatedModel


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
    holds_inertia = True
    sources: ClassVar[tuple[str, ...]] = ("WangXie2009", "SpongOrtega1990")

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return tau, (32) with (34), and the drives of both estimates, (36) and (37)."""
        (e, kinematic), dynamics = self.errors(s), model.dynamics
        a_k_rate = model.adaptation_k.rate(model.kinematic, kinematic).value
        v = self.commanded_acceleration(s, a_k_rate)
        dynamics.load(s.a_0)
        M_0 = dynamics.mass_matrix(s.q)
        dynamics.load(s.a_d)
        # tau = M_0 v + C_hat qd + g_hat (32) + (M_hat - M_0) qdd (34)
        torque = M_0.dot(v) + dynamics.torque(s.q, s.v, np.zeros(s.v.size))
        feedthrough = dynamics.mass_matrix(s.q) - M_0
        # g_d = Phi_1^T e, Phi_1 = J_hat M_0^-1 Y(q, qd, qdd) (36)
        dynamic = model.acceleration_drive(M_0, s.J, e, dynamics.regressor(s.q, s.v, s.a))
        return Command(torque, Drives(dynamic, kinematic), feedthrough)


@dataclass(frozen=True, eq=False)
class SpongOrtega(AdaptiveInverseDynamicsImproved):
    """Adaptive inverse dynamics of rigid robots: M. Spong, R. Ortega, IEEE TAC 35 (1990) 92-95.

    The improved adaptive inverse dynamics on a joint task, x = q and J = I. B^T P xi is here
    ed + alpha e, as the Lyapunov equation gives for Q = diag(2 alpha K_P, 2 (K_v - alpha I)).

    Law:          tau = M_0 (qdd_d - K_v ed - K_P e) + C_hat qd + g_hat + (M_hat - M_0) qdd, M_0(q)
                  from the initial estimate, e = q - q_d on the manifold.
    Adaptation:   da_d/dt = -Gamma_d (M_0^-1 Y)^T (ed + alpha e).
    Closed loop:  edd + K_v ed + K_P e = M_0^-1 Y da_d.
    V:            |ed + alpha e|^2 / 2 + e^T (K_P + alpha K_v - alpha^2 I) e / 2 + D_d(a_d),
                  dV/dt = -ed^T (K_v - alpha I) ed - alpha e^T K_P e.
    Assumptions:  constant parameters; kinematics known; joint acceleration known and fed back, so
                  M + M_0 - M_hat must stay invertible; K_v - alpha I > 0.
    """

    posture: Any = None

    name = "spong-ortega"
    sources = ("SpongOrtega1990",)
    joint_space = True
    units = ("1/s", "1/s^2")
