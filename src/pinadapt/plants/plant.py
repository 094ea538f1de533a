"""What a controller drives: a robot in a simulator, or one on a bench."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ..exceptions import InputError
from ..records import Measurement
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
