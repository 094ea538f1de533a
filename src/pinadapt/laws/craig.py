"""The adaptive computed torque of Craig, Hsu and Sastry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .adaptive_inverse_dynamics_velocity import AdaptiveInverseDynamicsVelocity


@dataclass(frozen=True, eq=False)
class Craig(AdaptiveInverseDynamicsVelocity):
    """Adaptive computed torque.

    J. Craig, P. Hsu, S. Sastry, *Adaptive control of mechanical manipulators*, IJRR 6(2) (1987)
    16-28.

    Adaptive inverse dynamics with task velocity on a joint task, x = q and J = I; its velocity is
    the measured one of the joints.

    Law:          tau = M_hat (qdd_d - K_v ed - K_P e) + C_hat qd + g_hat, e = q - q_d on the
                  manifold.
    Adaptation:   da_d/dt = -Gamma_d (M_hat^-1 Y)^T B^T P xi, xi = (e, ed), A^T P + P A = -Q.
    Closed loop:  dxi/dt = A xi + B M_hat^-1 Y da_d.
    V:            xi^T P xi / 2 + D_d(a_d), dV/dt = -xi^T Q xi / 2.
    Assumptions:  constant parameters; kinematics known; M_hat invertible, which natural adaptation
                  guarantees; joint acceleration known.
    """

    posture: Any = None

    name = "craig"
    sources = ("CraigHsuSastry1987",)
    joint_space = True
    units = ("1/s", "1/s^2")
