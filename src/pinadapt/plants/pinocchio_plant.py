"""A robot simulated with Pinocchio."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from .._checks import word
from .._compiled import compiled
from ..exceptions import DivergedError
from ..records import Measurement
from ..robot.changes import Friction, Shaft
from ..robot.motors import Actuators, Compensation
from ..robot.robot import Robot, check_successor
from .plant import SimulatedPlant

_SMALL = 1e-4  # below which tanh(x) / x is taken from its series


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
    coupling of the joints, so M_ii may be taken at the home configuration.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the model; the rotor inertias of the copy are overwritten in every step."""
        self._robot = robot
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._armature = self._model.armature  # a view, to write into
        rotors = np.array(self._armature)
        inertia = np.diag(pin.crba(self._model, self._data, robot.q0)).copy()
        self._friction, self._present = robot.friction, robot.friction.present
        self._theta, self._drive = np.full((2, self._model.nv), 0.5)
        self._constants = self._friction.shape, inertia, rotors
        self._fitted = self._armature, self._drive, self._theta
        self._loaded = _LoadedFriction(robot)

    def __call__(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq) and v (nv) after h [s] under a held torque tau (nv)."""
        half, solve = 0.5 * h, self._damped if self._present else self._free
        change = half * solve(q, v, v, tau, half)
        change = h * solve(pin.integrate(self._model, q, half * v), v + change, v, tau, h)
        way = h * (v + self._theta * change)
        return pin.integrate(self._model, q, way), v + change

    def __reduce__(self) -> tuple[type[FittedMidpoint], tuple[Robot]]:
        """Pickle the robot only, as a view of the model's memory cannot be copied."""
        return FittedMidpoint, (self._robot,)

    def _free(
        self, q: np.ndarray, v: np.ndarray, start: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return the acceleration a (nv) without friction."""
        return pin.aba(self._model, self._data, q, v, tau)

    def _damped(
        self, q: np.ndarray, v: np.ndarray, start: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return a (nv) with terms at q and v, for a step of h [s] from velocity ``start``."""
        part = self._loaded.at(q)
        coefficients = part.viscous, part.coulomb, part.asymmetry, part.offset
        _fit(*coefficients, *self._constants, h, v, start, tau, *self._fitted)
        if not part.shafts:
            return pin.aba(self._model, self._data, q, v, self._drive)
        M = symmetric(pin.crba(self._model, self._data, q))
        drive = self._drive - pin.nonLinearEffects(self._model, self._data, q, v)
        for d, shaft in zip(part.directions, part.shafts, strict=True):
            D = _shaft_secant(shaft, float(d @ v))
            drive -= D * float(d @ start) * d
            M += (shaft.armature + h * D) * np.outer(d, d)  # implicit
        return np.asarray(np.linalg.solve(M, drive))


class _LoadedFriction:
    """The friction of a robot at a configuration, under the gravity torque there."""

    def __init__(self, robot: Robot) -> None:
        self._friction, self._model = robot.friction, robot.friction.bodies or robot.model
        self._data = self._model.createData() if robot.friction.loaded else None

    def at(self, q: np.ndarray) -> Friction:
        """Return the friction at configuration q (nq)."""
        if self._data is None:
            return self._friction
        return self._friction.under(pin.computeGeneralizedGravity(self._model, self._data, q))


def symmetric(upper: np.ndarray) -> np.ndarray:
    """Return the symmetric matrix (n, n) whose upper half is given, in new memory."""
    return np.asarray(np.triu(upper) + np.triu(upper, 1).T)


def _shaft_secant(shaft: Shaft, u: float) -> float:
    """Return the friction of a shaft over its speed u."""
    x = u / shaft.threshold
    ratio = 1.0 - x * x / 3.0 if abs(x) < _SMALL else math.tanh(x) / x
    return shaft.viscous + shaft.coulomb / shaft.threshold * ratio


@compiled(
    "void(f8[:], f8[:], f8[:], f8[:], f8[:,:], f8[:], f8[:], f8, f8[:], f8[:], f8[:], "
    "f8[:], f8[:], f8[:])",
    fills=3,
)
def _fit(
    viscous: np.ndarray,
    coulomb: np.ndarray,
    asymmetry: np.ndarray,
    offset: np.ndarray,
    shape: np.ndarray,
    inertia: np.ndarray,
    rotors: np.ndarray,
    h: float,
    v: np.ndarray,
    start: np.ndarray,
    tau: np.ndarray,
    armature: np.ndarray,
    drive: np.ndarray,
    theta: np.ndarray,
) -> None:
    """Write rotors + theta h D, tau - D start and theta (nv) of ``FittedMidpoint``."""
    for i in range(len(v)):
        x = v[i] / shape[0, i]
        ratio = 1.0 - x * x / 3.0 if abs(x) < 1e-4 else math.tanh(x) / x
        if shape[1, i] != 0.0:
            ratio *= 1.0 + shape[1, i] * math.exp(-abs(v[i]) * shape[2, i])
        dry = coulomb[i] + asymmetry[i] if v[i] >= 0.0 else coulomb[i] - asymmetry[i]
        D = viscous[i] + dry / shape[0, i] * ratio
        z = h * D / inertia[i]
        theta[i] = 0.5 + z / 12.0 if z < 1e-3 else -1.0 / math.expm1(-z) - 1.0 / z
        armature[i] = rotors[i] + theta[i] * h * D
        drive[i] = tau[i] - offset[i] - D * start[i]


class RungeKutta:
    """The classical Runge-Kutta method of fourth order in the step h.

    It evaluates the forward dynamics four times per step. It is explicit: stable only if h times
    the decay rate of the friction, coulomb / (threshold M_ii) near rest, is below 2.8; see
    ``FittedMidpoint``.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the model."""
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._loaded, self._present = _LoadedFriction(robot), robot.friction.present

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the joint acceleration (nv) under torque tau (nv), friction included."""
        if not self._present:
            return np.asarray(pin.aba(self._model, self._data, q, v, tau))
        friction = self._loaded.at(q)
        return _accelerated(self._model, self._data, q, v, tau - friction.torque(v), friction)

    def __call__(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq) and v (nv) after h [s] under a held torque tau (nv).

        Averaging the tangent steps is exact: the group of each revolute, continuous or prismatic
        joint is commutative.
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


def _accelerated(
    model: pin.Model,
    data: pin.Data,
    q: np.ndarray,
    v: np.ndarray,
    drive: np.ndarray,
    friction: Friction,
) -> np.ndarray:
    """Return the acceleration (nv) under a torque less friction, with the inertia of shafts."""
    if not friction.shafts:
        return np.asarray(pin.aba(model, data, q, v, drive))
    M = _with_shafts(symmetric(pin.crba(model, data, q)), friction)
    return np.asarray(np.linalg.solve(M, drive - pin.nonLinearEffects(model, data, q, v)))


def _with_shafts(M: np.ndarray, friction: Friction) -> np.ndarray:
    """Return a mass matrix (nv, nv) with the rotor inertias of the shafts added."""
    for d, shaft in zip(friction.directions, friction.shafts, strict=True):
        M = M + shaft.armature * np.outer(d, d)
    return M


INTEGRATORS: dict[str, type[FittedMidpoint] | type[RungeKutta]] = {
    "midpoint": FittedMidpoint,
    "runge-kutta": RungeKutta,
}


class PinocchioPlant(SimulatedPlant):
    """A robot simulated with Pinocchio, from its home pose at rest.

    ``measure``, ``step`` and ``acceleration`` use the state of the plant; methods that take q and v
    do not depend on it.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        actuators: Actuators | None = None,
        substeps: int | None = None,
        integrator: str = "midpoint",
    ) -> None:
        """Copy the model of the true robot.

        Args:
            robot: the true robot.
            torque_limits: (nv) limits of the motor torques [N m or N], or None.
            compensation: function of q (nq): torque that the arm adds to the command, or None.
            actuators: how a commanded torque comes to the links; None: ideal ones.
            substeps: integration steps per ``step``; None: chosen.
            integrator: "midpoint", see ``FittedMidpoint``, or "runge-kutta".

        Raises:
            InputError: unknown integrator, less than one substep, or elastic actuators.
        """
        word(integrator, INTEGRATORS, "integrator")
        super().__init__(
            robot,
            torque_limits=torque_limits,
            compensation=compensation,
            actuators=actuators,
            substeps=substeps,
        )
        self._first, self._integrator = robot, INTEGRATORS[integrator]
        self._take(robot)
        self.reset()

    def reset(self) -> None:
        """Return to the first robot, at its home pose at rest, at time 0."""
        super().reset()
        if self.robot is not self._first:
            self._take(self._first)
        self._t, self._q, self._v = 0.0, self.robot.q0, np.zeros(self.nv)

    def become(self, robot: Robot) -> None:
        """Replace the robot at the same q, v and time; the torque limits stay.

        Raises:
            RobotError: it has another chain, frame or task.
        """
        check_successor(self.robot, robot, "robot")
        self._take(robot)

    def _take(self, robot: Robot) -> None:
        """Copy the model of a robot."""
        self.robot, self._model = robot, robot.model.copy()
        self._data = self._model.createData()
        self._motion = robot.task.motion_of(self._model, self._data, robot.frame_id)
        self._integrate, self._loaded = self._integrator(robot), _LoadedFriction(robot)

    def measure(self) -> Measurement:
        """Return what ideal sensors measure now."""
        return self.measurement(self._q, self._v, self._t)

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (nv) that the motors apply [N m or N]."""
        q, v, count = self._q, self._v, self.steps_in(dt)
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
        friction = self._loaded.at(q)
        if friction.present:
            tau = tau - friction.torque(v)
        if feedthrough is None:
            return _accelerated(self._model, self._data, q, v, tau, friction)
        M = _with_shafts(pin.crba(self._model, self._data, q), friction)
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
        """Return what ideal sensors measure at q (nq), v (nv) and time t [s]."""
        x, xd = self._motion(q, v)
        return Measurement(t, q, v, x, None, xd, None, None)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the true M(q) (nv, nv)."""
        return np.asarray(_with_shafts(pin.crba(self._model, self._data, q), self.robot.friction))

    def friction_at(self, q: np.ndarray) -> Friction:
        """Return the friction at configuration q (nq), under the gravity torque there."""
        return self._loaded.at(q)

    def coriolis_matrix(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the true C(q, v) (nv, nv), dM/dt = C + C^T."""
        return np.array(pin.computeCoriolisMatrix(self._model, self._data, q, v))

    def integrate(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return q moved by a tangent step (nv) [rad or m]."""
        return np.asarray(pin.integrate(self._model, q, step))
