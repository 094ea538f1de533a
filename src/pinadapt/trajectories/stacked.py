"""The desired motion of several task frames: one motion of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._checks import instance
from ..exceptions import InputError
from ..records import Desired
from ..tasks.frame import joined, parts_of
from .given import TrajectoryLike, as_trajectory
from .pose import PoseTrajectory
from .trajectory import Trajectory


class Stacked(Trajectory):
    """One motion of each task frame, in the order of the frames, as one of all their coordinates.

    x_d has the positions of all frames, then, for poses, their quaternions, as
    ``tasks.FrameTask`` has them; velocities and accelerations have the linear parts first.

    Attributes:
        motions: those of the frames.
        extent: root of the sum of the squares of theirs [m], as errors are norms over all frames.
    """

    def __init__(self, motions: Sequence[TrajectoryLike]) -> None:
        """Take the motion of each frame, whatever ``as_trajectory`` takes.

        Raises:
            InputError: less than two, or motions of different numbers of coordinates.
        """
        given = instance(motions, list | tuple, "motions")
        self.motions = tuple(as_trajectory(motion) for motion in given)
        starts = [motion.at(0.0) for motion in self.motions]
        sizes = [(start.x_d.size, start.xd_d.size) for start in starts]
        if len(sizes) < 2 or len(set(sizes)) > 1:
            raise InputError(
                "expected two or more motions of equally many coordinates, got "
                f"{[coordinates for coordinates, _ in sizes]} coordinates.",
                where="motions",
            )
        coordinates, rows = sizes[0]
        self._positions = rows if rows == coordinates else rows - 3
        extents: list[Any] = [motion.extent for motion in self.motions]
        times: list[Any] = [motion.settles for motion in self.motions]
        if None not in extents:
            self.extent = float(np.linalg.norm(extents))
        if None not in times:
            self.settles = max(times)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration of all frames at time t [s]."""
        each = zip(*(motion.at(t) for motion in self.motions), strict=True)
        return Desired(*(joined(parts, self._positions) for parts in each))

    def placed(self, start: np.ndarray) -> Trajectory:
        """Return the motions, those without a place of their own placed where their frame is.

        Where these are poses, a motion of a position holds the orientation.
        """
        k = len(self.motions)
        if start.size not in (self.at(0.0).x_d.size, 7 * k):
            return self  # as ``Trajectory.placed``
        placed = []
        own = parts_of(start, k, self._positions)
        for motion, here in zip(self.motions, own, strict=True):
            turns = here.size > motion.at(0.0).x_d.size
            placed.append((PoseTrajectory(motion, None) if turns else motion).placed(here))
        return Stacked(placed)
