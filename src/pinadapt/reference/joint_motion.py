"""What a motion of the task asks of a robot's joints: velocities, accelerations, torques."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..description.chain import configuration_from_angles, position_limits
from ..laws.posture import Posture
from ..robot.robot import Robot
from ..tasks.frame import FrameTask
from ..trajectories.trajectory import Trajectory

TRACKED = 0.01  # [reach] or [rad]: further from the motion, the robot has not followed it
_DAMPING = 0.01  # of the smallest singular value at home
_LARGEST_STEP = 0.2  # [rad or m] of all joints together, from one instant to the next
_SEARCH = 100  # most steps to the first point


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The joints along a motion of the task, at N instants s of the motion's own time.

    Under another time law s(t) the joint velocity is v ds/dt, the acceleration a (ds/dt)^2 + v
    d^2s/dt^2, and the torque::

        still + drag ds/dt + curve (ds/dt)^2 + inertia d^2s/dt^2

    Attributes:
        s: (N) [s].
        q: (N, nq) configurations.
        v: (N, n) dq/ds [rad/s or m/s].
        a: (N, n) d^2q/ds^2 [rad/s^2 or m/s^2].
        still: (N, n) gravity and Coulomb friction [N m or N].
        drag: (N, n) viscous friction v.
        curve: (N, n) M a + C v.
        inertia: (N, n) M v.
        off: (N) how far the robot is from the motion, in units of what is allowed.
        beyond: (N, n) how far joints are beyond their limits [rad or m], else negative.
    """

    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    still: np.ndarray
    drag: np.ndarray
    curve: np.ndarray
    inertia: np.ndarray
    off: np.ndarray
    beyond: np.ndarray


def joint_motion(
    motion: Trajectory, robot: Robot, s: np.ndarray, q: np.ndarray | None = None
) -> JointMotion:
    """Return what a motion asks of a robot.

    For a task of the frame by inverse kinematics: damped least squares from one instant to the
    next, with the return of the null space to the home pose that the control laws have by default,
    at the motion's own speed. Where the damping holds the robot back, for example outside of the
    workspace, ``off`` exceeds 1.

    Args:
        motion: of the task's coordinates.
        robot: the robot as it is believed to be; read only.
        s: (N) instants at even steps [s], N >= 3.
        q: (nq) where the search for the first configuration begins; None: home.
    """
    model, data, n = robot.model, robot.model.createData(), robot.model.nv
    h = float(s[1] - s[0])
    if isinstance(robot.task, FrameTask):
        follower = _Follower(robot, robot.task)
        found = list(follower.along(motion, s, robot.q0 if q is None else q))
        poses, off = np.array([each for each, _ in found]), np.array([far for _, far in found])
        v = np.empty((len(s), n))
        for k in range(len(s)):
            before, after = max(k - 1, 0), min(k + 1, len(s) - 1)
            v[k] = pin.difference(model, poses[before], poses[after]) / (h * (after - before))
        v[0], v[-1] = 2.0 * v[0] - v[1], 2.0 * v[-1] - v[-2]
        a = np.gradient(v, h, axis=0)
    else:
        asked = [motion.at(float(each)) for each in s]
        poses = np.array([configuration_from_angles(model, each.x_d) for each in asked])
        v, a = np.array([each.xd_d for each in asked]), np.array([each.xdd_d for each in asked])
        off = np.zeros(len(s))
    rest = np.zeros(n)
    g, inertia, curve = np.empty((3, len(s), n))
    for k, pose in enumerate(poses):
        g[k] = pin.rnea(model, data, pose, rest, rest)
        inertia[k] = pin.rnea(model, data, pose, rest, v[k])
        curve[k] = pin.rnea(model, data, pose, v[k], a[k])
    still = g + robot.friction.coulomb * np.sign(v)
    drag = robot.friction.viscous * v
    beyond = _beyond(model, poses)
    return JointMotion(s, poses, v, a, still, drag, curve - g, inertia - g, off, beyond)


def _beyond(model: pin.Model, poses: np.ndarray) -> np.ndarray:
    """Return how far (N, n) the configurations (N, nq) are beyond the limits of the joints."""
    low, high = position_limits(model)
    beyond = np.full((len(poses), model.nv), -np.inf)
    for joint in model.joints[1:]:
        if joint.nq == 1:
            x, i = poses[:, joint.idx_q], joint.idx_v
            beyond[:, i] = np.maximum(low[i] - x, x - high[i])
    return beyond


class _Follower:
    """Damped inverse kinematics of one robot along a motion."""

    def __init__(self, robot: Robot, task: FrameTask) -> None:
        m = task.positions
        self._robot, self._task, self._model = robot, task, robot.model
        self._data = robot.model.createData()
        self._arms = np.repeat([1.0, robot.reach], [m, task.size - m])  # [m/rad]
        self._allowed = np.repeat([TRACKED * robot.reach, TRACKED], [m, task.size - m])
        self._redundant = robot.model.nv > task.size
        self._posture = Posture(robot)
        J = self._jacobian(robot.q0)[0]
        self._least = (_DAMPING**2) * max(float(np.linalg.eigvalsh(J @ J.T)[0]), 1e-12)
        self._eye = np.eye(task.size)

    def along(
        self, motion: Trajectory, s: np.ndarray, q: np.ndarray
    ) -> Iterator[tuple[np.ndarray, float]]:
        """Yield a configuration (nq) for each instant (N), and how far off the motion it is."""
        targets = [motion.at(float(each)).x_d for each in s]
        q = self._nearest(q, targets[0])
        share = 1.0 - math.exp(-self._posture.frequency * float(s[1] - s[0]))
        for k, target in enumerate(targets):
            J, x = self._jacobian(q)
            error = self._task.error(target, x)
            yield q, float(np.abs(error / self._allowed).max())
            if k + 1 < len(targets):
                to_go = self._task.error(targets[k + 1], x)
                q = self._stepped(q, J, to_go, float(error @ error), share)

    def _nearest(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return a configuration (nq) that reaches a point, or comes near, from q (nq)."""
        for _ in range(_SEARCH):
            J, x = self._jacobian(q)
            to_go = self._task.error(target, x)
            if np.abs(to_go / self._allowed).max() < 1e-6:
                break
            q = self._stepped(q, J, to_go, float(to_go @ to_go), 0.0)
        return q

    def _stepped(
        self, q: np.ndarray, J: np.ndarray, to_go: np.ndarray, off: float, share: float
    ) -> np.ndarray:
        """Return q (nq) after a step towards what is left to go (m).

        The squared error is added to the damping (Levenberg's rule): out of reach it is strong.
        """
        to_go = self._arms * to_go
        psi = np.zeros(J.shape[1])
        if self._redundant and share:
            psi = -share * self._posture.offset(q)
            to_go = to_go - J @ psi
        step = psi + J.T @ np.linalg.solve(J @ J.T + (self._least + off) * self._eye, to_go)
        size = float(np.linalg.norm(step))
        if size > _LARGEST_STEP:
            step *= _LARGEST_STEP / size
        return np.asarray(pin.integrate(self._model, q, step))

    def _jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Jacobian (m, n), rotations times the reach, and the coordinates at q (nq)."""
        model, data, frame = self._model, self._data, self._robot.frame_id
        pin.computeJointJacobians(model, data, q)
        x = self._task.of(pin.updateFramePlacement(model, data, frame))
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[self._task.rows]
        return self._arms[:, None] * J, x
