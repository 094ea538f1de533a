"""What a reader of a format is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

SIGNALS = ("t", "q", "v", "tau", "x", "x_time")


@dataclass(frozen=True)
class Wanted:
    """Whose motion is wanted, and where in a file it is.

    Attributes:
        joints: names of the robot's joints.
        columns: signal -> names of its columns, or one with a ``*`` for each joint's name or index.
        topic: of the joint states of a bag; None: the only one there is.
        pose_topic: of the frame's pose in a bag; None: none.
    """

    joints: Sequence[str]
    columns: Mapping[str, Sequence[str]] = field(default_factory=dict)
    topic: str | None = None
    pose_topic: str | None = None
