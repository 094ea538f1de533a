"""Desired motions: coordinates with their first two derivatives at any time, and time laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import flag, instance, numbers, positive, vector
from ..exceptions import InputError
from ..records import Desired
from ..tasks.frame import rotation_between, turned
from ..tasks.task import Task

_HORIZON = 60.0  # [s] of a run without end that is checked
_LOOKS, _RESTING = 400, 20  # instants that are checked, and how many of the last are at rest
_AT_REST = 1e-6  # speed and acceleration, in SI units

_START, _LOOKS_AT_START = 5.0, 250  # [s] of the motion that are looked at for its start
_RESTS = 1e-3  # share of its largest speed and acceleration at which a motion starts at rest
_STEEPEST = 1.875  # slope of the smooth start's rate, times the ramp
_RAMP, _RAMPS = 1.0, (0.1, 5.0)  # [s] of a motion without acceleration; least and largest
_UNIFORM = 1e-3  # [1/s] acceleration relative to the speed, below which there is none


class Trajectory(ABC):
    """A twice differentiable motion of task coordinates in time.

    A subclass needs ``at`` alone. x_d and its derivatives have m numbers each, or, where x_d ends
    in a quaternion xyzw, x_d has one more than the velocity: of a pose 7 and 6, of an orientation 4
    and 3, rotations in world axes.

    ``at`` gives derivatives with respect to its own argument. The same path with another time law
    s(t) is therefore x_d(s(t)), with velocity x_d' ds/dt and acceleration x_d'' (ds/dt)^2 + x_d'
    d^2s/dt^2: ``Retimed``, of which ``from_rest`` is the most frequent case.
    """

    @abstractmethod
    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""

    def __repr__(self) -> str:
        """Return the kind of motion."""
        return type(self).__name__

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

    @property
    def repeats(self) -> tuple[float, float] | None:
        """From when and with which period [s] the motion repeats itself; None: not, or unknown."""
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

    def from_rest(self, ramp: float | None = None, *, duration: float | None = None) -> Trajectory:
        """Return the same path, begun at rest: ``Retimed`` by a ``SmoothStart``.

        The path is the same to rounding, and half a ramp later so is the motion. One that starts
        with neither speed nor acceleration (a thousandth of its largest ones) is returned as it is,
        and so is one ``as_given``.

        Args:
            ramp: duration of the start [s]. None: 1.875 times the largest speed of the first five
                seconds over their largest acceleration, but from 0.1 s to 5 s; then the rate asks
                for no more acceleration than the motion. 1 s if it has no acceleration.
            duration: of the run [s]; the motion is not looked at beyond. None: unknown.

        Raises:
            InputError: a ramp that is not positive.
        """
        if ramp is not None:
            positive(ramp, "ramp", error=InputError)
        span = _START if duration is None else min(_START, duration)
        looks = list(_looks(self, np.linspace(0.0, span, _LOOKS_AT_START)))
        speeds, rates = np.linalg.norm(looks, axis=2).T
        v, a = float(speeds.max()), float(rates.max())
        if speeds[0] <= max(_AT_REST, _RESTS * v) and rates[0] <= max(_AT_REST, _RESTS * a):
            return self
        if ramp is None:
            within = min(max(_STEEPEST * v / a, _RAMPS[0]), _RAMPS[1]) if a > 0.0 else _RAMP
            ramp = within if a > _UNIFORM * v else _RAMP
        return Retimed(self, SmoothStart(ramp))

    def as_given(self) -> Trajectory:
        """Return the same motion, to be taken exactly as it is.

        ``simulate`` then neither starts it from rest nor lets the robot approach its first point.
        """
        return AsGiven(self)

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
        turn = rotation_between(start[n:], here[n:])
        return self.shifted(np.append(start[:n] - here[:n], turn))

    def placed(self, start: np.ndarray, task: Task | None = None) -> Trajectory:
        """Return the motion that begins at ``start``, if it has no place of its own.

        Args:
            start: where the robot is.
            task: of these coordinates.
        """
        return self

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return the coordinates x_d, one row for each of the times (N) [s]."""
        found = [self.at(float(t)).x_d for t in times]
        return np.stack(found) if found else np.zeros((0, self.at(0.0).x_d.size))


def _looks(motion: Trajectory, times: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield velocity and acceleration (m) at the first of these times (N) [s], while there are any.

    An error in a user's motion ends the run at its time, and does not prevent the start.
    """
    for t in times:
        try:
            _, xd_d, xdd_d = motion.at(float(t))
        except Exception:
            if t == times[0]:
                raise
            return
        if not (np.isfinite(xd_d).all() and np.isfinite(xdd_d).all()):
            return
        yield xd_d, xdd_d


class Derived(Trajectory):
    """A motion made of another one; its extent, rest and repetition are those of the other.

    Attributes:
        motion: the other one.
    """

    motion: Trajectory

    @property
    def extent(self) -> float | None:
        """That of the other motion."""
        return self.motion.extent

    @property
    def settles(self) -> float | None:
        """That of the other motion [s], or None."""
        return self.motion.settles

    @property
    def repeats(self) -> tuple[float, float] | None:
        """That of the other motion [s], or None."""
        return self.motion.repeats


class _Shifted(Derived):
    """A motion displaced by a constant."""

    def __init__(self, motion: Trajectory, by: np.ndarray) -> None:
        self.motion, self._by = motion, by

    def __repr__(self) -> str:
        """Return the kind of the motion that is displaced."""
        return repr(self.motion)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        (x_d, xd_d, xdd_d), by = self.motion.at(t), self._by
        if x_d.size == xd_d.size:
            return Desired(x_d + by, xd_d, xdd_d)
        n, R = x_d.size - 4, pin.exp3(by[-3:])
        return Desired(
            np.append(x_d[:n] + by[:n], turned(x_d[n:], by[n:])),
            np.append(xd_d[:n], R @ xd_d[n:]),
            np.append(xdd_d[:n], R @ xdd_d[n:]),
        )


class Retimed(Derived):
    """x_d(s(t)): the path of a motion by another time law.

    Velocity x_d' ds/dt and acceleration x_d'' (ds/dt)^2 + x_d' d^2s/dt^2.

    Attributes:
        motion: x_d(s).
        law: s(t).
    """

    def __init__(self, motion: Trajectory, law: TimeLaw) -> None:
        """Take the motion and the time law.

        Raises:
            InputError: others than a ``Trajectory`` and a ``TimeLaw``.
        """
        self.motion = instance(motion, Trajectory, "motion")
        self.law = instance(law, TimeLaw, "law")

    def __repr__(self) -> str:
        """Return the motion and what its time law does."""
        return f"{self.motion!r}, {self.law!r}"

    @property
    def settles(self) -> float | None:
        """Time from which the motion is at rest [s], when its path is; None: never or unknown."""
        settled = self.motion.settles
        return None if settled is None else self.law.when(settled)

    @property
    def repeats(self) -> tuple[float, float] | None:
        """From when and with which period [s] both path and law repeat themselves, or None."""
        found = self.motion.repeats
        return None if found is None else self.law.repeats(*found)

    def from_rest(self, ramp: float | None = None, *, duration: float | None = None) -> Trajectory:
        """As of any motion; one that has a smooth start already gets the new ramp instead."""
        if ramp is not None and isinstance(self.law, SmoothStart):
            return self.motion.from_rest(ramp, duration=duration)
        return super().from_rest(ramp, duration=duration)

    def placed(self, start: np.ndarray, task: Task | None = None) -> Retimed:
        """Return the same time law along the placed motion."""
        return Retimed(self.motion.placed(start, task), self.law)

    def shifted(self, by: ArrayLike) -> Retimed:
        """Return the same motion displaced by (m): [m or rad], rotations about world axes [rad]."""
        return Retimed(self.motion.shifted(by), self.law)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        s, rate, acceleration = self.law.at(t)
        if rate == 1.0 and acceleration == 0.0:
            return self.motion.at(s)
        x_d, xd_d, xdd_d = self.motion.at(s)
        return Desired(x_d, rate * xd_d, rate * rate * xdd_d + acceleration * xd_d)


class AsGiven(Derived):
    """A motion to be taken exactly as it is, although it starts at speed or beside the robot.

    Attributes:
        motion: the same.
    """

    def __init__(self, motion: Trajectory) -> None:
        """Take the motion."""
        self.motion = motion

    def __repr__(self) -> str:
        """Return the motion, and that it is as given."""
        return f"{self.motion!r}, as given"

    def from_rest(self, ramp: float | None = None, *, duration: float | None = None) -> Trajectory:
        """Return itself; with a ramp, the motion from rest after all."""
        return self if ramp is None else self.motion.from_rest(ramp, duration=duration)

    def as_given(self) -> AsGiven:
        """Return itself."""
        return self

    def placed(self, start: np.ndarray, task: Task | None = None) -> AsGiven:
        """Return the placed motion, as given."""
        return AsGiven(self.motion.placed(start, task))

    def shifted(self, by: ArrayLike) -> AsGiven:
        """Return the same motion displaced by (m): [m or rad], rotations about world axes [rad]."""
        return AsGiven(self.motion.shifted(by))

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        return self.motion.at(t)


class Hold(Trajectory):
    """Rest at a fixed point, for set-point control.

    Attributes:
        point: (m) [m or rad].
    """

    def __init__(self, point: ArrayLike | None = None) -> None:
        """Take the point (m) [m or rad]; None: where the robot is at the start.

        Raises:
            InputError: coordinates that are not finite numbers.
        """
        self._own = point is not None
        self.point = vector(np.zeros(3) if point is None else point, None, "trajectory.point")
        self._rest = np.zeros(self.point.size)

    def placed(self, start: np.ndarray, task: Task | None = None) -> Hold:
        """Return the motion that holds ``start``, if it has no point of its own."""
        return self if self._own else Hold(start)

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
        return Hold(self.point + vector(by, self.point.size, "by"))

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

    def __init__(
        self,
        points: ArrayLike | list[np.ndarray],
        segment: float = 2.0,
        relative: bool = False,
    ) -> None:
        """Take the points (k, m) [m or rad], k >= 2, and the duration [s] of one segment.

        If they are ``relative``, the motion begins where the robot is, and the points are offsets
        from there; then k >= 1.

        Raises:
            InputError: fewer than two points, ragged or non-finite ones, or a duration that is not
                positive.
        """
        self.points = numbers(points, "trajectory.points")
        self._relative = flag(relative, "trajectory.relative")
        if relative and self.points.ndim == 2:
            self.points = np.vstack([np.zeros(self.points.shape[1]), self.points])
        if self.points.ndim != 2 or len(self.points) < 2:
            raise InputError(
                "expected at least two points of the same number of coordinates.",
                where="trajectory.points",
            )
        self.segment = positive(segment, "trajectory.segment")

    def placed(self, start: np.ndarray, task: Task | None = None) -> Waypoints:
        """Return the motion that begins at ``start`` (m), if its points are offsets.

        Raises:
            InputError: the points have another number of coordinates.
        """
        if not self._relative:
            return self
        if self.points.shape[1] != start.size:
            raise InputError(
                f"every point needs {start.size} coordinates, as many as the task.",
                where="trajectory.points",
            )
        return Waypoints(self.points + start, self.segment)

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
        return Waypoints(self.points + vector(by, self.points.shape[1], "by"), self.segment)

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


class TimeLaw(ABC):
    """A path's own time s as a function of time t, twice continuously differentiable for t > 0.

    Along x_d(s(t)) velocity and acceleration are x_d' ds/dt and x_d'' (ds/dt)^2 + x_d' d^2s/dt^2.
    """

    @abstractmethod
    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""

    @abstractmethod
    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s], the latest one if it rests."""

    @abstractmethod
    def repeats(self, since: float, period: float) -> tuple[float, float] | None:
        """Return from when and with which period a motion repeats itself under this law [s].

        Args:
            since: when it begins to repeat itself by its own time [s].
            period: of the motion by its own time [s].
        """


class SmoothStart(TimeLaw):
    """The rate ds/dt rises from 0 to 1 within a ramp, and s = t - ramp / 2 afterwards.

    ds/dt = 10 u^3 - 15 u^4 + 6 u^5 with u = t / ramp, so ds/dt and its first two derivatives are
    continuous, at both ends of the ramp too; its slope is at most 1.875 / ramp. Before time 0 the
    motion rests at its first point.

    Attributes:
        ramp: [s].
    """

    def __init__(self, ramp: float) -> None:
        """Take the ramp [s].

        Raises:
            InputError: it is not positive.
        """
        self.ramp = positive(ramp, "ramp", error=InputError)

    def __repr__(self) -> str:
        """Return the ramp in words."""
        return f"from rest within {self.ramp:.3g} s"

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        T = self.ramp
        if t >= T:
            return t - 0.5 * T, 1.0, 0.0
        if t <= 0.0:
            return 0.0, 0.0, 0.0
        u = t / T
        square = u * u
        cube, rest = square * u, 1.0 - u
        s = T * cube * u * (2.5 - 3.0 * u + square)
        return s, cube * (10.0 - 15.0 * u + 6.0 * square), 30.0 * square * rest * rest / T

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s]."""
        T = self.ramp
        if s >= 0.5 * T:
            return s + 0.5 * T
        early, late = 0.0, T
        while late - early > 1e-12 * T:
            middle = 0.5 * (early + late)
            early, late = (middle, late) if self.at(middle)[0] <= s else (early, middle)
        return early

    def repeats(self, since: float, period: float) -> tuple[float, float]:
        """Return the later one of the ramp's end and of ``since``, and the same period [s]."""
        return max(self.ramp, self.when(since)), period


class SlowedTime(TimeLaw):
    """s = t / slowness: the motion as it is, but slower all along.

    Attributes:
        slowness: factor on all times, at least 1.
    """

    def __init__(self, slowness: float) -> None:
        """Take the factor.

        Raises:
            InputError: it is below 1.
        """
        self.slowness = positive(slowness, "slowness", error=InputError)
        if self.slowness < 1.0:
            raise InputError(f"must be at least 1, got {slowness}.", where="slowness")

    def __repr__(self) -> str:
        """Return the factor in words."""
        return f"slower by {self.slowness:.3g}"

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        return t / self.slowness, 1.0 / self.slowness, 0.0

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s]."""
        return s * self.slowness

    def repeats(self, since: float, period: float) -> tuple[float, float]:
        """Return both times [s] in the slower time."""
        return since * self.slowness, period * self.slowness
