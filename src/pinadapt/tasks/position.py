"""Position of the frame, or some of its coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import linear_algebra
from .._kernels import models as kernels
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

    def motion_of(self, model: pin.Model, data: pin.Data, frame: int) -> PositionMotion:
        """Return ``motion`` of one chain, whose data is scratch, as a function of q and v."""
        return PositionMotion(self, model, data, frame)

    def position(self, x: np.ndarray) -> np.ndarray:
        """Return x itself."""
        return x

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx = x - x_d (m), both floats."""
        dx = empty(x.size)
        linear_algebra.subtract(x, x_d, dx)
        return dx


class PositionMotion:
    """Position and velocity (m) of a frame of one chain, read where Pinocchio keeps its joints."""

    def __init__(self, task: PositionTask, model: pin.Model, data: pin.Data, frame: int) -> None:
        """Take the chain, with its data as scratch, and the index of the frame."""
        self._parts = task, model, data, frame
        self._model, self._data = model, data
        joint = model.frames[frame].parentJoint
        placement, motion = data.oMi[joint], data.v[joint]
        self._rows = np.arange(3)[task.place]
        self._views = (  # live
            placement.rotation,
            placement.translation,
            motion.linear,
            motion.angular,
            model.frames[frame].placement.translation,
        )

    def __call__(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the position x (m) [m] and the velocity xd (m) [m/s] at q (nq) and v (nv)."""
        pin.forwardKinematics(self._model, self._data, q, v)
        x, xd = empty(self._rows.size), empty(self._rows.size)
        kernels.point_motion(*self._views, self._rows, x, xd)
        return x, xd

    def __reduce__(self) -> tuple[type[PositionMotion], tuple]:
        """Copy by what it was made from: a copied view would no longer be one."""
        return PositionMotion, self._parts
