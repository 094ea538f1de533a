"""Kinematics of any task, linear in unknown parameters: what they offer to the laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import ParameterError
from ..robot.constraints import Constraints
from ..robot.robot import Robot
from ..tasks.frame import ComTask
from ..tasks.task import JointTask, Task
from .regressor import wrong_sizes
from .right_inverse import RightInverse
from .translations import Translation, Words


class TaskKinematics(ABC):
    """The estimated kinematics of a task, with p unknown parameters a_k.

    ``update`` evaluates everything at an estimate and a state, and replaces the attributes by new
    arrays; the methods refer to the last update. m: task coordinates, m_p: positions among them.
    All is in world axes, linear before angular. Where subclasses say nothing else, the coordinates
    follow from q alone and there are no parameters.

    Attributes:
        robot: the nominal robot, without its geometry.
        task: the controlled coordinates.
        joint_names: names of the chain's joints.
        nq, nv: sizes of configuration and velocity.
        names: one name a parameter.
        size: p.
        positions: m_p.
        initial: (p) the values of the nominal robot [m].
        unknown: the words that chose the parameters.
        translations: the unknown translations, in the order of their parameters.
        calibrated: whether it is known how the axes of x stand against the robot's base.
        affine: whether positions and velocities are affine in the parameters; pictures are not.
        sizes: (p) how far each parameter may be off, relative to each other.
        bounds: (2, p) where the parameters stay by default.
        a_k: (p) the estimate [m].
        p_hat: (m_p) estimated positions [m].
        X_k: (m_p, p) dx/da_k of the positions: p_hat = X_k a_k + known part.
        xd_hat: (m) estimated task velocity J v [m/s, rad/s].
        J: (m, nv) Jacobian at the estimate.
        Jdot_v: (m) dJ/dt v at a constant estimate [m/s^2, rad/s^2].
        Y_k: (m, p) kinematic regressor, J v = Y_k a_k + known part: Wang and Xie (2009), (2).
    """

    task: Task
    names: tuple[str, ...] = ()
    size: int = 0
    positions: int
    initial: np.ndarray
    a_k: np.ndarray
    translations: Sequence[Translation] = ()
    calibrated: bool = True
    affine: bool = True
    sizes: np.ndarray
    bounds: np.ndarray
    p_hat: np.ndarray
    X_k: np.ndarray
    xd_hat: np.ndarray
    J: np.ndarray
    Jdot_v: np.ndarray
    Y_k: np.ndarray

    _x: np.ndarray
    _rate: np.ndarray
    constraints: Constraints | None = None
    unknown: Words = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self.robot, self.unknown), {"constraints": self.constraints}

    def _take(self, robot: Robot, task: Any, unknown: Words) -> None:
        """Take a nominal robot, its task, and the words that choose the unknown parameters."""
        self.robot = robot.undrawn()
        self.task = task
        self.unknown = unknown
        self.joint_names = robot.joint_names
        self.nq = robot.model.nq
        self.nv = robot.model.nv
        self.positions = task.positions
        self._still = np.zeros(self.nv)

    def inverse(self, q: np.ndarray, v: np.ndarray, threshold: float) -> RightInverse:
        """Return the right inverse of J, under the constraints if there are any.

        Args:
            q: (nq) configuration of the last update.
            v: (nv) velocity.
            threshold: below which it is damped, see ``RightInverse``.
        """
        constraints = None if self.constraints is None else self.constraints.at(q, v)
        return RightInverse(self.J, threshold, constraints, self.task.levels)

    @abstractmethod
    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p) [m], configuration q (nq) and velocity v (nv)."""

    @property
    def Y_p(self) -> np.ndarray:
        """The position rows (m_p, p) of Y_k."""
        return self.Y_k[: self.task.positions]

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated task coordinates."""
        return self._x

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter (p)."""
        return ("m",) * self.size

    def initial_at(self, q: np.ndarray, x: np.ndarray | None) -> np.ndarray:
        """Return the estimate (p) to start from at a measured q (nq) and x, if that is measured."""
        return self.initial

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there.

        The estimate is that of the last update. The attributes do not change.

        Args:
            q: (nq) configuration.
            seen: coordinates measured there, see ``explaining``; None: the estimated ones.
        """
        robot = self.robot
        return self.task.at(robot.model, self._data, robot.frame_id, q), self.X_k

    def explaining(self, x: np.ndarray) -> np.ndarray:
        """Return the regressor (m_p, p) of the prediction error of measured coordinates x.

        It is X with p_hat - x = X da_k, exactly: X_k but for cameras, where X depends on x.
        """
        return self.X_k

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) at rate a_k_rate (p) [m/s] of the estimate."""
        return self._rate

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27) at joint acceleration a (nv)."""
        return self.Y_k

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain; None if none reproduce it."""
        return self.initial

    def seen(self, a_k: np.ndarray) -> Robot:
        """Return the nominal robot with x in the axes in which an estimate a_k (p) has it."""
        return self.robot

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:  # noqa: B027
        """Write the translations of an estimate a_k (p) [m], if it has any, into a model."""

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return an estimate a_k (p) with the translations of a model of the chain [m]."""
        return a_k

    def _know(self, robot: Robot, task: Task, unknown: Words) -> None:
        """Take a nominal robot and a task without parameters; ``unknown`` must be empty.

        Raises:
            ParameterError: unknown translations, which have no effect on the task.
        """
        if len(unknown):
            raise ParameterError(
                f"translations have no effect on a {task.name} task, so {unknown!r} cannot be "
                "adapted.",
                where="unknown.translations",
                hint='Leave it out, or use a task of the frame, such as "xyz".',
            )
        self._take(robot, task, unknown)
        self._data = robot.model.createData()
        self.initial = self.a_k = self.p_hat = self.sizes = np.zeros(0)
        self.X_k = np.zeros((0, 0))
        self.bounds = np.zeros((2, 0))
        self.Jdot_v = np.zeros(task.size)
        self.Y_k = np.zeros((task.size, 0))


class ComKinematics(TaskKinematics):
    """Centre of mass of the robot as loaded, and orientation of its task frame."""

    task: ComTask

    def __init__(self, robot: Robot, unknown: Words = ()) -> None:
        """Use a nominal robot with the task "com"; ``unknown`` must be empty.

        Raises:
            ParameterError: unknown translations, which have no effect on the task.
        """
        self._know(robot, robot.task, unknown)
        self.update(self.initial, robot.q0, self._still)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Set configuration q (nq) and velocity v (nv); a_k is empty."""
        if q.size != self.nq or v.size != self.nv:
            raise wrong_sizes(self.robot.model, q, v)
        self._x, self.J, self._rate = self.task.moving_map(self._data, q, v)
        self.xd_hat = self.J.dot(v)
        self.Jdot_v = self._rate.dot(v)


class JointKinematics(TaskKinematics):
    """x = q and J = I, of the joints with motors: no parameters, no singularities, no null space.

    With it a task-space law becomes the corresponding joint-space law.
    """

    task: JointTask

    def __init__(self, robot: Robot, unknown: Words = ()) -> None:
        """Use a nominal robot with a joint task; ``unknown`` must be empty.

        Raises:
            ParameterError: unknown translations, which have no effect on a joint task.
        """
        self._know(robot, JointTask.of_joints(robot.model, robot.motors), unknown)
        self._dofs = list(self.task.dofs)
        self.J = np.eye(self.nv)[self._dofs]
        self._rate = np.zeros(self.J.shape)
        self._inverse = RightInverse(self.J)
        self.update(self.initial, robot.q0, self._still)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Set configuration q (nq) and velocity v (nv); a_k is empty."""
        if q.size != self.nq or v.size != self.nv:
            raise wrong_sizes(self.robot.model, q, v)
        self._x = self.task.of(q)
        self.xd_hat = v[self._dofs]

    def inverse(self, q: np.ndarray, v: np.ndarray, threshold: float) -> RightInverse:
        """Return the inverse of I, or that under the constraints."""
        if self.constraints is None:
            return self._inverse
        return super().inverse(q, v, threshold)
