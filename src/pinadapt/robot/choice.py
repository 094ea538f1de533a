"""What is chosen of a robot where its user does not say: frame, task and home pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from ..tasks.registry import JOINT, task_named
from ..tasks.task import FrameTask, Task
from .home import conditioning, find_home, home_inside_limits
from .mounting import MountingPlane

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
