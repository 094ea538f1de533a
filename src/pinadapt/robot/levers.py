"""How far the frame of a chain can be from the axes of its joints, at any configuration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .chain import is_slide
from .position_limits import position_limits
from .robot import Robot


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
