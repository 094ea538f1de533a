"""The passivity-based adaptive Jacobian law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import empty

from .._kernels import laws as kernels
from ..adaptation.adaptation import Drive, Drives
from ..filters import MotionFilters
from ..models.typical_motion import (
    TypicalMotion,
    felt_inertia,
    felt_mass,
    joint_inertia,
)
from ..signals import Signals
from ..tasks.frame import PoseTask
from ..tasks.task import Moving
from .law import Command, EstimatedModel, Feedback, Truth, check_in_place
from .task_feedback import TaskFeedback

_NOTHING = np.array([])


@dataclass(frozen=True, eq=False)
class AdaptiveJacobian(TaskFeedback):
    """Passivity-based adaptive Jacobian tracking.

    C. Cheah, C. Liu, J.-J. Slotine, IEEE TAC 51 (2006) 1024-1029.

    Law:          tau = -J_hat^T (K_v dxd_hat + K_P dx) + Y(q, qd, qd_r, qdd_r) a_d - N D N s,
                  qd_r = J_hat^+ (xd_d - alpha dx) + N psi, s = qd - qd_r, N = I - J_hat^+ J_hat
                  (zero for a square J_hat).
    Adaptation:   da_d/dt = -Gamma_d Y_r^T s; da_k/dt = Gamma_k (Y_k^T (K_P + alpha K_v) dx - W_k^T
                  R_k (W_k a_k - y)).
    Closed loop:  M ds/dt + C s = -J_hat^T (K_v dxd_hat + K_P dx) + Y_r da_d - N D N s.
    V:            s^T M s / 2 + dx^T (K_P + alpha K_v) dx / 2 + D_d(a_d) + D_k(a_k),
                  dV/dt = -dxd_hat^T K_v dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k W_k da_k -
                  (N s)^T D (N s)
                  - s^T (f(qd) - f(qd_r)), f the true friction of the joints: monotone, so the last
                  term is at most zero.
    Pose:         qdd_r takes the true d(dx)/dt = xd - xd_d + delta, and dx^T (K_P + alpha K_v)
                  delta = 0; see ``PoseTask``.
    Assumptions:  constant parameters; J_hat of full row rank; task velocity known (it enters
                  qdd_r).
                  Neither acceleration nor M_hat^-1 is needed.

    Default gains for the bandwidth w: K_P = w^2 m, K_v = 2 w m, alpha = w / 4, lambda = w / 2, the
    posture at w / 8, half of the rate at which the task error goes, with the mass m felt at the
    frame at home; on the rotations of a pose the inertia felt there, or as
    much as lets damping change the angular velocity of the lightest axis by its own size in one
    period, if that is less; of joints their own inertia at home.

    Attributes:
        task, R_k, lambda_: as ``TaskFeedback``.
        posture: what redundant joints do; its damping is D.
        K_v: (m, m) velocity gain [N s/m; N m s/rad on rotations and joints].
        K_P: (m, m) position gain [N/m; N m/rad on rotations and joints].
        alpha: [1/s].
    """

    name = "adaptive-jacobian"
    sources = ("CheahLiuSlotine2006",)
    needs_task_velocity = True
    posture_share = 0.25
    velocity_error = True
    uses_acceleration = False
    units = ("N s/m, for rotations N m s/rad", "N/m, for rotations N m/rad")

    def __post_init__(self) -> None:
        """Turn gains into matrices.

        Raises:
            GainError: gains that break a hypothesis of the proof.
        """
        check_in_place(self, "K_v", "K_P", "alpha", "R_k", "lambda_")

    @cached_property
    def filters(self) -> MotionFilters:
        """The task velocity, filtered."""
        return MotionFilters(self.lambda_, self.lambda_)

    @classmethod
    def felt(cls, motion: TypicalMotion, dt: float) -> float | np.ndarray:
        """Return the mass or inertia felt by the task rows at home, a number or (m)."""
        robot = motion.robot
        task = motion.kinematics.task
        if not task.positions:
            return joint_inertia(robot)
        mass = felt_mass(robot)
        if isinstance(task, PoseTask):
            largest = 1.0 / (2.0 * motion.bandwidth * dt)
            return np.repeat([mass, felt_inertia(robot, largest)], 3)
        return mass

    def _reference(self, s: Signals, Jdot: np.ndarray) -> Moving:
        """Return qd_r = J_hat^+ u + N psi, u = xd_d - alpha dx, and its time derivative (n)."""
        u = empty(s.dx.size)
        ud = empty(s.dx.size)
        kernels.reference(s.xd_d, s.dx, s.xdd_d, s.xd, _NOTHING, self.alpha, 0.0, u, ud)
        if s.delta is not None:
            ud -= self.alpha * s.delta
        psi, psid = self.posture.null_motion(s)
        return s.inverse.solve_with_rate(u, psi, ud, psid, Jdot)

    def _error(self, s: Signals) -> np.ndarray:
        """Return s = qd - qd_r (n)."""
        return s.v - self._reference(s, np.zeros(s.J.shape))[0]

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the torque and the drives of both estimates."""
        _, kinematic = self._errors(s, 0.0)
        a_k_rate = model.adaptation_k.value_rate(model.kinematic, kinematic)
        Jdot = model.kinematics.jacobian_rate(a_k_rate)
        qd_r, qdd_r = self._reference(s, Jdot)
        # tau = Y_r a_d - J_hat^T (K_v dxd_hat + K_P dx) - N D N s, s = qd - qd_r
        Y_r, feedforward = model.dynamics.slotine_li(s.q, s.v, qd_r, qdd_r)
        error = s.v - qd_r
        torque = feedforward - (self.K_v.dot(s.xd_hat - s.xd_d) + self.K_P.dot(s.dx)).dot(s.J)
        torque -= s.inverse.null(self.posture.damping * s.inverse.null(error))
        return Command(torque, Drives(Drive(Y_r, error), kinematic))

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return s^T M s / 2 + dx^T (K_P + alpha K_v) dx / 2, M the true mass matrix."""
        error = self._error(s)
        return 0.5 * error @ (truth.M @ error) + 0.5 * s.dx @ (self.K_PV @ s.dx)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt."""
        return -self._dissipated(s, truth) - self._joint_dissipation(s, truth)

    def _joint_dissipation(self, s: Signals, truth: Truth) -> float:
        """Return (N s)^T D (N s) + s^T (f(qd) - f(qd_r)) [W]."""
        error = self._error(s)
        f = truth.friction.torque
        null = s.inverse.null(error)
        braking = error @ (f(s.v) - f(s.v - error))
        return null @ (self.posture.damping * null) + braking

    def feedback(self, motion: TypicalMotion) -> Feedback:
        """Return the feedback of the joints."""
        W = motion.unit_masses
        W_T = W.swapaxes(1, 2)
        one = np.eye(motion.robot.model.nv)
        D = one * (self.posture.damping if self.posture else 0.0)
        tracked = motion.right_inverses @ motion.jacobians
        null = one - tracked
        N = W @ null @ D @ null @ W_T
        P = W @ motion.mass_matrices @ tracked @ W_T  # projects onto what the task feels
        damping = of_joints(motion, self.K_v)
        return Feedback(of_joints(motion, self.K_P), damping + self.alpha * P, N, damping + N)


def of_joints(motion: TypicalMotion, K: np.ndarray) -> np.ndarray:
    """Return J^T K J (N, n, n) of a task's K (m, m), in coordinates of unit mass, at each state."""
    J_W = motion.jacobians @ motion.unit_masses.swapaxes(1, 2)
    return J_W.swapaxes(1, 2) @ K @ J_W
