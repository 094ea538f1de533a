"""The mass matrix of a robot as it is described."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .robot import Robot


class Inertia:
    """M(q) of a robot (nv, nv), whatever is learned of another one meanwhile."""

    def __init__(self, robot: Robot) -> None:
        """Take the robot."""
        self._robot, self._data = robot.undrawn(), robot.model.createData()

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Return M(q) (nv, nv) at a configuration q (nq); the next call writes to it."""
        return np.asarray(pin.crba(self._robot.model, self._data, q))

    def __reduce__(self) -> tuple[type[Inertia], tuple[Robot]]:
        """Copy and pickle the robot alone."""
        return Inertia, (self._robot,)
