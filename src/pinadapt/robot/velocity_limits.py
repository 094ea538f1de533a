"""Velocity limits of a description."""

from __future__ import annotations

import numpy as np

from .robot import Robot


def velocity_limits(robot: Robot) -> np.ndarray:
    """Return the limits (nv) [rad/s or m/s]; 0, 1.8e308 and inf in a URDF mean none: inf."""
    limits = np.array(robot.model.velocityLimit, dtype=float)
    return np.where((limits > 0.0) & (limits < 1e300), limits, np.inf)
