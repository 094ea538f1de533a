"""Joint limits of a description, and bounds where it has none."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .chain import is_slide, joint_unit

_ROUNDING = 1e-9


def position_limits(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper joint limits (nv) [rad or m], infinite where there are none.

    URDFs say "no limit" with 0, 1.8e308 or infinity: any empty or wider-than-two-turns range counts
    as absent.
    """
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for joint in model.joints[1:]:
        if joint.nq == 1:
            low, high = (
                float(model.lowerPositionLimit[joint.idx_q]),
                float(model.upperPositionLimit[joint.idx_q]),
            )
            if low < high and high - low <= 4 * np.pi:
                lower[joint.idx_v], upper[joint.idx_v] = low, high
    return lower, upper


def check_position_limits(model: pin.Model) -> None:
    """Refuse joints whose lower limit is above the upper one.

    Taking them as no limits would let an arm run into the stops that somebody meant to state.

    Raises:
        RobotError: there is one; the joint and both numbers are named.
    """
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if joint.nq == 1:
            low = float(model.lowerPositionLimit[joint.idx_q])
            high = float(model.upperPositionLimit[joint.idx_q])
            if low > high:
                raise RobotError(
                    f"the lower limit of joint '{name}', {low:g}, is above its upper one, "
                    f"{high:g}.",
                    where=model.name,
                    hint="Exchange them in the description, or make both 0 for no limit.",
                )


def warn_beyond_limits(model: pin.Model, angles: np.ndarray) -> None:
    """Warn of joints of a home pose (nv) [rad or m] that are outside their limits."""
    lower, upper = position_limits(model)
    outside = [
        f"joint '{model.names[joint.id]}' at {angles[i]:.6g} {joint_unit(joint)}, limits "
        f"{lower[i]:.6g} to {upper[i]:.6g}"
        for joint in model.joints[1:]
        if not lower[(i := joint.idx_v)] - _ROUNDING <= angles[i] <= upper[i] + _ROUNDING
    ]
    if outside:
        warnings.warn(f"q0 is outside the joint limits: {'; '.join(outside)}.", stacklevel=3)


def position_bounds(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return joint bounds (nv) [rad or m]; an absent limit becomes half a turn or one metre."""
    lower, upper = position_limits(model)
    half = np.array([1.0 if is_slide(joint) else np.pi for joint in model.joints[1:]])
    return np.where(np.isfinite(lower), lower, -half), np.where(np.isfinite(upper), upper, half)
