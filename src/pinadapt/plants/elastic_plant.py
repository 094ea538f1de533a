"""A robot with elastic joints: its motors move the links through springs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import InputError, RobotError
from ..records import Measurement
from ..robot.motors import Actuators
from ..robot.robot import Robot
from .plant import SimulatedPlant, fitted_friction, refuse_missing


class ElasticPlant(SimulatedPlant):
    """M a + C v + g = K d + D (w - v), B dw/dt = tau - K d - D (w - v) - f(w), dd/dt = w - v.

    v is the velocity of the links, w that of the motors after their gears, d the deflection of the
    springs: motor minus link position. B is the armature of the robot and f its friction, both at
    the motors. M is the mass matrix of the links alone. M. Spong, *Modeling and control of elastic
    joint robots*, J. Dyn. Syst. Meas. Control 109 (1987) 310-319. For infinite K the motion is that
    of ``PinocchioPlant``.

    The links start at the home pose at rest, with the springs loaded by gravity. x and xd are those
    of the links, whatever the encoders measure.

    A step is the implicit midpoint rule in d, v and w, with M, C v + g and the secant of the
    friction at the midpoint: of second order, without numerical energy gain, stable for any
    stiffness. Friction is weighted as in ``FittedMidpoint``, so it never accelerates a motor.
    """

    springs = True

    def __init__(self, robot: Robot, *, actuators: Actuators, **options: Any) -> None:
        """Take the robot, its springs and the other options of ``SimulatedPlant``.

        Raises:
            InputError: actuators without springs, or as of ``SimulatedPlant``.
            RobotError: a motor without inertia.
        """
        super().__init__(robot, actuators=actuators, **options)
        if not actuators.elastic:
            raise InputError("expected springs, got rigid joints.", where="actuators.stiffness")
        joints = actuators.of(robot)
        self._K = joints.stiffness
        self._D = joints.damping
        self.reset()

    def reset(self) -> None:
        """Return to the first robot at its home pose at rest, springs loaded by gravity, time 0."""
        super().reset()
        self._links = self._q
        self._w = self._v
        gravity = pin.computeGeneralizedGravity(self._model, self._data, self._links)
        self._d = gravity / self._K
        self._read()

    def _take(self, robot: Robot) -> None:
        """Take its rotor inertias as those of the motors."""
        rotors = np.array(robot.model.armature)
        if not (rotors > 0.0).all():
            raise RobotError(
                f"elastic joints need motors with inertia, got the armature {rotors.tolist()} kg "
                "m^2.",
                where="armature",
                hint="Set it with Robot.changed(armature=...), in a scenario truth.armature.",
            )
        refuse_missing(robot, "elastic joints")
        super()._take(robot)
        self._B = rotors
        self._model.armature = np.zeros(self.nv)

    def _read(self) -> None:
        """Take the q and v that the encoders measure, at the links or at the motors."""
        self._q = self._links
        self._seen = self._v
        if self.actuators.encoders == "motor":
            self._q = pin.integrate(self._model, self._links, self._d)
            self._seen = self._w

    def measure(self) -> Measurement:
        """Return what ideal sensors measure now, with the motors' velocity w."""
        x, xd = self._motion(self._links, self._v)
        return Measurement(self._t, self._q, self._seen, x, None, xd, w=self._w)

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (nv) that the motors apply [N m or N]."""
        count = self.steps_in(dt)
        h = dt / count
        for _ in range(count):
            links = self._links
            before = np.array([self._v, self._w])
            means = self._means(links, before, tau, 0.5 * h)
            middle = pin.integrate(self._model, links, 0.5 * h * means[0])
            means = self._means(middle, 2.0 * means - before, tau, h)
            self._links = pin.integrate(self._model, links, h * means[0])
            self._d = self._d + h * (means[1] - means[0])
            self._v, self._w = 2.0 * means - before
        self._t += dt
        self._read()

    def _means(
        self, q: np.ndarray, velocities: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return the mean velocities (2, nv) of links and motors over h [s] from the current state.

        M, C v + g and the secant of the friction are evaluated at q and the velocities v and w.
        """
        v, w = velocities
        M = pin.crba(self._model, self._data, q)
        bias = pin.nonLinearEffects(self._model, self._data, q, v)
        inertia = 2.0 / h * self._B
        F, theta, _, _ = fitted_friction(self.robot.friction, self._B, w, w, tau, h)
        S = 0.5 * h * self._K + self._D
        E = inertia + S + 2.0 * theta * F
        pull = self._K * self._d
        drive = tau - pull + (inertia - (1.0 - 2.0 * theta) * F) * self._w
        left = 2.0 / h * M
        right = left @ self._v - bias + pull + S / E * drive
        left.flat[:: self.nv + 1] += S * (E - S) / E
        v_mean = np.linalg.solve(left, right)
        return np.array([v_mean, (drive + S * v_mean) / E])
