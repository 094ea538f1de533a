"""A robot simulated by Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .._checks import word
from ..exceptions import DivergedError
from ..records import Measurement, named
from ..robot.gravity import Compensation
from ..robot.robot import Robot
from ..robot.succession import check_successor
from .midpoint import FittedMidpoint
from .runge_kutta import RungeKutta
from .simulated_plant import SimulatedPlant

INTEGRATORS: dict[str, type[FittedMidpoint] | type[RungeKutta]] = {
    "midpoint": FittedMidpoint,
    "runge-kutta": RungeKutta,
}


class PinocchioPlant(SimulatedPlant):
    """A robot that moves as its true model says, from its home and from rest.

    ``measure``, ``step`` and ``acceleration`` are of the plant's own state; the methods that take q
    and v are pure.
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
        word(integrator, INTEGRATORS, "integrator")
        super().__init__(
            robot, torque_limits=torque_limits, compensation=compensation, substeps=substeps
        )
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
        self._motion = robot.task.motion_of(self._model, self._data, robot.frame_id)
        self._integrate = self._integrator(robot)

    def measure(self) -> Measurement:
        """Return what perfect sensors say now."""
        return self.measurement(self._q, self._v, self._t)

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Hold what the motors give now, asked for a torque (nv) [N m or N], for dt [s]."""
        tau, q, v = self.motors(torque), self._q, self._v
        count = self.steps_in(dt)
        for _ in range(count):
            q, v = self._integrate(q, v, tau, dt / count)
        self._q, self._v, self._t = q, v, self._t + dt

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
        return self._motion(q, v)

    def measurement(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> Measurement:
        """Return what perfect sensors say at configuration q (nq), velocity v (nv), time t [s]."""
        x, xd = self._motion(q, v)
        return named(Measurement, (t, q, v, x, None, xd, None, None))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the true M(q) (nv, nv)."""
        return np.asarray(pin.crba(self._model, self._data, q))

    def coriolis_matrix(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the true C(q, v) (nv, nv), dM/dt = C + C^T."""
        return np.array(pin.computeCoriolisMatrix(self._model, self._data, q, v))

    def integrate(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return q moved by a tangent step (nv) [rad or m]."""
        return np.asarray(pin.integrate(self._model, q, step))
