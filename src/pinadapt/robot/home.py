"""A starting configuration away from singularities, where none is given."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pinocchio as pin

from ..description.chain import (
    angles_from_configuration,
    configuration_from_angles,
    position_bounds,
    position_limits,
    reach,
)
from ..exceptions import RobotError
from ..tasks.frame import FrameTask
from ..tasks.registry import JOINT, task_named
from ..tasks.task import Task

_NEARLY = 0.6  # of the best smallest singular value
_DEGENERATE = 1e-6  # smallest over largest singular value of the task Jacobian
_OFF_LIMITS, _FAR_OFF = 0.05, 0.2  # parts of a joint's range
_SAMPLES, _REFINEMENTS = 500, (0.2, 0.1, 0.05)
_DIGITS = 4  # of a searched home [rad or m], so that it can be read and written


def conditioning(
    model: pin.Model, data: pin.Data, frame: int, rows: slice, q: np.ndarray
) -> tuple[float, float]:
    """Return the task Jacobian's smallest singular value at q, and its ratio to the largest."""
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[rows]
    singular = np.linalg.svd(J, compute_uv=False)
    return float(singular[-1]), float(singular[-1] / max(singular[0], np.finfo(float).tiny))


def find_home(
    model: pin.Model,
    frame: int,
    rows: slice,
    candidates: Iterable[np.ndarray],
    plane: MountingPlane | None = None,
) -> np.ndarray:
    """Return the first well-conditioned candidate (nq) off the limits, or the best pose.

    The best pose found among seeded samples inside the limits, and samples around the best of them,
    has the largest smallest singular value of the task Jacobian times how far it is from the
    limits, up to a fifth of each joint's range. A candidate needs three fifths of its singular
    value and a twentieth of each range. All keep off the plane where the chain can.

    Args:
        model: of the chain.
        frame: the task frame.
        rows: of its Jacobian that the task takes.
        candidates: (nq) taken if they will do, in this order.
        plane: that the chain is mounted on, or None.

    Raises:
        RobotError: the task Jacobian is degenerate in all of them.
    """
    data, limits = model.createData(), position_limits(model)
    rng = np.random.default_rng(0)
    samples = _samples(model, rng)
    configurations = [configuration_from_angles(model, sample) for sample in samples]
    room = -np.inf if plane is None else plane.room(model, frame, configurations)

    def off_plane(q: np.ndarray) -> bool:
        return plane is None or plane.distance(model, data, frame, q) >= room

    def quality(angles: np.ndarray) -> float:
        """Return the smallest singular value of the Jacobian at angles (nv), less near a limit."""
        q = configuration_from_angles(model, angles)
        if not off_plane(q):
            return 0.0
        return conditioning(model, data, frame, rows, q)[0] * min(
            1.0, _margin(limits, angles) / _FAR_OFF
        )

    best = _refined(model, rng, max(samples, key=quality), quality)
    home = configuration_from_angles(model, np.round(best, _DIGITS))
    singular, ratio = conditioning(model, data, frame, rows, home)
    if ratio < _DEGENERATE:
        raise RobotError(
            f"the chain to frame '{model.frames[frame].name}' cannot move all coordinates of the "
            "task in any posture.",
            where="task",
            hint="Take another task, or a frame further out; where there is none, give the "
            "description a link there.",
        )
    for q in candidates:
        off_limits = _margin(limits, angles_from_configuration(model, q)) >= _OFF_LIMITS
        if (
            off_limits
            and off_plane(q)
            and conditioning(model, data, frame, rows, q)[0] >= _NEARLY * singular
        ):
            return np.asarray(q)
    return home


def home_inside_limits(model: pin.Model, candidates: Iterable[np.ndarray]) -> np.ndarray:
    """Return the first candidate (nq) inside the joint limits, or the middle between them."""
    limits = position_limits(model)
    for q in candidates:
        if _margin(limits, angles_from_configuration(model, q)) >= 0.0:
            return np.asarray(q)
    return configuration_from_angles(model, np.mean(position_bounds(model), axis=0))


def _inner(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and half width (nv) of four fifths of the bounds."""
    lower, upper = position_bounds(model)
    return (lower + upper) / 2, 0.8 * (upper - lower) / 2


def _samples(model: pin.Model, rng: np.random.Generator) -> np.ndarray:
    """Return seeded samples of the angles (., nv) inside four fifths of the bounds."""
    middle, half = _inner(model)
    return np.asarray(middle + half * rng.uniform(-1.0, 1.0, (_SAMPLES, model.nv)))


def _refined(
    model: pin.Model,
    rng: np.random.Generator,
    best: np.ndarray,
    quality: Callable[[np.ndarray], float],
) -> np.ndarray:
    """Return the angles (nv) of highest quality among the best until now and samples around it."""
    middle, half = _inner(model)
    for size in _REFINEMENTS:
        around = best + size * half * rng.standard_normal((_SAMPLES // 10, model.nv))
        best = max([best, *np.clip(around, middle - half, middle + half)], key=quality)
    return np.asarray(best)


def _margin(limits: tuple[np.ndarray, np.ndarray], angles: np.ndarray) -> float:
    """Return the distance to the nearest limit, in parts of that joint's range; inf for none."""
    lower, upper = limits
    limited = np.isfinite(lower)
    low, high, at = lower[limited], upper[limited], angles[limited]
    return float(np.min(np.minimum(at - low, high - at) / (high - low), initial=np.inf))


_ROOM = 0.05  # of the reach, between the plane and every joint
_HEIGHT_SAMPLES, _STILL = (
    10,
    1e-6,
)  # poses that tell what moves up and down, and by how much [m] at least


@dataclass(frozen=True)
class MountingPlane:
    """The horizontal plane (xy of the root) through the link that carries a chain's first joint.

    Arms stand on it, legs and arms on a ceiling hang from it: the chain belongs on the side on
    which its description shows it.

    Attributes:
        level: its height above the root [m].
        side: 1 for a chain above it, -1 for one below.
        movable: which of the second joint, those after it and the frame change their height.
    """

    level: float
    side: float
    movable: tuple[int, ...]

    @classmethod
    def of(cls, model: pin.Model, frame: int, shown: np.ndarray) -> MountingPlane | None:
        """Return that of a chain to a frame, as the configuration ``shown`` (nq) has it.

        None where all of the chain moves horizontally.
        """
        data, rng = model.createData(), np.random.default_rng(0)
        samples = rng.uniform(-1.0, 1.0, (_HEIGHT_SAMPLES, model.nv))
        heights = [
            _heights(model, data, frame, configuration_from_angles(model, s)) for s in samples
        ]
        movable = np.flatnonzero(np.ptp(heights, axis=0) > _STILL)
        if not movable.size:
            return None
        level = _level(model)
        above = np.mean(_heights(model, data, frame, shown)[movable]) > level - _STILL
        return cls(level, 1.0 if above else -1.0, tuple(movable.tolist()))

    def distance(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> float:
        """Return how far [m] the chain stays from the plane at q (nq); negative beyond it."""
        heights = _heights(model, data, frame, q)[list(self.movable)]
        return float(np.min(self.side * (heights - self.level)))

    def room(self, model: pin.Model, frame: int, configurations: Iterable[np.ndarray]) -> float:
        """Return the distance [m] to be kept: a twentieth of the reach, less where there is less.

        Where none of the configurations (nq) is on the right side it is minus infinity.
        """
        data = model.createData()
        most = max(self.distance(model, data, frame, q) for q in configurations)
        return min(_ROOM * reach(model, frame), most / 2) if most > 0.0 else -np.inf


def _heights(model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
    """Return the heights above the root [m] of the second joint, those after it and the frame."""
    pin.forwardKinematics(model, data, q)
    placements = [*data.oMi[2:], pin.updateFramePlacement(model, data, frame)]
    return np.array([placement.translation[2] for placement in placements])


def _level(model: pin.Model) -> float:
    """Return the height of the origin of the link that carries the first joint [m]."""
    for frame in model.frames:
        if frame.type == pin.FrameType.JOINT and frame.parentJoint == 1:
            return float(model.frames[frame.parentFrame].placement.translation[2])
    return 0.0


Made = TypeVar("Made")

_LARGEST = "xyz"
_PLANES = ("xy", "xz", "yz")
_MOST_TRIED = 8  # ends of chains


def choose_frames(model: pin.Model, ends: Sequence[str], task: str | None) -> list[str]:
    """Return the task frames to be tried, the likeliest first: ends of chains, see ``end_links``.

    For a task of the joints it is the model's last frame where no chain of two joints ends.

    Raises:
        RobotError: no end for a task of the frame.
    """
    if ends:
        return list(ends[:_MOST_TRIED])
    if task == JOINT:
        return [str(model.frames[-1].name)]
    raise RobotError(
        "no link is moved by two independent joints or more.",
        where=str(model.name),
        hint='Name a frame, or take task = "joint".',
    )


def first_able(frames: Sequence[str], make: Callable[[str], Made]) -> Made:
    """Return what is made of the first of the frames whose chain is able to do the task.

    Raises:
        RobotError: of the first frame, where none is able; any other one at once.
    """
    refused: list[RobotError] = []
    for frame in frames:
        try:
            return make(frame)
        except RobotError as error:
            if error.where != "task":
                raise
            refused.append(error)
    raise refused[0]


def choose_task(
    model: pin.Model,
    frame: int,
    task: str | None,
    poses: Sequence[np.ndarray],
    plane: MountingPlane | None,
) -> tuple[Task, np.ndarray]:
    """Return the task and a home pose (nq) for it.

    Without a name the task is "xyz", or the best conditioned plane where the chain cannot do that.

    Args:
        model: of the chain.
        frame: the task frame.
        task: its name, or None.
        poses: (nq) the description's own, taken as home if they suit.
        plane: which the home pose stays off, or None.

    Raises:
        RobotError: unknown task, too few joints, or a degenerate task Jacobian.
    """
    if task is not None:
        return _with_home(model, frame, task, poses, plane)
    found, refused = [], None
    for name in (_LARGEST, *_PLANES):
        try:
            found.append(_with_home(model, frame, name, poses, plane))
        except RobotError as error:
            refused = error
        if name == _LARGEST and found:
            return found[0]
    if not found:
        assert refused is not None  # one way or the other
        raise refused
    return max(found, key=lambda both: _conditioning(model, frame, *both))


def _with_home(
    model: pin.Model,
    frame: int,
    name: str,
    poses: Sequence[np.ndarray],
    plane: MountingPlane | None,
) -> tuple[Task, np.ndarray]:
    task = task_named(name, model)
    if model.nv < task.size:
        raise RobotError(
            f"task '{name}' has {task.size} coordinates, the chain to "
            f"'{model.frames[frame].name}' only {model.nv} joints.",
            where="task",
            hint="Take a frame further out, or a smaller task.",
        )
    if isinstance(task, FrameTask):
        return task, find_home(model, frame, task.rows, poses, plane)
    return task, home_inside_limits(model, poses)


def _conditioning(model: pin.Model, frame: int, task: Task, home: np.ndarray) -> float:
    assert isinstance(task, FrameTask)  # a plane
    return conditioning(model, model.createData(), frame, task.rows, home)[1]
