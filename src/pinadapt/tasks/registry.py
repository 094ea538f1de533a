"""The tasks by name."""

from __future__ import annotations

import pinocchio as pin

from ..exceptions import RobotError, did_you_mean
from .frame import FrameTask, PoseTask, PositionTask
from .joint import JointTask
from .task import Task


def _positions(name: str, rows: slice) -> FrameTask:
    return PositionTask(name, tuple(name), rows, rows)


TASKS: dict[str, FrameTask] = {
    "xy": _positions("xy", slice(0, 2)),
    "xz": _positions("xz", slice(0, 3, 2)),
    "yz": _positions("yz", slice(1, 3)),
    "xyz": _positions("xyz", slice(0, 3)),
    "pose": PoseTask("pose", ("x", "y", "z", "phi_x", "phi_y", "phi_z"), slice(0, 6), slice(0, 3)),
}


JOINT = "joint"


def task_named(name: str, model: pin.Model) -> Task:
    """Return a task of a chain by its name: one of ``TASKS``, or "joint".

    Raises:
        RobotError: unknown name; the message suggests the nearest.
    """
    if name == JOINT:
        return JointTask.of_chain(model)
    if name not in TASKS:
        names = [*TASKS, JOINT]
        raise RobotError(
            f"no task is called '{name}'; choose from {names}.{did_you_mean(name, names)}",
            where="task",
        )
    return TASKS[name]
