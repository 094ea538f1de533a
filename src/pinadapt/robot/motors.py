"""Motors: their torque limits, and the gravity torque that some arms add by themselves."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import instance, numbers
from ..description.chain import effort_limits, is_slide
from ..exceptions import GainError, InputError, did_you_mean
from .robot import Robot

Compensation: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Function of a configuration q (nq): torque (nv) [N m or N] that the arm adds to the command."""

NOMINAL = "nominal"


def torque_limits(robot: Robot, limits: ArrayLike | bool | None) -> np.ndarray | None:
    """Return torque limits (nv) [N m or N], or None if no joint has one.

    Args:
        robot: read only.
        limits: a number or (nv) [N m or N]; True for the effort limits of the description; False or
            None for no limits.

    Raises:
        GainError: wrong size, or limits that are not positive.
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
            f"expected True, a number or {n} numbers, got shape {bounds.shape}.",
            where="torque_limits",
        )
    bounds = np.broadcast_to(bounds, n).copy()
    if not (bounds > 0.0).all():  # also true for NaN
        raise GainError(f"must be positive, got {bounds.tolist()}.", where="torque_limits")
    return bounds if np.isfinite(bounds).any() else None


def overloaded(robot: Robot, limits: np.ndarray) -> str | None:
    """Return a message if the motors cannot hold a robot at its home pose against gravity, or None.

    Args:
        robot: the true robot with its load.
        limits: (nv) torque limits of the motors [N m or N].
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
        f"the motors cannot hold the true robot at its home pose: {', '.join(short)}. Choose a "
        "lighter load or another home pose."
    )


class Gravity:
    """g(q) of a robot: the torque (nv) [N m or N] that holds it at rest at a configuration (nq)."""

    def __init__(self, robot: Robot) -> None:
        """Take the nominal robot, without unknown loads or tools."""
        instance(robot, Robot, "robot")
        self._robot, self._data = robot, robot.model.createData()

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Return g(q) (nv) at a configuration q (nq)."""
        return np.array(pin.computeGeneralizedGravity(self._robot.model, self._data, q))

    def __reduce__(self) -> tuple[type[Gravity], tuple[Robot]]:
        """Pickle the robot only."""
        return Gravity, (self._robot.undrawn(),)


def compensation_of(robot: Robot, given: Compensation | str | None) -> Compensation | None:
    """Return the compensation that an arm adds to the torque command, or None for none.

    Args:
        robot: the nominal robot.
        given: a function of q (nq), "nominal" for the gravity torque of ``robot``, or None.

    Raises:
        InputError: another word, not callable, or a function that does not return nv finite numbers
            at the home pose.
    """
    if given is None:
        return None
    if isinstance(given, str):
        if given != NOMINAL:
            raise InputError(
                f"expected '{NOMINAL}' or a function, got {given!r}."
                f"{did_you_mean(given, [NOMINAL])}",
                where="compensated",
            )
        return Gravity(robot)
    if not callable(given):
        raise InputError(f"expected '{NOMINAL}' or a function, got {given!r}.", where="compensated")
    home = np.asarray(given(robot.q0.copy()))
    n = robot.model.nv
    if home.shape != (n,) or home.dtype.kind not in "fiu" or not np.isfinite(home).all():
        raise InputError(
            f"expected a function that returns {n} torques, got {home!r} at the home pose.",
            where="compensated",
        )
    return given
