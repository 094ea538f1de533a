"""What the laws may ask of a believed robot's kinematics, whatever its task is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from ..robot.robot import Robot
from ..tasks.task import Task
from .translations import Translation


class TaskKinematics(ABC):
    """The believed kinematics of a chain at the current estimate of its unknown parameters.

    ``update`` evaluates everything at one state and replaces the attributes by new arrays; the
    methods answer for the state of the last update. m: task size, m_p: the positions among its
    rows, p: number of parameters.

    Attributes:
        robot: the believed robot as described, without its geometry.
        task: the controlled coordinates.
        joint_names: names of the chain's joints.
        frame: name of the task frame.
        nq, nv: sizes of configuration and velocity.
        names: one name a parameter.
        size: p.
        positions: m_p.
        initial: (p) values in the believed robot's own description [m].
        translations: what the parameters are, in their order.
        a_k: (p) the estimate of the last update.
        last_joint: (m_p) live position of the joint that carries the frame, at the last update [m].
        p_hat: (m_p) estimated positions [m].
        X_k: (m_p, p) dx/da_k of the positions: p_hat = X_k a_k + known part.
        xd_hat: (m) estimated task velocity J v.
        J: (m, nv) Jacobian at the estimate.
        Jdot_v: (m) dJ/dt v with the estimate held constant.
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
        """Evaluate at estimate a_k (p), configuration q (nq) and velocity v (nv)."""

    @property
    def Y_p(self) -> np.ndarray:
        """Position rows (m_p, p) of Y_k."""
        return self.Y_k[: self.task.positions]

    @property
    @abstractmethod
    def x_hat(self) -> np.ndarray:
        """Believed task coordinates at the last update."""

    @abstractmethod
    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the task coordinates at another q (nq), and X_k (m_p, p) there, by the estimate.

        Of the last update; its attributes stay.
        """

    @abstractmethod
    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share of the way from q_0 to q_1."""

    @abstractmethod
    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) while the estimate moves at a_k_rate (p)."""

    @abstractmethod
    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27), at joint acceleration a (nv)."""

    @abstractmethod
    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of any robot with this chain, or None where none fit."""

    @abstractmethod
    def base(self, samples: int = 50) -> int:
        """Return how many combinations of the parameters motion can identify."""
