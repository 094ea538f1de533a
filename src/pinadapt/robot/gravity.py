"""The torque that holds a robot against gravity, which some arms add by themselves."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..description.chain import is_slide, position_limits
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


def levers(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds (n), (n) of the columns of the frame's Jacobian, linear and angular part.

    |J_i| of a revolute joint is the frame's distance from its axis: at most that of the next joint,
    which does not change, and the lengths of all further links, with the stroke of slides among
    them. A slide moves the frame by its own velocity and does not turn it.

    Returns:
        Linear [m/rad, or 1 for slides], infinite beyond a slide without limits; angular, 1 or 0.
    """
    model, q = robot.model, pin.neutral(robot.model)
    data = model.createData()
    axes = pin.computeJointJacobians(model, data, q).reshape(6, model.nv)[3:]
    low, high = position_limits(model)
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    stroke = np.where(slides, np.maximum(np.abs(low), np.abs(high)), 0.0)
    frame = model.frames[robot.frame_id].placement.translation
    steps = [model.jointPlacements[i].translation for i in range(2, model.njoints)] + [frame]
    lengths = np.array([np.linalg.norm(step) for step in steps])
    linear = np.ones(model.nv)
    for i in np.flatnonzero(~slides):
        first = np.linalg.norm(np.cross(axes[:, i], data.oMi[int(i) + 1].rotation @ steps[i]))
        linear[i] = first + lengths[i + 1 :].sum() + stroke[i + 1 :].sum()
    return linear, np.where(slides, 0.0, 1.0)
