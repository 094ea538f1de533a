"""A robot simulated by Pinocchio."""

from __future__ import annotations

from math import ceil

import numpy as np
import pinocchio as pin

from .._checks import instance, whole, word
from ..exceptions import DivergedError, InputError
from ..records import Measurement
from ..robot.effort_limits import torque_limits as limits_of
from ..robot.gravity import Compensation, compensation_of
from ..robot.robot import Robot
from ..robot.succession import check_successor
from .midpoint import FittedMidpoint
from .plant import Plant
from .runge_kutta import RungeKutta

LONGEST_STEP = 1e-3  # [s]; integration errors stay below a thousandth of the tracking error

_MOST_SUBSTEPS = 100_000

INTEGRATORS: dict[str, type[FittedMidpoint] | type[RungeKutta]] = {
    "midpoint": FittedMidpoint,
    "runge-kutta": RungeKutta,
}


class PinocchioPlant(Plant):
    """A robot that moves as its true model says, from its home and from rest.

    ``measure``, ``step`` and ``acceleration`` are of the plant's own state; the methods that take q
    and v are pure.

    Attributes:
        robot: the true robot as it is now; ``reset`` brings back the first one.
        nv: number of joints.
        torque_limits: (nv) bounds the motors clip at [N m or N], infinite where there is none, or
            None.
        compensation: what the arm's own electronics add to the torque asked for, of q (nq), or None
            for nothing; the motors clip the sum.
        substeps: integration steps in each ``step``; None for as many as ``LONGEST_STEP`` asks.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        substeps: int | None = None,
        integrator: str = "midpoint",
    ) -> None:
        """Copy the true robot's model; the integrator is "midpoint" or "runge-kutta".

        Raises:
            InputError: unknown integrator, or less than one substep.
        """
        instance(robot, Robot, "robot")
        word(integrator, INTEGRATORS, "integrator")
        if substeps is not None and whole(substeps, "substeps", 1) > _MOST_SUBSTEPS:
            raise InputError(f"must be at most {_MOST_SUBSTEPS}, got {substeps}.", where="substeps")
        self.torque_limits, self.substeps = limits_of(robot, torque_limits), substeps
        self.compensation = compensation_of(robot, compensation)
        self.nv = int(robot.model.nv)
        self._first, self._integrator = robot, INTEGRATORS[integrator]
        self._take(robot)
        self.reset()

    def reset(self) -> None:
        """Go home, at rest, at time 0, as the first robot."""
        if self.robot is not self._first:
            self._take(self._first)
        self._t, self._q, self._v = 0.0, self.robot.q0, np.zeros(self.nv)

    def become(self, robot: Robot) -> None:
        """Be another robot from now on, at the same q, v and time; the motors keep their limits.

        Raises:
            RobotError: it has another chain, frame or task.
        """
        check_successor(self.robot, robot, "robot")
        self._take(robot)

    def _take(self, robot: Robot) -> None:
        """Copy what moves."""
        self.robot, self._model = robot, robot.model.copy()
        self._data = self._model.createData()
        self._frame, self._task = robot.frame_id, robot.task
        self._integrate = self._integrator(robot)

    def measure(self) -> Measurement:
        """Return what perfect sensors say now."""
        return self.measurement(self._q, self._v, self._t)

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Hold what the motors give now, asked for a torque (nv) [N m or N], for dt [s]."""
        tau, q, v = self.motors(torque), self._q, self._v
        count = self.substeps or ceil(dt / LONGEST_STEP - 1e-9)
        for _ in range(count):
            q, v = self._integrate(q, v, tau, dt / count)
        self._q, self._v, self._t = q, v, self._t + dt

    def motors(self, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give now when asked for one (nv)."""
        return self.motors_at(self._q, torque)

    def motors_at(self, q: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give at q (nq) when asked for one (nv)."""
        limits = self.torque_limits
        if self.compensation is not None:
            torque = torque + self.compensation(q)
        return torque if limits is None else np.minimum(np.maximum(torque, -limits), limits)

    def acceleration(self, torque: np.ndarray, feedthrough: np.ndarray | None = None) -> np.ndarray:
        """Return the joint acceleration a (nv) that torque + feedthrough @ a causes now."""
        return self.acceleration_at(self._q, self._v, torque, feedthrough)

    def acceleration_at(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, feedthrough: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the acceleration a (nv) at q, v under torque tau + feedthrough @ a and friction.

        Raises:
            DivergedError: M - feedthrough is singular.
        """
        friction = self.robot.friction
        if friction.present:
            tau = tau - friction.torque(v)
        if feedthrough is None:
            return np.asarray(pin.aba(self._model, self._data, q, v, tau))
        M = pin.crba(self._model, self._data, q)
        bias = pin.nonLinearEffects(self._model, self._data, q, v)
        try:
            return np.asarray(np.linalg.solve(M - feedthrough, tau - bias))
        except np.linalg.LinAlgError as error:
            raise DivergedError(
                "the algebraic loop of torque and acceleration became singular."
            ) from error

    def task_motion(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the true task coordinates x and velocity xd at q, v; see ``Task``."""
        return self._task.motion(self._model, self._data, self._frame, q, v)

    def measurement(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> Measurement:
        """Return what perfect sensors say at configuration q (nq), velocity v (nv), time t [s]."""
        x, xd = self._task.motion(self._model, self._data, self._frame, q, v)
        return Measurement(t, q, v, x, None, xd)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the true M(q) (nv, nv)."""
        return np.asarray(pin.crba(self._model, self._data, q))

    def integrate(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return q moved by a tangent step (nv) [rad or m]."""
        return np.asarray(pin.integrate(self._model, q, step))
