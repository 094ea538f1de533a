"""Motions of joints: the one of a run, and the one that its reference asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..robot.chain import configuration_from_angles
from ..robot.robot import Robot
from ..tasks.joint import JointTask
from .sample import Sample


class JointMotion(NamedTuple):
    """N samples of a chain.

    Attributes:
        q: (N, nv) one number a joint [rad or m]; of continuous joints it means nothing.
        v: (N, nv) velocities [rad/s or m/s].
        tau: (N, nv) torques at the joints [N m or N].
    """

    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


def motion_of_plant(true: Robot, samples: Sequence[Sample]) -> JointMotion:
    """Return how the true robot moved, and the torques that its motors gave."""
    numbers = [joint.idx_q for joint in true.model.joints[1:]]
    return _stacked(true, [(s.truth.q[numbers], s.truth.v, s.torque) for s in samples])


def motion_of_reference(true: Robot, samples: Sequence[Sample]) -> JointMotion | None:
    """Return the desired joint motion, and the torques that the true robot needs to follow it.

    None for tasks of the frame: which joints follow its path is the controller's choice wherever
    the arm is redundant, and a matter of branches elsewhere.
    """
    if not isinstance(true.task, JointTask):
        return None
    model, data, rows = true.model, true.model.createData(), []
    for x_d, xd_d, xdd_d in (sample.desired for sample in samples):
        q = configuration_from_angles(model, x_d)
        rows.append((x_d, xd_d, pin.rnea(model, data, q, xd_d, xdd_d)))
    motion = _stacked(true, rows)
    return motion._replace(tau=motion.tau + true.friction.torque(motion.v))


def _stacked(robot: Robot, rows: Sequence[tuple[np.ndarray, ...]]) -> JointMotion:
    stack = np.array(rows, dtype=float).reshape(len(rows), 3, robot.model.nv)
    return JointMotion(*stack.swapaxes(0, 1))
