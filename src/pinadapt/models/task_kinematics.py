"""Kinematics of any task, linear in unknown parameters: what they offer to the laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from ..robot.robot import Robot
from ..tasks.task import Task
from .translations import Translation


class TaskKinematics(ABC):
    """The estimated kinematics of a task, with p unknown parameters a_k.

    ``update`` evaluates everything at an estimate and a state, and replaces the attributes by new
    arrays; the methods refer to the last update. m: task coordinates, m_p: positions among them.
    All is in world axes, linear before angular.

    Attributes:
        robot: the nominal robot, without its geometry.
        task: the controlled coordinates.
        joint_names: names of the chain's joints.
        frame: name of the task frame.
        nq, nv: sizes of configuration and velocity.
        names: one name a parameter.
        size: p.
        positions: m_p.
        initial: (p) the values of the nominal robot [m].
        translations: the unknown translations, in the order of their parameters.
        a_k: (p) the estimate [m].
        last_joint: (m_p) position of the last joint before the frame [m], a view.
        p_hat: (m_p) estimated positions [m].
        X_k: (m_p, p) dx/da_k of the positions: p_hat = X_k a_k + known part.
        xd_hat: (m) estimated task velocity J v [m/s, rad/s].
        J: (m, nv) Jacobian at the estimate.
        Jdot_v: (m) dJ/dt v at a constant estimate [m/s^2, rad/s^2].
        Y_k: (m, p) kinematic regressor, J v = Y_k a_k + known part: Wang and Xie (2009), (2).
    """

    robot: Robot
    task: Task
    joint_names: list[str]
    frame: str
    nq: int
    nv: int
    names: tuple[str, ...]
    size: int
    positions: int
    initial: np.ndarray
    a_k: np.ndarray
    translations: Sequence[Translation] = ()
    last_joint: np.ndarray
    p_hat: np.ndarray
    X_k: np.ndarray
    xd_hat: np.ndarray
    J: np.ndarray
    Jdot_v: np.ndarray
    Y_k: np.ndarray

    @abstractmethod
    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p) [m], configuration q (nq) and velocity v (nv)."""

    @property
    def Y_p(self) -> np.ndarray:
        """The position rows (m_p, p) of Y_k."""
        return self.Y_k[: self.task.positions]

    @property
    @abstractmethod
    def x_hat(self) -> np.ndarray:
        """The estimated task coordinates."""

    @abstractmethod
    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there.

        The estimate is that of the last update. The attributes do not change.
        """

    @abstractmethod
    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share, from 0 to 1, of the way from q_0 to q_1."""

    @abstractmethod
    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) at rate a_k_rate (p) [m/s] of the estimate."""

    @abstractmethod
    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27) at joint acceleration a (nv)."""

    @abstractmethod
    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain; None if none reproduce it."""

    @abstractmethod
    def base(self, samples: int = 50) -> int:
        """Return the number of identifiable combinations of the parameters."""
