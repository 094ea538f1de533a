"""Kinematics and dynamics of the nominal robot, as a user's own controller computes them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import pinadapt as pa


class NominalRobot:
    """Kinematics, gravity and momentum of a robot as described; n joints, m task coordinates.

    Attributes:
        robot: the robot.
        limits: (n) its effort limits [N m or N], infinite where there are none.
    """

    def __init__(self, robot: pa.Robot) -> None:
        """Take the robot; its task is a position, its configurations are n numbers."""
        self.robot = robot
        self._model = robot.model.copy()
        self._data = self._model.createData()
        efforts = np.array(self._model.effortLimit)
        self.limits = np.where(efforts > 0.0, efforts, np.inf)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return the task coordinates (m) [m] at q (n)."""
        return self.robot.task.at(self._model, self._data, self.robot.frame_id, q)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return J (m, n) at q (n)."""
        frame = self.robot.frame_id
        axes = pin.LOCAL_WORLD_ALIGNED
        J = pin.computeFrameJacobian(self._model, self._data, q, frame, axes)
        return np.asarray(J[self.robot.frame_task.rows])

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """Return g (n) [N m or N] at q (n)."""
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, q))

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g + friction (n)."""
        tau = pin.rnea(self._model, self._data, q, v, a)
        return np.asarray(tau + self.robot.friction.torque(v))

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return M v (n)."""
        return np.asarray(pin.crba(self._model, self._data, q) @ v)

    def momentum_rate(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return C^T v - g - friction (n), the rate of M v without motor torque."""
        C = pin.computeCoriolisMatrix(self._model, self._data, q, v)
        return np.asarray(C.T @ v - self.gravity(q) - self.robot.friction.torque(v))

    def limited(self, torque: np.ndarray) -> np.ndarray:
        """Return a torque (n) within the effort limits."""
        return np.clip(torque, -self.limits, self.limits)
