"""Desired motions: coordinates with their first two derivatives at any time."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import numbers, positive, vector
from ..exceptions import InputError
from ..records import Desired
from ..tasks.frame import rotation_between, turned

_HORIZON = 60.0  # [s] of a run without end that is checked
_LOOKS, _RESTING = 400, 20  # instants that are checked, and how many of the last are at rest
_AT_REST = 1e-6  # speed and acceleration, in SI units


class Trajectory(ABC):
    """A twice differentiable motion of task coordinates in time.

    A subclass needs ``at`` alone. x_d and its derivatives have m numbers each, or, where x_d ends
    in a quaternion xyzw, x_d has one more than the velocity: of a pose 7 and 6, of an orientation 4
    and 3, rotations in world axes.

    ``at`` gives derivatives with respect to its own argument. The same path with another time law
    s(t) is therefore x_d(s(t)), with velocity x_d' ds/dt and acceleration x_d'' (ds/dt)^2 + x_d'
    d^2s/dt^2.
    """

    @abstractmethod
    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""

    @property
    def extent(self) -> float | None:
        """Radius of a circle, or half the diagonal of the box around another path [m or rad].

        None if the class does not know it; a rollout then measures the path that was run.
        """
        return None

    @property
    def settles(self) -> float | None:
        """Time from which the motion is at rest [s]; None: never, or the class does not know it."""
        return None

    def at_rest_from(self, duration: float | None = None) -> float | None:
        """Return the time from which the motion is at rest [s]; None if it does not come to rest.

        That is ``settles`` if it is known. Otherwise velocity and acceleration are evaluated at 400
        instants of the duration [s], of one minute for None, and must vanish in its last 5 %.
        """
        if self.settles is not None:
            return self.settles
        times = np.linspace(0.0, _HORIZON if duration is None else duration, _LOOKS)
        for k in reversed(range(_LOOKS)):
            _, xd_d, xdd_d = self.at(float(times[k]))
            if max(np.abs(xd_d).max(), np.abs(xdd_d).max()) > _AT_REST:
                return float(times[k + 1]) if k < _LOOKS - _RESTING else None
        return 0.0

    def shifted(self, by: ArrayLike) -> Trajectory:
        """Return the same motion displaced by (m): [m or rad], rotations about world axes [rad]."""
        return _Shifted(self, vector(by, self.at(0.0).xd_d.size, "by"))

    def starting_at(self, start: ArrayLike) -> Trajectory:
        """Return the same motion displaced so that its coordinates are ``start`` at time 0.

        Raises:
            InputError: ``start`` has another number of coordinates than x_d, or is not finite.
        """
        first = self.at(0.0)
        here, start = first.x_d, vector(start, first.x_d.size, "start")
        if here.size == first.xd_d.size:
            return self.shifted(start - here)
        n = here.size - 4
        turn = rotation_between(start[n:].tolist(), here[n:].tolist())
        return self.shifted(np.append(start[:n] - here[:n], turn))

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return the coordinates x_d, one row for each of the times (N) [s]."""
        return np.stack([self.at(float(t)).x_d for t in times])


class _Shifted(Trajectory):
    """A motion displaced by a constant."""

    def __init__(self, motion: Trajectory, by: np.ndarray) -> None:
        self._motion, self._by = motion, by

    @property
    def extent(self) -> float | None:
        """The extent of the motion that is displaced."""
        return self._motion.extent

    @property
    def settles(self) -> float | None:
        """When the motion that is displaced comes to rest."""
        return self._motion.settles

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        (x_d, xd_d, xdd_d), by = self._motion.at(t), self._by
        if x_d.size == xd_d.size:
            return Desired(x_d + by, xd_d, xdd_d)
        n, R = x_d.size - 4, pin.exp3(by[-3:])
        return Desired(
            np.append(x_d[:n] + by[:n], turned(x_d[n:], by[n:])),
            np.append(xd_d[:n], R @ xd_d[n:]),
            np.append(xdd_d[:n], R @ xdd_d[n:]),
        )


class Hold(Trajectory):
    """Rest at a fixed point, for set-point control.

    Attributes:
        point: (m) [m or rad].
    """

    def __init__(self, point: ArrayLike) -> None:
        """Take the point (m) [m or rad].

        Raises:
            InputError: coordinates that are not finite numbers.
        """
        self.point = vector(point, None, "reference.center")
        self._rest = np.zeros(self.point.size)

    @property
    def extent(self) -> float:
        """Zero: it is a point."""
        return 0.0

    @property
    def settles(self) -> float:
        """Zero: it is at rest from the start."""
        return 0.0

    def shifted(self, by: ArrayLike) -> Hold:
        """Return the point displaced by (m) [m or rad]."""
        return Hold(self.point + by)

    def at(self, t: float) -> Desired:
        """Return the point, at rest."""
        return Desired(self.point, self._rest, self._rest)


class Waypoints(Trajectory):
    """Minimum-jerk segments from point to point, at rest in each; the last point is held.

    T. Flash, N. Hogan, *The coordination of arm movements*, J. Neuroscience 1985: s(u) = 10 u^3 -
    15 u^4 + 6 u^5.

    Attributes:
        points: (k, m) [m or rad].
        segment: duration of a segment [s].
    """

    def __init__(self, points: ArrayLike | list[np.ndarray], segment: float) -> None:
        """Take the points (k, m) [m or rad], k >= 2, and the duration [s] of one segment.

        Raises:
            InputError: fewer than two points, ragged or non-finite ones, or a duration that is not
                positive.
        """
        self.points = numbers(points, "reference.points")
        if self.points.ndim != 2 or len(self.points) < 2:
            raise InputError(
                "expected at least two points of the same number of coordinates.",
                where="reference.points",
            )
        self.segment = positive(segment, "reference.segment")

    @property
    def extent(self) -> float:
        """Half the diagonal of the box around the points [m or rad]."""
        return half_diagonal(self.points)

    @property
    def settles(self) -> float:
        """When it reaches the last point [s]."""
        return self.segment * (len(self.points) - 1)

    def shifted(self, by: ArrayLike) -> Waypoints:
        """Return the same motion displaced by (m) [m or rad]."""
        return Waypoints(self.points + by, self.segment)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        last = len(self.points) - 2
        k = int(min(max(t // self.segment, 0), last))
        u, T = min(max(t / self.segment - k, 0.0), 1.0), self.segment
        start, move = self.points[k], self.points[k + 1] - self.points[k]
        s = u**3 * (10 - 15 * u + 6 * u * u)
        sd = 30 * u * u * (1 - u) ** 2 / T
        sdd = 60 * u * (1 - u) * (1 - 2 * u) / T**2
        return Desired(start + s * move, sd * move, sdd * move)


def half_diagonal(path: np.ndarray) -> float:
    """Return half the diagonal of the box around a path (N, m) [m or rad]."""
    return float(0.5 * np.linalg.norm(np.ptp(path, axis=0)))
