"""The tasks by name."""

from __future__ import annotations

from ..exceptions import RobotError, did_you_mean
from .pose import PoseTask
from .position import PositionTask
from .task import FrameTask


def _positions(name: str, rows: slice) -> FrameTask:
    return PositionTask(name, tuple(name), rows, rows)


TASKS: dict[str, FrameTask] = {
    "xy": _positions("xy", slice(0, 2)),
    "xz": _positions("xz", slice(0, 3, 2)),
    "yz": _positions("yz", slice(1, 3)),
    "xyz": _positions("xyz", slice(0, 3)),
    "pose": PoseTask("pose", ("x", "y", "z", "phi_x", "phi_y", "phi_z"), slice(0, 6), slice(0, 3)),
}


def task_named(name: str) -> FrameTask:
    """Return a task by its name.

    Raises:
        RobotError: unknown name.
    """
    if name not in TASKS:
        raise RobotError(
            f"no task is called '{name}'; there are {sorted(TASKS)}.{did_you_mean(name, TASKS)}",
            where="task",
        )
    return TASKS[name]
