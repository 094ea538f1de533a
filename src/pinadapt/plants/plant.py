"""What a controller drives: a robot in a simulator, or one on a bench."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import ceil
from typing import TypeAlias

import numpy as np

from .._checks import instance, whole
from .._kernels import checks as kernels
from ..exceptions import InputError
from ..records import Measurement
from ..robot.motors import Compensation, compensation_of
from ..robot.motors import torque_limits as limits_of
from ..robot.robot import Robot


class Plant(ABC):
    """A robot in time: it is measured, and its motors are asked for a torque for a while.

    A closed loop needs no more than this; no controller ever sees inside.

    Attributes:
        nv: number of joints.
    """

    nv: int

    @abstractmethod
    def reset(self) -> None:
        """Go back to the initial state and time."""

    @abstractmethod
    def measure(self) -> Measurement:
        """Return q, v, the task coordinates x and velocity xd as they are now, with their time."""

    @abstractmethod
    def step(self, torque: np.ndarray, dt: float) -> None:
        """Ask the motors for a torque (nv) [N m or N] for dt [s]; see ``motors``."""

    def become(self, robot: Robot) -> None:
        """Be another robot from now on, at the same q, v and time, until the next ``reset``.

        Loads, tools and friction may differ from those before, the joints may not.

        Raises:
            InputError: this plant cannot be changed while it moves.
            RobotError: the robot has another chain, frame or task.
        """
        raise InputError(
            f"{type(self).__name__} cannot become another robot while it moves.", where="changes"
        )

    def motors(self, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give now when asked for one (nv) [N m or N]."""
        return torque

    def acceleration(self, torque: np.ndarray, feedthrough: np.ndarray | None = None) -> np.ndarray:
        """Return the joint acceleration a (nv) that torque + feedthrough @ a causes now.

        Only the ideal acceleration of a theory's check asks for it.

        Raises:
            InputError: this plant cannot tell.
        """
        raise InputError(
            f"{type(self).__name__} does not tell the acceleration that a torque would cause.",
            where="acceleration",
            hint='Take acceleration = "filtered".',
        )


_MOST_SUBSTEPS = 100_000
LONGEST_STEP = 1e-3  # [s]; integration errors stay below a thousandth of the tracking error


class SimulatedPlant(Plant):
    """A robot that starts from its home and from rest, with motors that give what they can.

    Attributes:
        robot: the true robot as it is now; ``reset`` brings back the first one.
        nv: number of joints.
        torque_limits: (nv) bounds the motors clip at [N m or N], infinite where there is none, or
            None.
        compensation: what the arm's own electronics add to the torque asked for, of q (nq), or None
            for nothing; the motors clip the sum.
        substeps: integration steps in each ``step``; None for as many as ``longest_step`` asks.
        longest_step: bound of an integration step [s] where ``substeps`` does not tell.
        described: whether what moves is ``robot`` to the last number; if not, it has its joints and
            its frame, and nobody knows its parameters.
    """

    robot: Robot
    longest_step: float = LONGEST_STEP
    described: bool = True
    _q: np.ndarray

    def __init__(
        self,
        robot: Robot,
        *,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        substeps: int | None = None,
    ) -> None:
        """Take the robot whose joints move, and what its motors do.

        Raises:
            InputError: no robot, limits or compensation of another size, or a number of substeps
                that nobody can wait for.
        """
        instance(robot, Robot, "robot")
        if substeps is not None and whole(substeps, "substeps", 1) > _MOST_SUBSTEPS:
            raise InputError(f"must be at most {_MOST_SUBSTEPS}, got {substeps}.", where="substeps")
        self.torque_limits, self.substeps = limits_of(robot, torque_limits), substeps
        self.compensation = compensation_of(robot, compensation)
        self.nv = int(robot.model.nv)

    def steps_in(self, dt: float) -> int:
        """Return how many integration steps make dt [s]."""
        return self.substeps or ceil(dt / self.longest_step - 1e-9)

    def motors(self, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give now when asked for one (nv)."""
        return self.motors_at(self._q, torque)

    def motors_at(self, q: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give at q (nq) when asked for one (nv)."""
        torque, limits = np.asarray(torque, dtype=float), self.torque_limits
        if self.compensation is not None:
            torque = torque + self.compensation(q)
        if limits is None:
            return torque
        given = np.empty(torque.size)
        kernels.hold(torque, limits, given)
        return given


Engine: TypeAlias = Callable[..., SimulatedPlant]
"""What makes a plant of a true robot: called with it, torque_limits, compensation, substeps."""
