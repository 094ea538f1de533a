"""Kinematics of a joint task: nothing to know."""

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
    """x = q, J = I: no parameter, no singularity, no null space.

    A joint-space law is then the task-space law on this task.
    """

    task: JointTask

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Take a believed robot with a joint task.

        Raises:
            ParameterError: unknown translations, which a joint task cannot see.
        """
        if len(unknown):
            raise ParameterError(
                f"a joint task sees no translation, so {unknown!r} cannot be learned from it.",
                where="unknown.kinematic",
                hint='Leave it out, or take a task of the frame, such as "xyz".',
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
        """Copy by what it was made from."""
        return JointKinematics, (self.robot,)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Take configuration q (nq) and velocity v (nv)."""
        self._q, self.xd_hat = q, v

    @property
    def x_hat(self) -> np.ndarray:
        """Joint coordinates (nv) at the last update [rad or m]."""
        return self.task.of(self._q)

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joint coordinates (nv) [rad or m], and (0, 0)."""
        return self.task.of(q), self.X_k

    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share of the way from q_0 to q_1."""
        return np.asarray(pin.interpolate(self.robot.model, q_0, q_1, share))

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return zero (nv, nv)."""
        return self._no_rate

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return (nv, 0)."""
        return self.Y_k

    def value(self, robot: Robot) -> np.ndarray:
        """Return no parameters (0): they fit every robot with this chain."""
        return self.initial

    def base(self, samples: int = 50) -> int:
        """Return 0."""
        return 0
