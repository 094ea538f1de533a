"""Velocity limits: what a robot's description states."""

from __future__ import annotations

import numpy as np
import pinocchio as pin


def velocity_limits(model: pin.Model) -> np.ndarray:
    """Return speed limits (nv) [rad/s or m/s]; 0, 1.8e308 and inf in a URDF mean none: inf."""
    limits = np.array(model.velocityLimit, dtype=float)
    return np.where((limits > 0.0) & (limits < 1e300), limits, np.inf)
