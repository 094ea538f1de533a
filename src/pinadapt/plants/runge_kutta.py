"""One integration step of a robot by the classical Runge-Kutta method."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..robot.robot import Robot


class RungeKutta:
    """Fourth order in the step h, four forward dynamics a step, explicit.

    Stable only while h times the decay rate of the friction, coulomb / (threshold M_ii) near rest,
    is below 2.8; see ``FittedMidpoint``.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the model."""
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._friction, self._present = robot.friction, robot.friction.present

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the joint acceleration (nv) under torque tau (nv), friction included."""
        drive = tau - self._friction.torque(v) if self._present else tau
        return np.asarray(pin.aba(self._model, self._data, q, v, drive))

    def __call__(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq) and v (nv) after h [s] under a held torque tau (nv).

        One-joint groups commute, so averaging the tangent steps is exact for revolute, continuous
        and prismatic joints.
        """
        model, half, integrate = self._model, 0.5 * h, pin.integrate
        a1 = self.acceleration(q, v, tau)
        v2 = v + half * a1
        a2 = self.acceleration(integrate(model, q, half * v), v2, tau)
        v3 = v + half * a2
        a3 = self.acceleration(integrate(model, q, half * v2), v3, tau)
        v4 = v + h * a3
        a4 = self.acceleration(integrate(model, q, h * v3), v4, tau)
        dq = (h / 6.0) * (v + 2.0 * (v2 + v3) + v4)
        return integrate(model, q, dq), v + (h / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)
