"""The true robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..exceptions import DivergedError
from ..records import Measurement
from ..robot.robot import Robot

LARGEST_SPEED = 1e4  # [rad/s or m/s]; beyond, the loop has diverged


class PinocchioPlant:
    """A robot that moves as its true model says; no controller ever sees inside.

    Attributes:
        robot: the true robot.
        nv: number of joints.
        torque_limits: (nv) bounds the motors clip at [N m or N], infinite where there is none, or
            None.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the true robot's model."""
        self.robot = robot
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._frame = robot.frame_id
        self._friction, self._braked = robot.friction, robot.friction.present
        self.nv = int(self._model.nv)
        self.torque_limits: np.ndarray | None = None

    def motors(self, tau: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give when asked for tau (nv)."""
        limits = self.torque_limits
        return tau if limits is None else np.minimum(np.maximum(tau, -limits), limits)

    def acceleration(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, feedthrough: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the joint acceleration a (nv) under torque tau + feedthrough @ a, friction included.

        Raises:
            DivergedError: M - feedthrough is singular.
        """
        if self._braked:
            tau = tau - self._friction.torque(v)
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
        """Return the frame's true task coordinates x and velocity xd (m), in world axes; see ``Task``."""
        return self.robot.task.motion(self._model, self._data, self._frame, q, v)

    def measurement(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> Measurement:
        """Return what perfect sensors would say at configuration q (nq), velocity v (nv), time t [s]."""
        x, xd = self.task_motion(q, v)
        return Measurement(t, q, v, x, xd=xd)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the true M(q) (nv, nv)."""
        return np.asarray(pin.crba(self._model, self._data, q))

    def integrate(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return q moved by a tangent step (nv) [rad or m]."""
        return np.asarray(pin.integrate(self._model, q, step))

    def advance(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return q and v after dt [s] under a held torque, by one Runge-Kutta step of fourth order.

        One-joint groups commute, so averaging the tangent steps is exact for revolute, continuous
        and prismatic joints.
        """
        half = 0.5 * dt
        a1 = self.acceleration(q, v, tau)
        v2 = v + half * a1
        a2 = self.acceleration(self.integrate(q, half * v), v2, tau)
        v3 = v + half * a2
        a3 = self.acceleration(self.integrate(q, half * v2), v3, tau)
        v4 = v + dt * a3
        a4 = self.acceleration(self.integrate(q, dt * v3), v4, tau)
        dq = (dt / 6.0) * (v + 2.0 * (v2 + v3) + v4)
        return self.integrate(q, dq), v + (dt / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)
