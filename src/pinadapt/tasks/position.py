"""Position of the frame, or some of its coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .task import FrameTask, RowGroup


@dataclass(frozen=True)
class PositionTask(FrameTask):
    """A choice of m rows of the frame's position [m], in world axes."""

    @property
    def positions(self) -> int:
        """All of them: m."""
        return self.size

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """One group."""
        return (RowGroup("position", "m", slice(0, self.size)),)

    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return the coordinates x (m) of a frame's placement in the world."""
        return np.array(placement.translation[self.place])

    def velocity_of(self, motion: pin.Motion) -> np.ndarray:
        """Return the task velocity (m) of a frame's LOCAL_WORLD_ALIGNED motion."""
        return np.asarray(motion.vector[self.rows])

    def position(self, x: np.ndarray) -> np.ndarray:
        """Return x itself."""
        return x
