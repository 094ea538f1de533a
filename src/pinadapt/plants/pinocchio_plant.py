"""A robot simulated with Pinocchio."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from ..models.typical_motion import joint_inertia
from ..records import Measurement
from ..robot.robot import Robot
from ..tasks.task import Moving
from .plant import SimulatedPlant, fitted_friction


class FittedMidpoint:
    """Integrator of second order in the step h, stable for any friction.

    It evaluates the forward dynamics twice per step. Friction is stiff: near rest,
    tau_f = viscous v + coulomb sigma(v) has the slope coulomb / threshold, and a light
    wrist stops within microseconds. Therefore friction is written with its secant, tau_f = D(v) v,
    D_i = viscous_i + coulomb_i sigma(v_i) / v_i, which is bounded, and is
    integrated implicitly. Both stages start from v and solve, with D at the latest velocity,

        (M + theta h D) a = tau - C v - g - D v.

    The articulated-body algorithm does so if theta h D is added to the rotor inertias. The first
    stage takes h / 2 at the start and gives the state at the midpoint; the second takes h with the
    terms at the midpoint. The step ends at v + h a, and q moves with v + theta h a.

    theta_i = 1 / (1 - exp(-z_i)) - 1 / z_i, z_i = h D_i / M_ii, reproduces the exponential decay of
    one joint under viscous friction exactly (W. Liniger, R. A. Willoughby, *Efficient integration
    methods for stiff systems of ordinary differential equations*, SIAM J. Numer. Anal. 7 (1970)
    47-66). For small z_i it is 1/2 + z_i / 12, hence the second order; for large z_i it tends to 1,
    hence L-stability. As theta_i >= 1/2, friction alone never increases the velocity, for any
    coupling of the joints, so M_ii may be taken at the home configuration. Of coupled shafts it is
    (1 + z) / (2 + z): one alone decays by 1 / (1 + z + z^2 / 2), of second order and L-stable too.

    Under constraints A v = 0 both stages solve for their forces too, and q moves with the mean of v
    and v + h a, which keep them both.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the model; friction overwrites the rotor inertias of the copy in every step."""
        self._robot = robot
        self._model = robot.model.copy()
        self._theta = 0.5
        self._data = self._model.createData()
        self._rotors = np.array(robot.model.armature)
        self._inertia = joint_inertia(robot)
        self._constraints = robot.constrained
        self._free = not (robot.friction.present or robot.constraints)

    def __call__(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float) -> Moving:
        """Return q (nq) and v (nv) after h [s] under a held torque tau (nv)."""
        half = 0.5 * h
        solve = self._acceleration
        change = half * solve(q, v, v, tau, half)
        change = h * solve(pin.integrate(self._model, q, half * v), v + change, v, tau, h)
        way = h * (v + (0.5 if self._robot.constraints else self._theta) * change)
        return pin.integrate(self._model, q, way), v + change

    def _acceleration(
        self, q: np.ndarray, v: np.ndarray, start: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return a (nv) with terms at q and v, for a step of h [s] from velocity ``start``."""
        model = self._model
        data = self._data
        if self._free:
            return pin.aba(model, data, q, v, tau)
        robot = self._robot
        part = robot.friction_at(q) if robot.friction.loaded else robot.friction
        _, self._theta, added, tau = fitted_friction(part, self._inertia, v, start, tau, h)
        model.armature = self._rotors + added
        if not (part.shafts or robot.constraints):
            return pin.aba(model, data, q, v, tau)
        M = pin.crba(model, data, q)
        force = tau - pin.nonLinearEffects(model, data, q, v)
        for d, shaft in zip(part.directions, part.shafts, strict=True):
            x = max(abs(d @ v) / shaft.threshold, 1e-6)
            secant = shaft.viscous + shaft.coulomb / shaft.threshold * math.tanh(x) / x
            force -= secant * (d @ start) * d
            z = h * secant * np.sum(d * d / self._inertia)
            theta = (1.0 + z) / (2.0 + z)
            M += (shaft.armature + theta * h * secant) * np.outer(d, d)
        return self.solved(M, force, q, v)

    def solved(self, M: np.ndarray, force: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return a (nv) of M a = force + A^T lambda, A a = -dA/dt v with the constraints A."""
        A, A_rate = self._constraints.at(q, v)
        both = np.block([[M, -A.T], [A, np.zeros((len(A), len(A)))]])
        found = np.linalg.solve(both, np.concatenate([force, -A_rate @ v]))
        return found[: len(force)]


class PinocchioPlant(SimulatedPlant):
    """A robot simulated with Pinocchio, from its home pose at rest.

    Contacts neither lift nor slide, whatever force that takes; MuJoCo's do.

    ``measure`` and ``step`` use the state of the plant; methods that take q and v do not depend on
    it.
    """

    bilateral = True

    def __init__(self, robot: Robot, **options: Any) -> None:
        """Copy the model of the true robot; the options are those of ``SimulatedPlant``.

        Raises:
            InputError: as of ``SimulatedPlant``.
        """
        super().__init__(robot, **options)
        self.reset()

    def _take(self, robot: Robot) -> None:
        """Take its equation of motion too."""
        super()._take(robot)
        self._integrate = FittedMidpoint(robot)

    def measure(self) -> Measurement:
        """Return what ideal sensors measure now."""
        return self.measurement(self._q, self._v, self._t)

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (nv) that the motors apply [N m or N]."""
        q = self._q
        v = self._v
        count = self.steps_in(dt)
        for _ in range(count):
            q, v = self._integrate(q, v, tau, dt / count)
        self._q = q
        self._v = v
        self._t += dt

    def acceleration_at(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, feedthrough: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the acceleration a (nv) at q, v under torque tau + feedthrough @ a and friction.

        Raises:
            LinAlgError: M - feedthrough is singular.
        """
        M = self.mass_matrix(q)
        friction = self.robot.friction_at(q).torque(v)
        M = M if feedthrough is None else M - feedthrough
        force = tau - friction - pin.nonLinearEffects(self._model, self._data, q, v)
        return self._integrate.solved(M, force, q, v)

    def measurement(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> Measurement:
        """Return what ideal sensors measure at q (nq), v (nv) and time t [s]."""
        x, xd = self._motion(q, v)
        return Measurement(t, q, v, x, None, xd)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the true M(q) (nv, nv), with the rotor inertias of coupled shafts."""
        friction = self.robot.friction
        rotors = np.array([shaft.armature for shaft in friction.shafts])
        coupled = friction.directions.T * rotors @ friction.directions
        return pin.crba(self._model, self._data, q) + coupled

    def coriolis_matrix(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the true C(q, v) (nv, nv), dM/dt = C + C^T."""
        return pin.computeCoriolisMatrix(self._model, self._data, q, v)

    def integrate(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return q moved by a tangent step (nv) [rad or m]."""
        return pin.integrate(self._model, q, step)
