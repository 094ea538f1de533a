"""The way from where the robot is to the first point of a motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError
from ..records import Desired
from ..tasks.task import Task
from .trajectory import Trajectory


class Approach(Trajectory):
    """From a point to the first point of a motion, at rest at both ends, then the motion.

    Coordinates move by minimum jerk, s(u) = 10 u^3 - 15 u^4 + 6 u^5 with u = t / duration: along a
    straight line; an orientation turns about one axis, the shortest way; continuous joints turn the
    short way. The motion is that of t - duration afterwards; it should start at rest, see
    ``Trajectory.from_rest``.

    Attributes:
        motion: what follows.
        way: (m) from its first point back to where the approach starts [m or rad].
        duration: of the approach [s].
    """

    def __init__(self, motion: Trajectory, start: ArrayLike, duration: float, task: Task) -> None:
        """Take the motion, the coordinates to start from, the duration [s] and the task.

        Raises:
            InputError: coordinates of another number than the motion has, or not finite; or a
                duration that is not positive.
        """
        self.motion, self._task, self._first = motion, task, motion.at(0.0).x_d
        self.duration = positive(duration, "duration", error=InputError)
        self.way = task.error(vector(start, self._first.size, "start"), self._first)

    def __repr__(self) -> str:
        """Return how long the approach takes, and what follows."""
        return f"approach of {self.duration:.3g} s, {self.motion!r}"

    @property
    def extent(self) -> float | None:
        """That of the motion that follows."""
        return self.motion.extent

    @property
    def settles(self) -> float | None:
        """When the motion that follows comes to rest [s], or None."""
        settled = self.motion.settles
        return None if settled is None else self.duration + settled

    @property
    def repeats(self) -> tuple[float, float] | None:
        """From when and with which period [s] the motion that follows repeats itself, or None."""
        found = self.motion.repeats
        return None if found is None else (self.duration + found[0], found[1])

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        T = self.duration
        if t >= T:
            return self.motion.at(t - T)
        u = max(t, 0.0) / T
        left = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        speed = -30.0 * u * u * (1.0 - u) ** 2 / T
        rate = -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / T**2
        x_d = self._task.moved(self._first, left * self.way)
        return Desired(np.asarray(x_d), speed * self.way, rate * self.way)
