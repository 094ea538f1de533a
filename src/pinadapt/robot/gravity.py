"""The torque that holds a robot against gravity, which some arms add by themselves."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..exceptions import InputError, did_you_mean
from .robot import Robot

Compensation: TypeAlias = Callable[[np.ndarray], np.ndarray]

NOMINAL = "nominal"


class Gravity:
    """g(q) of a robot as described: its torque (nv) [N m or N] at rest at a configuration (nq)."""

    def __init__(self, robot: Robot) -> None:
        """Take the robot, without whatever load or tool it is not known to carry."""
        instance(robot, Robot, "robot")
        self._robot, self._data = robot, robot.model.createData()

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Return g(q) (nv) at a configuration q (nq)."""
        return np.array(pin.computeGeneralizedGravity(self._robot.model, self._data, q))

    def __reduce__(self) -> tuple[type[Gravity], tuple[Robot]]:
        """Copy and pickle the robot alone."""
        return Gravity, (self._robot.undrawn(),)


def compensation_of(robot: Robot, given: Compensation | str | None) -> Compensation | None:
    """Return what an arm adds to the torques sent to it, or None: "nominal" is the robot's gravity.

    Raises:
        InputError: another word, no callable, or one that does not return nv finite numbers at
            home.
    """
    if given is None:
        return None
    if isinstance(given, str):
        if given != NOMINAL:
            raise InputError(
                f"expected '{NOMINAL}' or a callable, got {given!r}."
                f"{did_you_mean(given, [NOMINAL])}",
                where="compensated",
            )
        return Gravity(robot)
    if not callable(given):
        raise InputError(f"expected '{NOMINAL}' or a callable, got {given!r}.", where="compensated")
    home = np.asarray(given(robot.q0.copy()))
    n = robot.model.nv
    if home.shape != (n,) or home.dtype.kind not in "fiu" or not np.isfinite(home).all():
        raise InputError(
            f"expected a callable that returns {n} torques, got {home!r} at home.",
            where="compensated",
        )
    return given
