"""The adaptive inverse dynamics of Spong and Ortega, which inverts no estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .adaptive_inverse_dynamics_improved import AdaptiveInverseDynamicsImproved


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
