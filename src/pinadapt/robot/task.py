"""Which coordinates of the frame's motion are controlled."""

from __future__ import annotations

from dataclasses import dataclass

from ..exceptions import RobotError, did_you_mean


@dataclass(frozen=True)
class Task:
    """A choice of rows of the frame's position, in world axes.

    Attributes:
        name: as written in scenarios.
        labels: one name a coordinate.
        rows: selected rows of the position and of the LOCAL_WORLD_ALIGNED linear Jacobian.
    """

    name: str
    labels: tuple[str, ...]
    rows: slice

    @property
    def size(self) -> int:
        """Number of task coordinates m."""
        return len(self.labels)


TASKS = {
    "xy": Task("xy", ("x", "y"), slice(0, 2)),
    "xz": Task("xz", ("x", "z"), slice(0, 3, 2)),
    "yz": Task("yz", ("y", "z"), slice(1, 3)),
    "xyz": Task("xyz", ("x", "y", "z"), slice(0, 3)),
}


def task_named(name: str) -> Task:
    """Return a task by its name.

    Raises:
        RobotError: unknown name.
    """
    if name not in TASKS:
        raise RobotError(f"no task is called '{name}'; there are {sorted(TASKS)}.{did_you_mean(name, TASKS)}", where="task")
    return TASKS[name]
