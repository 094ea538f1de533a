"""The desired motion of several task frames: one motion of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from ..exceptions import InputError
from ..records import Desired
from ..tasks.several_frames import joined, parts_of
from .given import TrajectoryLike, as_trajectory
from .pose import PoseTrajectory
from .trajectory import Trajectory


class Stacked(Trajectory):
    """One motion of each task frame, in the order of the frames, as one of all their coordinates.

    x_d has the positions of all frames, then, for poses, their quaternions, as
    ``tasks.FramesTask`` has them; velocities and accelerations have the linear parts first.

    Attributes:
        motions: those of the frames.
    """

    motions: tuple[Trajectory, ...]

    def __init__(self, motions: Sequence[TrajectoryLike]) -> None:
        """Take the motion of each frame, whatever ``as_trajectory`` takes.

        Raises:
            InputError: less than two, or motions of different numbers of coordinates.
        """
        self.motions = tuple(as_trajectory(motion) for motion in motions)
        sizes = {(len(start.x_d), len(start.xd_d)) for start in self._at(0.0)}
        if len(self.motions) < 2 or len(sizes) > 1:
            raise InputError(
                "expected two or more motions of equally many coordinates, got "
                f"{[len(start.x_d) for start in self._at(0.0)]} coordinates.",
                where="motions",
            )
        ((coordinates, rows),) = sizes
        self._positions = rows if rows == coordinates else rows - 3

    def _at(self, t: float) -> list[Desired]:
        return [motion.at(t) for motion in self.motions]

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration of all frames at time t [s]."""
        return Desired(
            *(joined(list(each), self._positions) for each in zip(*self._at(t), strict=True))
        )

    def _each(self, change: Callable[[Trajectory, np.ndarray], Trajectory], given: Any) -> Stacked:
        """Return the motions changed, each by its part of what is given for all."""
        own = parts_of(given, len(self.motions), self._positions)
        changed = Stacked([change(*both) for both in zip(self.motions, own, strict=True)])
        changed.exact = self.exact
        return changed

    def placed(self, start: np.ndarray) -> Trajectory:
        """Return the motions, those without a place of their own placed where their frame is.

        Where these are poses, a motion of a position holds the orientation.
        """

        def place(motion: Trajectory, own: np.ndarray) -> Trajectory:
            turns = own.size > motion.at(0.0).x_d.size
            return (PoseTrajectory(motion, None) if turns else motion).placed(own)

        return self._each(place, start)

    def shifted(self, by: ArrayLike) -> Stacked:
        """Return the same motions displaced by (m): [m], rotations about world axes [rad]."""
        by = vector(by, self.at(0.0).xd_d.size, "by", fills=False)
        return self._each(lambda motion, own: motion.shifted(own), by)

    def starting_at(self, start: ArrayLike) -> Stacked:
        """Return the same motions displaced so that their coordinates are ``start`` at time 0.

        Raises:
            InputError: ``start`` has another number of coordinates than x_d, or is not finite.
        """
        start = vector(start, self.at(0.0).x_d.size, "start", fills=False)
        return self._each(lambda motion, own: motion.starting_at(own), start)

    @property
    def extent(self) -> float | None:
        """Square root of the sum of the squares of the motions' extents [m], or None.

        The error of a rollout is the norm over all frames.
        """
        sizes = [motion.extent for motion in self.motions]
        known = [size for size in sizes if size is not None]
        return float(np.linalg.norm(known)) if len(known) == len(sizes) else None

    @property
    def settles(self) -> float | None:
        """Time from which all are at rest [s], or None."""
        times = [motion.settles for motion in self.motions]
        known = [time for time in times if time is not None]
        return max(known) if len(known) == len(times) else None
