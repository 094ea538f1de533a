"""Conversion of users' motions to a ``Trajectory``, and their check before a run."""

from __future__ import annotations

from collections.abc import Callable
from numbers import Real
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .._checks import shown
from ..exceptions import InputError
from ..records import Desired
from ..tasks.joint import JointTask
from ..tasks.task import Task
from .function import Difference, Function
from .spline import Spline
from .trajectory import Trajectory


class HasAt(Protocol):
    """An object with ``at(t)``, which returns x_d, or x_d with its two derivatives."""

    def at(self, t: float) -> Any:
        """Return x_d, or (x_d, xd_d, xdd_d), at time t [s]."""


TrajectoryLike: TypeAlias = (
    Trajectory | HasAt | Callable[[float], Any] | tuple[ArrayLike, ArrayLike] | np.ndarray
)
"""Whatever ``as_trajectory`` takes."""


def as_trajectory(given: TrajectoryLike, task: Task | None = None) -> Trajectory:
    """Return a user's motion as a ``Trajectory``; its value at time 0 is checked.

    Args:
        given: a ``Trajectory``, as it is; any object with ``at(t)``, or a function of t [s], that
            returns x_d, or (x_d, xd_d, xdd_d), see ``Function``; times (N) [s] and positions
            (N, m) as a pair, or as one array (N, 1 + m) with the times first, see ``Spline``.
        task: the task of these coordinates. Angles of continuous joints may jump by whole turns;
            coordinates of a pose are position and quaternion xyzw (7), and a function may return
            ``pin.SE3`` instead. None: plain vectors.

    Raises:
        InputError: another kind of object, a wrong number of coordinates, numbers that are not
            finite, or times that do not increase.
    """
    if isinstance(given, Trajectory):
        motion = given
    elif task is None:
        motion = converted(given)
    else:
        motion = converted(given, _difference(task), task.coordinates > task.size, _turns(task))
    _check_start(motion, task)
    return motion


def converted(
    given: Any,
    difference: Difference = np.subtract,
    quaternion: bool = False,
    turning: tuple[bool, ...] = (),
) -> Trajectory:
    """Return a motion that is not yet a ``Trajectory`` as one, without a check of its start.

    Args:
        given: as in ``as_trajectory``.
        difference: (x, x_0) -> (m), how far coordinates are from others.
        quaternion: whether the last four coordinates are a quaternion.
        turning: for each coordinate, whether it is the angle of a continuous joint.

    Raises:
        InputError: another kind of object, or samples that do not make a spline.
    """
    if not isinstance(given, type):
        if callable(at := getattr(given, "at", None)):
            extent, settles = (_number(given, name) for name in ("extent", "settles"))
            return Function(at, difference=difference, extent=extent, settles=settles)
        if callable(given):
            return Function(given, difference=difference)
    if isinstance(given, tuple) and len(given) == 2:
        t, x = given
    elif isinstance(given, np.ndarray) and given.ndim == 2:
        t, x = given[:, 0], given[:, 1:]
    else:
        raise InputError(
            f"expected a trajectory, got {shown(given)}.", where="trajectory", hint=_hint(given)
        )
    if any(turning):
        x = np.array(x, dtype=float)
        endless = [k for k, turns in enumerate(turning) if turns and x.ndim == 2 and k < x.shape[1]]
        x[:, endless] = np.unwrap(x[:, endless], axis=0)
    return Spline(t, x, quaternion=quaternion)


def _difference(task: Task) -> Difference:
    """Return ``task.error``, or plain differences for vectors of another size.

    The check of the start then refuses that size with a clear message.
    """
    return lambda x, x_0: task.error(x, x_0) if x.size == task.coordinates else x - x_0


def _turns(task: Task) -> tuple[bool, ...]:
    return task.continuous if isinstance(task, JointTask) else ()


def _number(given: Any, name: str) -> float | None:
    """Return an attribute if it is a number, else None."""
    value = getattr(given, name, None)
    return float(value) if isinstance(value, Real) else None


def _hint(given: Any) -> str:
    if isinstance(given, type):
        return f"This is the class {given.__name__}; give an object of it."
    if isinstance(given, Desired) or (isinstance(given, np.ndarray) and given.ndim == 1):
        return "Hold(x_d) stays at a point."
    return (
        "Give an object with at(t), a function t -> x_d, or a pair (t, x) of times and positions."
    )


def _check_start(motion: Trajectory, task: Task | None) -> None:
    """Check that the start of a motion suits the task.

    Raises:
        InputError: ``at`` fails or returns no ``Desired``, another number of coordinates than the
            task's, numbers that are not finite, or no unit quaternion.
    """
    try:
        start = motion.at(0.0)
    except InputError:
        raise
    except Exception as reason:
        raise InputError(
            f"the desired motion failed at time 0: {type(reason).__name__}: {reason}",
            where="trajectory",
            hint="It must be callable with one argument, the time in s.",
        ) from reason
    if not isinstance(start, Desired):
        raise InputError(
            f"at(0.0) of {type(motion).__name__} returned {shown(start)} instead of a Desired.",
            where="trajectory",
            hint="Return Desired(x_d, xd_d, xdd_d).",
        )
    sizes = [np.size(part) for part in start]
    if task is not None and sizes[0] != task.coordinates:
        raise InputError(
            f"the desired motion has {sizes[0]} coordinates, the task '{task.name}' "
            f"{task.coordinates}.",
            where="trajectory",
            hint="PoseTrajectory adds an orientation to a motion of three coordinates."
            if (sizes[0], task.name) == (3, "pose")
            else None,
        )
    rows = sizes[0] if task is None else task.size
    names = ("x_d", "xd_d", "xdd_d")
    for name, part, size in zip(names, start, sizes, strict=True):
        if name != "x_d" and task is not None and size != rows:
            raise InputError(f"expected {rows} numbers, got {size}.", where=f"trajectory.{name}")
        if not np.isfinite(part).all():
            raise InputError(
                f"the desired motion is not finite at time 0: {part}.", where=f"trajectory.{name}"
            )
        if name == "x_d" and task is not None and (flaw := task.flaw(part)):
            raise InputError(f"the desired motion {flaw} at time 0.", where="trajectory.x_d")
