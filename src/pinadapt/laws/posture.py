"""What a redundant arm does with its null space: return to a rest posture, away from its stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import instance, numbers, positive, vector, word
from .._kernels import laws as kernels
from ..description.chain import position_limits
from ..models.typical_motion import joint_inertia
from ..robot.robot import Robot
from ..signals import Signals
from ..tasks.task import Moving


class Posture:
    """Critically damped return to a rest configuration, in the null space of the task.

    The offset from rest grows by 2 d^2 / b where a joint is d inside the margin b before one of its
    limits: a tenth of its range, but at most half of the way from rest. The task has
    priority: its joint motion is not limited by the posture, even beyond joint limits.

    Attributes:
        frequency: w [rad/s].
        plain: whether a configuration is its joint coordinates, nq = n.
        damping: (n) null-space damping torque per velocity of the passivity-based law, w diag
            M(q_rest).
        rows: (4, n) rest, and from there the edges inside the limits, lower and upper, and the
            margin; see ``coordinates``.
    """

    def __init__(self, robot: Robot, rest: ArrayLike | None = None, frequency: float = 4.0) -> None:
        """Take the rest pose (n) [rad or m], by default home, and the frequency [rad/s].

        Raises:
            RobotError, GainError: wrong size, non-finite or not positive.
        """
        instance(robot, Robot, "robot")
        self.frequency = positive(frequency, "posture frequency")
        resting = robot if rest is None else robot.at(vector(rest, robot.model.nv, "rest"))
        self._model = robot.model.copy()
        self._q_rest = resting.q0
        self.damping = self.frequency * joint_inertia(resting)
        self.plain = self._q_rest.size == self.damping.size
        angles = resting.home_angles
        low, high = position_limits(self._model)
        margin = np.minimum(0.1 * (high - low), 0.5 * np.minimum(angles - low, high - angles))
        limited = np.isfinite(margin) & (margin > 1e-3)  # [rad or m] else rest is at a limit
        margin = np.where(limited, margin, 1.0)
        low = np.where(limited, low - angles + margin, -np.inf)
        high = np.where(limited, high - angles - margin, np.inf)
        rest = self._q_rest if self.plain else np.zeros(self.damping.size)
        self.rows = np.stack([rest, low, high, margin])

    @classmethod
    def of(cls, robot: Robot, given: Any, bandwidth: float) -> Posture:
        """Return a posture as a user gives it, by default home at half of the bandwidth [rad/s].

        Args:
            robot: the nominal robot.
            given: None, a frequency [rad/s], the rest pose (n) [rad or m], or a mapping of "rest"
                and "frequency".
            bandwidth: of the feedback [rad/s].

        Raises:
            GainError, RobotError: unknown keys, or as the class.
        """
        words: dict[str, Any] = {"rest": None, "frequency": None}
        if isinstance(given, Mapping):
            for key in given:
                word(key, words, "posture")
            words |= given
        elif given is not None:
            value = numbers(given, "posture")
            words["rest" if value.ndim else "frequency"] = value if value.ndim else float(value)
        frequency = words["frequency"]
        return cls(robot, words["rest"], 0.5 * bandwidth if frequency is None else frequency)

    def offset(self, q: np.ndarray) -> np.ndarray:
        """Return how far q (nq) is from rest (n) [rad or m], more where a limit is near."""
        still, offset, rate = np.zeros(self.damping.size), *np.empty((2, self.damping.size))
        kernels.posture_velocity(self.coordinates(q), self.rows, still, -1.0, offset, rate)
        return offset

    def null_motion(self, s: Signals) -> Moving | tuple[None, None]:
        """Return psi (n) = -w offset(q) [rad/s or m/s] and its rate, None without null space."""
        if s.inverse.unique:
            return None, None
        v = s.v
        psi = empty(v.size)
        psid = empty(v.size)
        kernels.posture_velocity(self.coordinates(s.q), self.rows, v, self.frequency, psi, psid)
        return psi, psid

    def coordinates(self, q: np.ndarray) -> np.ndarray:
        """Return the coordinates (n) of q (nq) that ``rows`` are about [rad or m]."""
        return q if self.plain else pin.difference(self._model, self._q_rest, q)
