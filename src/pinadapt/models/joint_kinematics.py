"""Kinematics of a joint task, which has no unknown parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import ParameterError
from ..robot.robot import Robot
from ..tasks.joint import JointTask
from .task_kinematics import TaskKinematics
from .translations import Translation


class JointKinematics(TaskKinematics):
    """x = q and J = I: no parameters, no singularities, no null space.

    With it a task-space law becomes the corresponding joint-space law.
    """

    task: JointTask

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Use a nominal robot with a joint task; ``unknown`` must be empty.

        Raises:
            ParameterError: unknown translations, which have no effect on a joint task.
        """
        if len(unknown):
            raise ParameterError(
                f"translations have no effect on a joint task, so {unknown!r} cannot be adapted.",
                where="unknown.kinematic",
                hint='Leave it out, or use a task of the frame, such as "xyz".',
            )
        n = robot.model.nv
        self.robot = robot.undrawn()
        self.task = JointTask.of_chain(robot.model)
        self.joint_names, self.frame = robot.joint_names, robot.frame
        self.nq, self.nv = int(robot.model.nq), int(n)
        self.names, self.size, self.positions = (), 0, 0
        self.initial = self.a_k = np.zeros(0)
        self.J, self.Jdot_v, self._no_rate = np.eye(n), np.zeros(n), np.zeros((n, n))
        self.Y_k, self.last_joint = np.zeros((n, 0)), np.zeros(0)
        self.p_hat, self.X_k = np.zeros(0), np.zeros((0, 0))
        self._q, self.xd_hat = robot.q0, np.zeros(n)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments."""
        return JointKinematics, (self.robot,)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Set configuration q (nq) and velocity v (nv); a_k is empty."""
        self._q, self.xd_hat = q, v

    @property
    def x_hat(self) -> np.ndarray:
        """The joint coordinates (nv) [rad or m]."""
        return self.task.of(self._q)

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the joint coordinates (nv) [rad or m] at q (nq), and an empty X_k (0, 0)."""
        return self.task.of(q), self.X_k

    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share, from 0 to 1, of the way from q_0 to q_1."""
        return np.asarray(pin.interpolate(self.robot.model, q_0, q_1, share))

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return zero (nv, nv)."""
        return self._no_rate

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return the empty Ybar_k (nv, 0)."""
        return self.Y_k

    def value(self, robot: Robot) -> np.ndarray:
        """Return the empty parameters (0), which fit every robot with this chain."""
        return self.initial

    def base(self, samples: int = 50) -> int:
        """Return 0, the number of parameters."""
        return 0
