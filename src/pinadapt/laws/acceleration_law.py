"""Laws that command an acceleration: common gains, defaults, loop, and (19) of Wang and Xie.

Those for a known robot follow: resolved acceleration, and computed torque in joint space.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy import empty

from .._checks import positive
from .._kernels import laws as kernels
from ..adaptation.adaptation import Drives
from ..filters import MotionFilters
from ..models.typical_motion import TypicalMotion
from ..signals import Signals
from .law import Command, EstimatedModel, Feedback, Truth, check_in_place, check_margin
from .task_feedback import TaskFeedback


@dataclass(frozen=True, eq=False)
class AccelerationLaw(TaskFeedback):
    """A law whose feedback is an acceleration; gains are numbers, lists or matrices.

    Default gains for the bandwidth w: K_P = w^2, K_v = 2 w, alpha = w / 4, lambda = w / 2 and
    lambda_a = 1 / (3 w); on Wang and Xie's arm, which reaches 2.2 m, their published numbers.

    Attributes:
        task, posture, R_k, lambda_: as ``TaskFeedback``.
        K_v: (m, m) velocity gain [1/s].
        K_P: (m, m) position gain [1/s^2].
        alpha: weight of the position error in e = dxd_hat + alpha dx [1/s].
        lambda_a: acceleration filter [s].
    """

    _: KW_ONLY
    lambda_a: float = 1.0 / 60.0

    adaptation_mode = 3.0
    units = ("1/s", "1/s^2")

    def __post_init__(self) -> None:
        """Turn gains into matrices.

        Raises:
            GainError: gains that break a hypothesis of the proof.
        """
        check_in_place(self, "K_v", "K_P", "alpha", "R_k", "lambda_", "lambda_a")
        self._check()

    def _check(self) -> None:
        check_margin(self.K_v, self.alpha)

    @cached_property
    def filters(self) -> MotionFilters:
        """Task velocity and joint acceleration, filtered."""
        return MotionFilters(self.lambda_, positive(1.0 / self.lambda_a, "lambda_a"))

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, as the class states them."""
        return {**super().default_gains(motion, dt, w), "lambda_a": 1.0 / (3.0 * w)}

    def parameter_effects(self, motion: TypicalMotion) -> np.ndarray:
        """Return Phi = J M_hat^-1 Y (N, m, p_d) at each state."""
        return motion.jacobians @ np.linalg.solve(motion.mass_matrices, motion.regressors)

    def feedback(self, motion: TypicalMotion) -> Feedback:
        """Return the feedback of the task error."""
        one = np.eye(len(self.K_v))
        return Feedback(self.K_P, self.K_v, 0.0 * one, self.K_v - self.alpha * one)

    def _commanded_acceleration(
        self, s: Signals, xd: np.ndarray, turning: Any, a_k_rate: np.ndarray
    ) -> np.ndarray:
        """Return v = J^+ (xdd_d - K_v (xd - xd_d) - K_P dx - dJ_hat/dt qd) + (I - J^+ J) psi (n).

        dJ_hat/dt qd = dJ/dt(a_k) qd + Y_k da_k/dt, where the estimate moves as well. psi is that of
        the posture. For a pose v holds -``turning`` delta as well, delta = d(dx)/dt - (xd - xd_d).
        """
        Jdot_v = s.Jdot_v if s.delta is None else s.Jdot_v + np.dot(turning, s.delta)
        inverse, posture, missed, v = s.inverse, self.posture, empty(s.dx.size), empty(s.v.size)
        q = s.v
        w = 0.0
        if not inverse.unique:
            q = posture.coordinates(s.q)
            w = posture.frequency
        kernels.commanded_acceleration(
            s.xdd_d, self.K_v, xd, s.xd_d, self.K_P, s.dx, Jdot_v, s.Y_k, a_k_rate,
            inverse.J, inverse.gram_inverse, s.v, q, posture.rows, w, missed, v,
        )  # fmt: skip
        return v


class EstimatedVelocityLaw(AccelerationLaw):
    """Laws on e = dxd_hat + alpha dx that command an acceleration v, kinematics adapted by (19).

    V = e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2 + parameters,
    dV/dt = -dxd_hat^T (K_v - alpha I) dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k W_k da_k.

    For a pose v also holds -alpha delta, delta = d(dx)/dt - (xd - xd_d): de/dt = d(dxd_hat)/dt +
    alpha (xd - xd_d + delta) is then as (17) has it, and dx^T (K_P + alpha K_v - alpha^2 I) delta =
    0 leaves dV/dt; see ``PoseTask``.
    """

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2."""
        alpha = self.alpha
        e = s.dxd_hat + alpha * s.dx
        return 0.5 * e @ e + 0.5 * s.dx @ (self.K_PV @ s.dx) - 0.5 * alpha**2 * s.dx @ s.dx

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt; Wang and Xie print the bound with beta, this is the equality."""
        return self.alpha * s.dxd_hat @ s.dxd_hat - self._dissipated(s, truth)


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
        v = self._commanded_acceleration(s, s.xd_hat, self.alpha, np.zeros(s.a_k.size))
        torque = model.dynamics.torque(s.q, s.v, v)  # (8)
        return Command(torque, Drives.none(s.a_d.size, s.a_k.size))


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
