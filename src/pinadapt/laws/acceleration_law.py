"""What the laws that command an acceleration have in common: gains, their defaults, their loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ..filters.low_pass import LowPass
from ..filters.motion_filters import MotionFilters
from ..models.typical_motion import TypicalMotion
from ..tasks.task import Task
from .feedback import Feedback, KinematicLoop
from .gains import check_in_place, check_margin, merged
from .law import Law
from .posture import Posture

Own = TypeVar("Own", bound="AccelerationLaw")


@dataclass(frozen=True, eq=False)
class AccelerationLaw(Law):
    """A law whose feedback is an acceleration; gains are numbers, lists or matrices.

    Default gains for the bandwidth w: K_P = w^2, K_v = 2 w, alpha = w / 4, lambda = w / 2 and
    lambda_a = 1 / (3 w); on Wang and Xie's arm, which reaches 2.2 m, their published numbers.

    Attributes:
        task: the controlled coordinates, m of them, m_p positions.
        posture: what redundant joints do.
        K_v: (m, m) velocity gain [1/s].
        K_P: (m, m) position gain [1/s^2].
        alpha: weight of the position error in e = dxd_hat + alpha dx [1/s].
        R_k: (m_p, m_p) weight of the kinematic prediction error.
        lambda_: velocity filter [1/s].
        lambda_a: acceleration filter [s].
    """

    task: Task
    posture: Posture
    _: KW_ONLY
    K_v: Any
    K_P: Any
    alpha: float
    R_k: Any = 1.0
    lambda_: float = 10.0
    lambda_a: float = 1.0 / 60.0

    needs_acceleration = True
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
    def K_PV(self) -> np.ndarray:
        """K_P + alpha K_v (m, m)."""
        return np.asarray(self.K_P + self.alpha * self.K_v)

    @cached_property
    def filters(self) -> MotionFilters:
        """Task velocity and joint acceleration, filtered."""
        return MotionFilters(
            LowPass(self.lambda_, "lambda"), LowPass(1.0 / self.lambda_a, "lambda_a")
        )

    @classmethod
    def tuned(
        cls: type[Own], motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any
    ) -> Own:
        """Return the law with the default gains of the class; see ``Law.tuned``."""
        w = share * motion.bandwidth
        gains = merged(cls._defaults(w), given)
        posture = Posture.of(motion.robot, given.get("posture"), share * motion.bandwidth)
        return cls(motion.kinematics.task, posture, **gains)

    @classmethod
    def _defaults(cls, w: float) -> dict[str, Any]:
        """Return the default gains for a bandwidth w [rad/s], by the names that users write."""
        return {
            "Kv": 2.0 * w,
            "Kp": w * w,
            "alpha": w / 4.0,
            "R_k": 1.0,
            "lambda_": w / 2.0,
            "lambda_a": 1.0 / (3.0 * w),
        }

    def with_prediction_weight(self: Own, weight: float) -> Own:
        """Return the law with another R_k, a number times the identity."""
        return replace(self, R_k=weight)

    def parameter_effects(self, motion: TypicalMotion) -> list[np.ndarray]:
        """Return Phi = J M_hat^-1 Y (m, p_d) at each state."""
        return motion.acceleration_effects

    def feedback(self, motion: TypicalMotion) -> Sequence[Feedback]:
        """Return the feedback of the task error, the same at all states."""
        one = np.eye(len(self.K_v))
        return [Feedback(self.K_P, self.K_v, 0.0 * one, self.K_v - self.alpha * one)]

    def kinematic_loop(self) -> KinematicLoop:
        """Return the coupling by K_P + alpha K_v on the positions."""
        m = self.task.positions
        stiffness = float(np.linalg.eigvalsh(self.K_PV[:m, :m])[-1]) if m else 0.0
        return KinematicLoop(stiffness, self.alpha, self.R_k)
