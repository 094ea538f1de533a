"""Where the joints and the tool of a chain are over time, as described or as estimated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from ..models.task_kinematics import TaskKinematics
from ..models.translations import PlacedTranslations
from ..robot.chain import configuration_from_angles
from ..robot.robot import Robot
from ..robot.succession import Succession
from ..tasks.task import FrameTask


@dataclass(frozen=True, eq=False)
class Motion:
    """A chain of n joints at F moments.

    Attributes:
        joints: (F, n + 1, 4, 4) placements of the universe and the joints [m], world axes.
        origins: (F, n + 1, 3) each joint's origin [m], axes of its parent joint.
        tool: (F, 3) the task frame's origin [m], axes of the joint that carries it.
        parents: (n + 1) parent joint of each joint.
        last: the joint that carries the tool.
    """

    joints: np.ndarray
    origins: np.ndarray
    tool: np.ndarray
    parents: tuple[int, ...]
    last: int

    @property
    def tip(self) -> np.ndarray:
        """The task frame's origin (F, 3) [m], world axes."""
        carrier = self.joints[:, self.last]
        return np.einsum("fij,fj->fi", carrier[:, :3, :3], self.tool) + carrier[:, :3, 3]

    @property
    def points(self) -> np.ndarray:
        """All joint origins and tips (F (n + 2), 3) [m], world axes."""
        return np.vstack([self.joints[:, :, :3, 3].reshape(-1, 3), self.tip])


def motion_of(
    robot: Robot,
    q: np.ndarray,
    kinematics: TaskKinematics | None = None,
    a_k: np.ndarray | None = None,
) -> Motion:
    """Place a robot's joints along q; the robot is only read.

    Args:
        robot: whose description to use.
        q: (F, nq) configurations.
        kinematics: its unknown translations, or None.
        a_k: (F, p) their values at each moment [m], or None to keep the description's own.
    """
    model = robot.model.copy()
    data = model.createData()
    frame = model.frames[robot.frame_id]
    placed = PlacedTranslations(
        model, robot.frame_id, () if kinematics is None else kinematics.translations
    )
    joints, origins, tool = [], [], []
    for k, configuration in enumerate(q):
        if a_k is not None:
            placed.write(a_k[k])
        pin.forwardKinematics(model, data, configuration)
        joints.append([placement.homogeneous for placement in data.oMi])
        origins.append([placement.translation.copy() for placement in data.liMi])
        tool.append(frame.placement.translation.copy())
    parents = tuple(int(parent) for parent in model.parents)
    return Motion(
        np.array(joints), np.array(origins), np.array(tool), parents, int(frame.parentJoint)
    )


def motion_in_time(robots: Succession, t: np.ndarray, q: np.ndarray) -> Motion:
    """Place the joints of a robot that changes along q (F, nq) at the times t (F) [s]."""
    which = robots.index(t)
    motions = [motion_of(robots.robots[k], q[which == k]) for k in np.unique(which)]
    parts = zip(*((motion.joints, motion.origins, motion.tool) for motion in motions), strict=True)
    joints, origins, tool = (np.concatenate(part) for part in parts)
    return replace(motions[0], joints=joints, origins=origins, tool=tool)


def desired_tip(true: Robot, x_d: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Return where the tool should be (L, 3) [m] at x_d (L, .); coordinates off the task as in tip.

    Args:
        true: the robot whose task x_d belongs to.
        x_d: (L, .) desired coordinates.
        tip: (L, 3) or (3) where the tool is [m].
    """
    if isinstance(true.task, FrameTask):
        path = np.array(np.broadcast_to(tip, (len(x_d), 3)))
        path[:, true.task.place] = x_d[:, : true.task.positions]
        return path
    return motion_of(true, np.array([configuration_from_angles(true.model, x) for x in x_d])).tip
