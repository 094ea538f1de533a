"""Desired motions: coordinates with their first two derivatives at any time, and time laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import flag, instance, numbers, positive, vector
from ..exceptions import InputError, PinadaptError
from ..records import Desired, Measurement
from ..tasks.frame import rotation_between, turned
from ..tasks.task import Task

if TYPE_CHECKING:
    from scipy.interpolate import BPoly

# [s], of a path whose rate rises, and for how long its start is looked at; at how many instants.
# Half and twice of both: the same runs to 1e-10, but slow motions start in half and twice the time.
LONGEST_RAMP, _LOOKS = 5.0, 250
# Share of its largest speed and acceleration at which a motion starts at rest; half or twice of it
# changes nothing for the motions of this package, which start at rest or at full speed.
_RESTS = 1e-3


def motion_failed(t: float, reason: Exception) -> InputError:
    """Return what to raise for a motion that raised something else at t [s]."""
    return InputError(
        f"the desired motion failed at t = {t:g} s: {type(reason).__name__}: {reason}",
        where="trajectory",
        hint="at(t) must return a Desired, a function of t [s] the coordinates x_d; "
        "pa.trajectories.as_trajectory makes a motion of that, or of samples.",
    )


class Trajectory(ABC):
    """A twice differentiable motion of task coordinates in time.

    A subclass needs ``at`` alone. x_d and its derivatives have m numbers each, or, where x_d ends
    in quaternions xyzw, x_d has one more for each than the velocity: of a pose 7 and 6, of an
    orientation 4 and 3, rotations in world axes.

    ``at`` gives derivatives with respect to its own argument. The same path with another time law
    s(t) is therefore x_d(s(t)), with velocity x_d' ds/dt and acceleration x_d'' (ds/dt)^2 + x_d'
    d^2s/dt^2: ``Retimed``, of which ``from_rest`` is the most frequent case.

    Attributes:
        exact: whether the motion is taken exactly as it is, see ``as_given``.
        extent: radius of a circle, or half the diagonal of the box around another path [m or rad].
            None if the class does not know it; a rollout then measures the path that was run.
        settles: time from which the motion is at rest [s]; None: never, or the class does not know.
    """

    exact: bool = False
    extent: float | None = None
    settles: float | None = None
    _unplaced: Any = None  # if it has no place yet, see ``placed``

    @abstractmethod
    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""

    def __repr__(self) -> str:
        """Return the kind of motion."""
        return type(self).__name__

    def from_rest(self, ramp: float | None = None, *, duration: float | None = None) -> Trajectory:
        """Return the same path, begun at rest: ``Retimed`` by a ``SmoothStart``.

        The path is the same to rounding, and half a ramp later so is the motion. One that starts
        with neither speed nor acceleration (a thousandth of its largest ones) is returned as it is,
        and so is one ``as_given``.

        Args:
            ramp: duration of the start [s]. None: 1.875 times the largest speed of the first five
                seconds over their largest acceleration, but at most 5 s. If less, the slope of the
                rate, at most 1.875 / ramp, asks for no more acceleration than the motion, and both
                together for 1.42 times as much at most; for a circle it is 1.04 times.
            duration: of the run [s]; the motion is not looked at beyond. None: unknown.

        Raises:
            InputError: a ramp that is not positive, as for a motion that is not finite.
        """
        if self.exact:
            return self
        span = LONGEST_RAMP if duration is None else min(LONGEST_RAMP, duration)
        looks = []
        for t in np.linspace(0.0, span, _LOOKS):
            try:
                looks.append(np.linalg.norm(self.at(float(t))[1:], axis=1))
            except PinadaptError:
                raise
            except Exception as reason:  # whatever an object of the user raises
                raise motion_failed(t, reason) from reason
        speeds, rates = np.transpose(looks)
        v = speeds.max()
        a = rates.max()
        if speeds[0] <= _RESTS * v and rates[0] <= _RESTS * a:
            return self
        if ramp is None:
            ramp = LONGEST_RAMP if 1.875 * v > LONGEST_RAMP * a else 1.875 * v / a
        return Retimed(self, SmoothStart(ramp))

    def as_given(self) -> Trajectory:
        """Return the same motion, to be taken exactly as it is.

        ``simulate`` then neither starts it from rest nor lets the robot approach its first point.
        """
        motion = copy(self)
        motion.exact = True
        return motion

    def shifted(self, by: ArrayLike) -> Trajectory:
        """Return the same motion displaced by (m): [m or rad], rotations about world axes [rad]."""
        return _Shifted(self, vector(by, self.at(0.0).xd_d.size, "by"))

    def starting_at(self, start: ArrayLike) -> Trajectory:
        """Return the same motion displaced so that its coordinates are ``start`` at time 0.

        Raises:
            InputError: ``start`` has another number of coordinates than x_d, or is not finite.
        """
        here, speed, _ = self.at(0.0)
        start = vector(start, here.size, "start")
        n = _vector_rows(here, speed)
        turns = map(rotation_between, start[n:].reshape(-1, 4), here[n:].reshape(-1, 4))
        return self.shifted(np.append(start[:n] - here[:n], [*turns]))

    def placed(self, start: np.ndarray) -> Trajectory:
        """Return the motion that begins where the robot is, ``start``, if it has no place yet."""
        if not self._unplaced or start.size != self.at(0.0).x_d.size:
            return self  # a check of the start refuses a motion of another size
        return self.starting_at(start)

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return the coordinates x_d, one row for each of the times (N) [s], N >= 1."""
        return np.stack([self.at(float(t)).x_d for t in times])


def _vector_rows(x_d: np.ndarray, xd_d: np.ndarray) -> int:
    """Return the number of coordinates x_d before the quaternions, given the velocity as well."""
    return 4 * xd_d.size - 3 * x_d.size


class Derived(Trajectory):
    """A motion made of another one; its extent and rest are those of the other.

    Attributes:
        motion: the other one.
    """

    def __init__(self, motion: Trajectory) -> None:
        """Take the other motion."""
        self.motion = motion
        self.extent = motion.extent
        self.settles = motion.settles


class _Shifted(Derived):
    """A motion displaced by a constant."""

    def __init__(self, motion: Trajectory, by: np.ndarray) -> None:
        super().__init__(motion)
        self._by = by
        self.exact = motion.exact

    def __repr__(self) -> str:
        """Return the kind of the motion that is displaced."""
        return repr(self.motion)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        x_d, *rates = self.motion.at(t)
        n = _vector_rows(x_d, rates[0])
        turns = self._by[n:].reshape(-1, 3)
        x = [x_d[:n] + self._by[:n], *map(turned, x_d[n:].reshape(-1, 4), turns)]
        R = [pin.exp3(turn) for turn in turns]
        moved = ([rate[:n], *map(np.matmul, R, rate[n:].reshape(-1, 3))] for rate in rates)
        return Desired(*map(np.concatenate, [x, *moved]))


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
        super().__init__(instance(motion, Trajectory, "motion"))
        self.law = instance(law, TimeLaw, "law")
        if self.settles is not None:  # when its path is
            self.settles = law.when(self.settles)

    def __repr__(self) -> str:
        """Return the motion and what its time law does."""
        return f"{self.motion!r}, {self.law!r}"

    def placed(self, start: np.ndarray) -> Retimed:
        """Return the same time law along the placed motion."""
        return Retimed(self.motion.placed(start), self.law)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        s, rate, acceleration = self.law.at(t)
        return self.motion.at(s).at_rate(rate, acceleration)


class Hold(Trajectory):
    """Rest at a fixed point, for set-point control.

    Attributes:
        point: (m) [m or rad].
    """

    extent = settles = 0.0

    def __init__(self, point: ArrayLike | None = None) -> None:
        """Take the point (m) [m or rad]; None: where the robot is at the start.

        Raises:
            InputError: coordinates that are not finite numbers.
        """
        self._unplaced = point is None
        self.point = vector(np.zeros(3) if point is None else point, None, "trajectory.point")
        self._rest = np.zeros(self.point.size)

    @classmethod
    def of(cls, task: Task, measurement: Measurement) -> Hold:
        """Return the rest where a measurement has the robot, a pose with its six velocities."""
        return cls(task.measured(measurement.x, measurement.q)).with_rows(task.size)

    def with_rows(self, size: int) -> Hold:
        """Return the same rest with velocities of so many rows, of a pose 6 for 7 coordinates."""
        made = copy(self)
        made._rest = np.zeros(size)
        return made

    def placed(self, start: np.ndarray) -> Hold:
        """Return the motion that holds ``start``, if it has no point of its own."""
        return Hold(start) if self._unplaced else self

    def at(self, t: float) -> Desired:
        """Return the point, at rest."""
        return Desired(self.point, self._rest, self._rest)


class Piecewise(Trajectory):
    """Polynomials between given times; at rest before the first and after the last.

    Attributes:
        t: (N) the times [s].
        x: (N, m) positions at these [m or rad].
    """

    settles: float

    def __init__(self, t: np.ndarray, x: np.ndarray, path: Callable[..., np.ndarray]) -> None:
        """Take times (N), positions (N, m), and (time, order) -> derivative (m) of this order."""
        self.t, self.x, self.settles, self._path = t, x, float(t[-1]), path
        self.extent = 0.5 * float(np.linalg.norm(np.ptp(x, axis=0)))  # half the diagonal of its box

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]; outside the times at rest."""
        inside = min(max(t, self.t[0]), self.t[-1])
        x_d, xd_d, xdd_d = (self._path(inside, order) for order in range(3))
        moving = 1.0 if inside == t else 0.0
        return Desired(x_d, moving * xd_d, moving * xdd_d)


class Waypoints(Piecewise):
    """Minimum-jerk segments from point to point, at rest in each; the last point is held.

    T. Flash, N. Hogan, *The coordination of arm movements*, J. Neuroscience 1985.

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
        self._unplaced = flag(relative, "trajectory.relative")
        if relative and self.points.ndim == 2:
            self.points = np.vstack([np.zeros(self.points.shape[1]), self.points])
        if self.points.ndim != 2 or len(self.points) < 2:
            raise InputError(
                "expected at least two points of the same number of coordinates.",
                where="trajectory.points",
            )
        self.segment = positive(segment, "trajectory.segment")
        t = self.segment * np.arange(len(self.points))
        super().__init__(t, self.points, moves(self.points, t))


def moves(x: np.ndarray, t: np.ndarray, bumps: ArrayLike = 0.0) -> BPoly:
    """Return minimum-jerk moves through x (N, m) at times t (N), polynomials of degree six.

    In Bernstein's form the first three coefficients are the start and the last three the end, which
    holds velocity and acceleration at zero there. ``bumps`` (N - 1, m) are added in the middle of
    the moves, as 64 (u (1 - u))^3, u from 0 to 1. What does not move has a velocity of exactly
    zero.
    """
    from scipy.interpolate import BPoly  # not needed to load a robot

    start = x[:-1]
    end = x[1:]
    middle = 0.5 * (start + end) + 64.0 / 20.0 * np.asarray(bumps)
    return BPoly(np.array([start, start, start, middle, end, end, end]), t)


def minimum_jerk(u: float) -> tuple[float, float, float]:
    """Return s(u) = 10 u^3 - 15 u^4 + 6 u^5 with its first two derivatives, u from 0 to 1."""
    square = u * u
    rest = 1.0 - u
    s = square * u * (10.0 - 15.0 * u + 6.0 * square)
    return s, 30.0 * square * rest * rest, 60.0 * u * rest * (rest - u)


class TimeLaw(ABC):
    """A path's own time s as a function of time t, twice continuously differentiable for t > 0.

    Along x_d(s(t)) velocity and acceleration are x_d' ds/dt and x_d'' (ds/dt)^2 + x_d' d^2s/dt^2.
    """

    @abstractmethod
    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""

    @abstractmethod
    def when(self, s: float) -> float:
        """Return a time t [s] from which the path's time is s [s] or later."""


class SmoothStart(TimeLaw):
    """The rate ds/dt rises from 0 to 1 within a ramp, and s = t - ramp / 2 afterwards.

    The rate is ``minimum_jerk`` of t / ramp, so it and its first two derivatives are continuous, at
    both ends of the ramp too. Before time 0 the motion rests at its first point.

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
        u = max(t, 0.0) / T
        rate, slope, _ = minimum_jerk(u)
        return T * u**4 * (2.5 - 3.0 * u + u * u), rate, slope / T

    def when(self, s: float) -> float:
        """Return a time t [s], after the ramp, from which the path's time is s [s] or later."""
        return max(s, 0.5 * self.ramp) + 0.5 * self.ramp


class SlowedTime(TimeLaw):
    """s = t / slowness: the motion as it is, but slower all along.

    Attributes:
        slowness: factor on all times.
        cause: what asks for it, in words.
    """

    def __init__(self, slowness: float, cause: str = "as asked") -> None:
        """Take the factor and its cause.

        Raises:
            InputError: it is below 1.
        """
        self.slowness = positive(slowness, "slowness", error=InputError)
        self.cause = cause
        if self.slowness < 1.0:
            raise InputError(f"must be at least 1, got {slowness}.", where="slowness")

    def __repr__(self) -> str:
        """Return how much and why the motion is slower."""
        if self.slowness == 1.0:
            return "not slowed"
        return f"slowed to {100 / self.slowness:.3g} % ({self.cause})"

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        return t / self.slowness, 1.0 / self.slowness, 0.0

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s]."""
        return s * self.slowness
