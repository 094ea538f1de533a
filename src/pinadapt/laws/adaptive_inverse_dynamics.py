"""Adaptive inverse dynamics: the laws of Wang and Xie (2009), and their joint-space relatives.

Without task velocity (theorem 1), with it (theorem 2; on a joint task the law of Craig, Hsu and
Sastry), and the improved one, which never inverts a moving estimate (section 4; on a joint task the
law of Spong and Ortega).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..adaptation.adaptation import Drive, Drives
from ..models.typical_motion import TypicalMotion
from ..signals import Signals
from .acceleration_law import AccelerationLaw, EstimatedVelocityLaw
from .law import Command, EstimatedModel, Truth, check_margin, task_gain


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
        e, kinematic = self._errors(s, self.alpha)
        a_k_rate = model.adaptation_k.value_rate(model.kinematic, kinematic)
        v = self._commanded_acceleration(s, s.xd_hat, self.alpha, a_k_rate)
        # tau = M_hat v + C_hat qd + g_hat (11)
        torque = model.dynamics.torque(s.q, s.v, v)
        # g_d = Phi^T e, Phi = J_hat M_hat^-1 Y(q, qd, qdd) (18)
        M_hat = model.dynamics.mass_matrix(s.q)
        Y = model.dynamics.regressor(s.q, s.v, s.a)
        dynamic = model.acceleration_drive(M_hat, s.J, e, Y)
        return Command(torque, Drives(dynamic, kinematic))


@dataclass(frozen=True, eq=False)
class AdaptiveInverseDynamicsVelocity(AccelerationLaw):
    """Adaptive inverse dynamics with task velocity: Wang and Xie (2009), theorem 2.

    Law:          tau = M_hat J_hat^+ (xdd_d - K_v dxd - K_P dx - dJ_hat/dt qd) + C_hat qd + g_hat
                  (25), dJ_hat/dt at constant
                  estimate: the motion's part alone, which is what makes (26) hold.
    Adaptation:   da_d/dt = -Gamma_d Phi^T B^T P xi (29), xi = (dx, dxd), A^T P + P A = -Q (31);
                  da_k/dt = Gamma_k (Ybar_k^T B^T P xi - Y_k^T R_k (Y_k a_k - xd)) (30), Ybar_k of
                  (27).
    Closed loop:  dxi/dt = A xi + B (Phi da_d - Ybar_k da_k) (26).
    V:            xi^T P xi / 2 + D_d(a_d) + D_k(a_k), dV/dt = -xi^T Q xi / 2 - da_k^T Y_k^T R_k Y_k
                  da_k.
    Pose:         dxi/dt gains (delta, 0), delta = d(dx)/dt - (xd - xd_d); -P_22^-1 P_12^T delta
                  joins xdd_d and takes it out
                  of dV/dt, as dx^T P_11 delta = 0 and the rotation blocks of P are numbers; see
                  ``PoseTask``.
    Gains:        those of the other laws; Q (2 m, 2 m) defaults to
                  diag(2 alpha K_P, 2 (K_v - alpha I)), for which B^T P xi = dxd + alpha dx, the
                  error e of the other laws.
    Assumptions:  constant parameters; J_hat of full row rank; M_hat invertible; task velocity and
                  joint acceleration known.
    """

    Q: Any = field(default=None, kw_only=True)

    name = "adaptive-inverse-dynamics-velocity"
    sources = ("WangXie2009",)
    inverts_estimate = True
    needs_task_velocity = True

    def _check(self) -> None:
        Q = self.Q
        if Q is None:
            from scipy.linalg import block_diag  # slow to import

            check_margin(self.K_v, self.alpha)
            velocity = self.K_v - self.alpha * np.eye(self.task.size)
            Q = 2.0 * block_diag(self.alpha * self.K_P, velocity)
        object.__setattr__(self, "Q", task_gain(Q, self.task, "Q", copies=2))

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, as the class states them."""
        return {**super().default_gains(motion, dt, w), "Q": None}

    @cached_property
    def P(self) -> np.ndarray:
        """P (2 m, 2 m), A^T P + P A = -Q (31)."""
        from scipy.linalg import solve_continuous_lyapunov  # slow to import

        m = self.task.size
        A = np.block([[np.zeros((m, m)), np.eye(m)], [-self.K_P, -self.K_v]])
        return solve_continuous_lyapunov(A.T, -self.Q)  # (31)

    @cached_property
    def _turning(self) -> np.ndarray:
        m = self.task.size
        return np.linalg.solve(self.P[m:, m:], self.P[m:, :m])  # P_22^-1 P_12^T

    def _xi(self, s: Signals) -> np.ndarray:
        return np.concatenate([s.dx, s.xd - s.xd_d])

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return tau, (25), with the drives of both estimates, (29) and (30)."""
        dynamics = model.dynamics
        m_p = self.task.positions
        v = self._commanded_acceleration(s, s.xd, self._turning, np.zeros(s.a_k.size))
        # tau = M_hat v + C_hat qd + g_hat (25)
        torque = dynamics.torque(s.q, s.v, v)
        # g_d = Phi^T B^T P xi, Phi = J_hat M_hat^-1 Y(q, qd, qdd) (29), B = (0, I)
        z = self.P[s.dx.size :].dot(self._xi(s))
        M_hat = dynamics.mass_matrix(s.q)
        dynamic = model.acceleration_drive(M_hat, s.J, z, dynamics.regressor(s.q, s.v, s.a))
        # g_k = -Ybar_k^T B^T P xi + Y_k^T R_k (Y_k a_k - xd) (30), Ybar_k of (27)
        Y_bar = model.kinematics.acceleration_regressor(s.a)
        residual = (s.xd_hat - s.xd)[:m_p]
        kinematic = Drive(Y_bar, -z, s.Y_k[:m_p], residual, self.R_k)
        return Command(torque, Drives(dynamic, kinematic))

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return xi^T P xi / 2."""
        xi = self._xi(s)
        return 0.5 * xi @ (self.P @ xi)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return -xi^T Q xi / 2 - da_k^T Y_k^T R_k Y_k da_k."""
        xi = self._xi(s)
        Y_p = s.Y_k[: self.task.positions]
        prediction = Y_p @ (s.a_k - truth.a_k)
        return -0.5 * xi @ (self.Q @ xi) - prediction @ (self.R_k @ prediction)


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

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return tau, (32) with (34), and the drives of both estimates, (36) and (37)."""
        e, kinematic = self._errors(s, self.alpha)
        a_k_rate = model.adaptation_k.value_rate(model.kinematic, kinematic)
        v = self._commanded_acceleration(s, s.xd_hat, self.alpha, a_k_rate)
        dynamics = model.dynamics
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
