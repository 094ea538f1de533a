"""What robots simulated by any engine have in common."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import TypeAlias

import numpy as np

from .._checks import instance, whole
from .._kernels import watch as kernels
from ..exceptions import InputError
from ..robot.effort_limits import torque_limits as limits_of
from ..robot.gravity import Compensation, compensation_of
from ..robot.robot import Robot
from .plant import Plant

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
