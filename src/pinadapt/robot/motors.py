"""Torque limits: what a robot's description states, or a user does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import numbers
from ..description.chain import effort_limits, is_slide
from ..exceptions import GainError

if TYPE_CHECKING:
    from .robot import Robot


def torque_limits(robot: Robot, limits: ArrayLike | bool | None) -> np.ndarray | None:
    """Return torque limits (nv) [N m or N]: the description's for True, as given, or None.

    Raises:
        GainError: of the wrong size, or not positive.
    """
    if limits is None or limits is False:
        return None
    n = robot.model.nv
    bounds = (
        effort_limits(robot.model)
        if limits is True
        else numbers(limits, "torque_limits", error=GainError, infinite=True)
    )
    if bounds.shape not in ((), (n,)):
        raise GainError(
            f"expected True or {n} numbers, got shape {bounds.shape}.", where="torque_limits"
        )
    bounds = np.broadcast_to(bounds, n).copy()
    if not (bounds > 0.0).all():  # also true for NaN
        raise GainError(f"must be positive, got {bounds.tolist()}.", where="torque_limits")
    return bounds if np.isfinite(bounds).any() else None


def overloaded(robot: Robot, limits: np.ndarray) -> str | None:
    """Return in words which joints cannot hold the robot at home with these limits (nv), or None.

    Args:
        robot: the real one, with its load.
        limits: of the motors [N m or N].
    """
    weight = np.abs(pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0))
    short = [
        f"{name} ({weight[i]:.3g} of {limits[i]:.3g} {'N' if is_slide(joint) else 'N m'})"
        for i, (name, joint) in enumerate(
            zip(robot.joint_names, robot.model.joints[1:], strict=True)
        )
        if weight[i] > limits[i]
    ]
    if not short:
        return None
    return (
        f"the motors cannot hold the real robot at its home pose: {', '.join(short)}. Take a "
        "lighter load, or another home pose."
    )
