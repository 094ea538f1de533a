"""What a redundant arm does with its null space: damp it and return to a rest posture."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import positive, vector
from .._kernels import feedback as kernels
from ..robot.robot import Robot
from ..signals import Signals


class Posture:
    """Critically damped return to a rest configuration, seen only in the null space of the task.

    Attributes:
        frequency: w [rad/s].
        damping: (n) null-space damping torque per velocity of the passivity-based law, w diag
            M(q_rest).
    """

    def __init__(self, robot: Robot, rest: ArrayLike | None = None, frequency: float = 4.0) -> None:
        """Take the rest pose (n) [rad or m], by default home, and the frequency [rad/s].

        Raises:
            RobotError, GainError: wrong size, non-finite or not positive.
        """
        self.frequency = positive(frequency, "posture frequency")
        resting = robot if rest is None else robot.at(vector(rest, robot.model.nv, "rest"))
        self._model, self._q_rest = robot.model.copy(), resting.q0
        M = pin.crba(self._model, self._model.createData(), self._q_rest)
        self.damping = self.frequency * np.diag(M).copy()

    def offset(self, q: np.ndarray) -> np.ndarray:
        """Return q - q_rest (n), on the circle for continuous joints."""
        return (
            q - self._q_rest
            if q.size == self.damping.size
            else pin.difference(self._model, self._q_rest, q)
        )

    def from_rest(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return two vectors (n) whose difference is ``offset``."""
        if q.size == self.damping.size:
            return q, self._q_rest
        return self.offset(q), np.zeros(self.damping.size)

    def acceleration(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return psi (n) = -2 w v - w^2 (q - q_rest) [rad/s^2 or m/s^2]."""
        return (-2.0 * self.frequency) * v - self.frequency**2 * self.offset(q)

    def null_motion(self, s: Signals) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """Return psi (n) = -w (q - q_rest) [rad/s or m/s] and its rate, None without null space."""
        if s.inverse.unique:
            return None, None
        (q, rest), psi, psid = self.from_rest(s.q), empty(s.v.size), empty(s.v.size)
        kernels.posture_velocity(q, rest, s.v, self.frequency, psi, psid)
        return psi, psid
