"""What was seen of the task frame, as the task has it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..exceptions import LogError
from ..logs.log import Log
from ..robot.robot import Robot

_POSITION, _POSE = 3, 7
_WIDE = 4.0  # of the reach, which no frame of the robot spans


class Frames(NamedTuple):
    """M frames of a camera or tracker.

    Attributes:
        t: (M) when they were taken [s], ascending.
        x: (M, m) coordinates of the task.
    """

    t: np.ndarray
    x: np.ndarray


def frames_of(log: Log, robot: Robot) -> Frames:
    """Return the frames of a log for the task of a robot; none where it has none.

    Raises:
        LogError: coordinates that the task does not have, or further apart than it can move.
    """
    t, x = log.frames()
    if not len(t):
        return Frames(np.zeros(0), np.zeros((0, robot.task.coordinates)))
    wanted, got = robot.task.coordinates, x.shape[1]
    if got != wanted and wanted <= _POSITION and got in (_POSITION, _POSE):
        x = x[:, :_POSITION][:, robot.frame_task.place]
    elif got != wanted:
        raise LogError(
            f"{got} coordinates, and the task '{robot.task.name}' has {wanted}.",
            where=f"{log.source}: x",
            hint="Positions are x, y, z in world axes, poses x, y, z, qx, qy, qz, qw; a robot is "
            'loaded with task = "xyz" or "pose".',
        )
    span = float(np.ptp(x[:, : robot.task.positions], axis=0).max(initial=0.0))
    if span > _WIDE * robot.reach:
        raise LogError(
            f"the frame moves by {span:.4g} m, and the robot reaches {robot.reach:.3g} m.",
            where=f"{log.source}: x",
            hint="Positions are in metres. In millimetres? A tracker's lost frames are NaN, not 0.",
        )
    order = np.argsort(t, kind="stable")
    return Frames(t[order], x[order])
