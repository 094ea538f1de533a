"""Motions as users give them: objects with ``at``, functions of time, samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import arithmetic, numbers, shown, vector
from ..exceptions import InputError
from ..records import Desired
from ..tasks.task import JointTask, Moving, Task
from .trajectory import Hold, Piecewise, Trajectory, motion_failed

Difference: TypeAlias = Callable[[np.ndarray, np.ndarray], Any]
"""How far (m) coordinates x are from others x_0: ``Task.error``, x - x_0 for vectors."""

# of a difference formula: velocities of 20 rad/s are off by 1e-7; 3: 3e-4, 9: 1e-13, with twice the
# calls
_NODES = 5
STEP = 2e-3  # [s]; half or twice of it: errors less or more by 16, rounding and noise by 1/4


class Function(Trajectory):
    """x_d = f(t) for a function f that returns x_d, or x_d and its two derivatives.

    If f returns x_d alone, velocity and acceleration are five-point differences with a step of h =
    2 ms. f is called at t and at four more times within 2 h of it; near time 0 within 4 h after it,
    as f is never called before time 0. f must have two continuous derivatives. Relative errors for
    a sine, with respect to the amplitudes of velocity and acceleration::

        frequency    velocity, acceleration    in the first 4 ms
        1 Hz         9e-10, 3e-10              5e-9, 2e-6
        5 Hz         6e-7, 2e-7                4e-6, 3e-4
        20 Hz        2e-4, 5e-5                1e-3, 2e-2

    They grow with h^4, for the acceleration in the first 4 ms with h^3. Noise of f is multiplied by
    up to 1.5/h in the velocity and 5.4/h^2 in the acceleration, 27/h^2 in the first 4 ms. Rounding
    of numbers near 1 gives less than 2e-9 m/s^2, but noise of 1e-9 m gives 1.3e-3 m/s^2. For a
    noisy f take samples of it in a ``Spline``. A function that returns the derivatives too is not
    differentiated, and called once.
    """

    def __init__(self, f: Callable[[float], Any], difference: Difference = np.subtract) -> None:
        """Take the function.

        Args:
            f: t [s] -> x_d, or (x_d, xd_d, xdd_d), or ``Desired``; a pose may be a ``pin.SE3``.
            difference: (x, x_0) -> (m), how far x is from x_0; ``Task.error`` of a task.
        """
        self._f = f
        self._difference = difference

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s].

        Raises:
            InputError: the function returned no coordinates, or a varying number of them.
        """
        x_d, *derivatives = self._called(t)
        return Desired(x_d, *(derivatives or self._differences(t, x_d)))

    def _differences(self, t: float, x_d: np.ndarray) -> Moving:
        """Return the first two derivatives (m) at t of the polynomial through the nodes."""
        before = min(_NODES // 2, int(max(t, 0.0) / STEP))
        others = np.array([k for k in range(-before, _NODES - before) if k])
        times = [t + k * STEP for k in others.tolist()]
        away = [self._difference(self._called(time, x_d.size)[0], x_d) for time in times]
        c = np.linalg.solve(np.vander(others, _NODES, increasing=True)[:, 1:], away)
        return c[0] / STEP, 2.0 * c[1] / STEP**2

    def _called(self, t: float, size: int | None = None) -> list[np.ndarray]:
        """Return what the function returns at t [s], x_d of this size.

        Raises:
            InputError: as ``at``.
        """
        found = _coordinates(self._f(t), t)
        if size not in (None, found[0].size):
            raise InputError(
                f"{found[0].size} coordinates at t = {t:g} s, {size} before.", where="trajectory"
            )
        return found


def _coordinates(value: Any, t: float) -> list[np.ndarray]:
    """Return [x_d] or [x_d, xd_d, xdd_d] of what a function returned at t [s], as new arrays.

    Raises:
        InputError: it is neither.
    """
    several = isinstance(value, tuple | list | np.ndarray) and len(value) == 3
    if not (several and (np.ndim(value[0]) == 1 or isinstance(value[0], pin.SE3))):
        value = (value,)
    try:
        return [
            pin.SE3ToXYZQUAT(part)
            if isinstance(part, pin.SE3)
            else vector(part, None, "trajectory")
            for part in value
        ]
    except InputError as error:
        raise InputError(
            f"expected coordinates x_d or (x_d, xd_d, xdd_d) at t = {t:g} s; {error.what}",
            where="trajectory",
        ) from error


class Spline(Piecewise):
    """The spline of degree five through positions at given times; four continuous derivatives.

    Before the first time and after the last one the motion rests at the first and last position;
    velocity and acceleration are zero at both ends, so they are continuous there. Through two
    positions this is the minimum-jerk motion.

    Attributes:
        t: (N) times [s].
        x: (N, m) positions [m or rad].
    """

    def __init__(self, t: ArrayLike, x: ArrayLike) -> None:
        """Take times and positions.

        Args:
            t: (N) increasing times [s], N >= 2.
            x: (N, m) or, of one coordinate, (N) positions [m or rad].

        Raises:
            InputError: sizes that do not match, numbers that are not finite, times that do not
                increase, or too few samples.
        """
        t = numbers(t, "trajectory.t")
        x = numbers(x, "trajectory.x")
        x = x[:, None] if x.ndim == 1 else x
        if t.ndim != 1 or x.ndim != 2 or len(t) != len(x) or len(t) < 2:
            raise InputError(
                "expected N times [s] and N rows of positions, N >= 2, got shapes "
                f"{(t.shape, x.shape)}.",
                where="trajectory",
            )
        if (np.diff(t) <= 0.0).any():
            raise InputError(
                "times must increase; sort the samples, and keep one of each time.",
                where="trajectory.t",
            )
        from scipy.interpolate import make_interp_spline  # not needed to load a robot

        still = [(order, np.zeros(x.shape[1])) for order in (1, 2)]
        with arithmetic("trajectory.t"):
            super().__init__(t, x, make_interp_spline(t, x, 5, bc_type=(still, still)))


def _quaternion_spline(t: ArrayLike, x: ArrayLike) -> Callable[[float], np.ndarray]:
    """Return a function through positions (N, m) that end in a quaternion xyzw, of length 1.

    Quaternions are interpolated as four numbers, after their signs are made consistent, and divided
    by their length. The orientation passes through every sample and is as smooth as the position.

    Raises:
        InputError: quaternions of another length, by more than 1 %, or as of ``Spline``.
    """
    x = numbers(x, "trajectory.x")
    q = x[:, -4:] if x.ndim == 2 else x
    if q.shape[1:] != (4,) or (np.abs(np.linalg.norm(q, axis=1) - 1.0) > 0.01).any():
        raise InputError(
            "expected positions that end in a quaternion xyzw of length 1.", where="trajectory.x"
        )
    opposite = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0
    q[1:] *= np.where(np.cumsum(opposite) % 2, -1.0, 1.0)[:, None]
    spline = Spline(t, x)

    def unit(t: float) -> np.ndarray:
        """Return the coordinates (m) at time t [s]."""
        x_d = spline.at(t).x_d
        x_d[-4:] /= np.linalg.norm(x_d[-4:])
        return x_d

    return unit


TrajectoryLike: TypeAlias = (
    Trajectory | Callable[[float], Any] | tuple[ArrayLike, ArrayLike] | np.ndarray
)
"""What ``as_trajectory`` takes, besides objects with ``at(t)``."""


def as_trajectory(given: TrajectoryLike, task: Task | None = None) -> Trajectory:
    """Return a user's motion as a ``Trajectory``; its value at time 0 is checked.

    Args:
        given: a ``Trajectory``, as it is; any object with ``at(t)``, or a function of t [s], that
            returns x_d, or (x_d, xd_d, xdd_d), see ``Function``; times (N) [s] and positions
            (N, m) as a pair, or as one array (N, 1 + m) with the times first, see ``Spline``.
        task: the task of these coordinates. Samples of a continuous joint that are all within a
            turn, as recorded ones are, go the shorter way to the next; coordinates of a pose are
            position and quaternion xyzw (7), and a function may return ``pin.SE3`` instead. None:
            plain vectors.

    Raises:
        InputError: another kind of object, a wrong number of coordinates, numbers that are not
            finite, or times that do not increase.
    """
    if task is None:
        motion = converted(given)
    else:
        turning = task.continuous if isinstance(task, JointTask) else ()
        motion = converted(given, task.error, task.coordinates == task.size + 1, turning)
        if isinstance(motion, Hold):
            motion = motion.with_rows(task.size)
    _check_start(motion, task)
    return motion


def converted(
    given: Any,
    difference: Difference = np.subtract,
    quaternion: bool = False,
    turning: tuple[bool, ...] = (),
) -> Trajectory:
    """Return a user's motion as a ``Trajectory``, without a check of its start.

    Args:
        given: as in ``as_trajectory``.
        difference: (x, x_0) -> (m), how far coordinates are from others.
        quaternion: whether the last four coordinates are a quaternion.
        turning: for each coordinate, whether it is the angle of a continuous joint.

    Raises:
        InputError: another kind of object, or samples that do not make a spline.
    """
    if isinstance(given, Trajectory):
        return given
    function = getattr(given, "at", given)
    if callable(function) and not isinstance(given, type):
        return Function(function, difference)
    if isinstance(given, np.ndarray) and given.ndim == 2:
        given = given[:, 0], given[:, 1:]
    if not isinstance(given, tuple) or len(given) != 2:
        raise InputError(
            f"expected a trajectory, got {shown(given)}.",
            where="trajectory",
            hint="Give an object with at(t), a function t -> x_d, or a pair (t, x) of times and "
            "positions; Hold(x_d) stays at a point.",
        )
    t, x = given
    if any(turning) and np.shape(x)[1:] == (len(turning),):
        recorded = turning & (np.ptp(x, axis=0) < 2.0 * np.pi)
        x = np.where(recorded, np.unwrap(x, axis=0), x)
    if quaternion:
        return Function(_quaternion_spline(t, x), difference)
    return Spline(t, x)


def _check_start(motion: Trajectory, task: Task | None) -> None:
    """Check that the start of a motion suits the task.

    Raises:
        InputError: ``at`` fails or returns no ``Desired``, another number of coordinates than the
            task's, numbers that are not finite, or no unit quaternion.
    """
    try:
        start = motion.at(0.0)
        sizes: Any = (None,) * 3
        if task is not None:
            sizes = task.coordinates, task.size, task.size
            if np.size(start.x_d) != task.coordinates:
                raise InputError(
                    f"the desired motion has {np.size(start.x_d)} coordinates, the task "
                    f"'{task.name}' {task.coordinates}.",
                    where="trajectory",
                )
            if np.size(start.xd_d) == task.coordinates != task.size:
                raise InputError(
                    f"velocities of the task '{task.name}' have {task.size} numbers.",
                    where="trajectory.xd_d",
                    hint="Motions of poses: PoseTrajectory(position, orientation), or (t, x).",
                )
        for name, size in zip(Desired._fields, sizes, strict=True):
            value = vector(getattr(start, name), size, f"trajectory.{name}", fills=False)
            if name == "x_d" and task is not None and (flaw := task.flaw(value)):
                raise InputError(f"the desired motion {flaw} at time 0.", where="trajectory.x_d")
    except InputError:
        raise
    except Exception as reason:
        raise motion_failed(0.0, reason) from reason
