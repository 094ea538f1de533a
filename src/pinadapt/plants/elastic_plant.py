"""A robot with elastic joints: motors that move the links through springs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import vector, word
from ..exceptions import RobotError
from ..records import Measurement
from ..robot.changes import Friction
from ..robot.motors import Compensation
from ..robot.robot import Robot
from ..robot.succession import check_successor
from .plant import SimulatedPlant

ENCODERS = ("motor", "link")


@dataclass(frozen=True, eq=False)
class JointElasticity:
    """Springs between motors and links; as ``engine`` of a simulation it makes an elastic robot.

    Attributes:
        stiffness: K, a number or one a joint [N m/rad or N/m].
        damping: D of the springs, a number or one a joint [N m s/rad or N s/m].
        encoders: what q and qd tell, of the "motor" (behind its gear) or of the "link".
    """

    stiffness: ArrayLike
    damping: ArrayLike = 0.0
    encoders: str = "motor"

    sources = ("Spong1987",)

    def __post_init__(self) -> None:
        """Refuse an unknown side.

        Raises:
            InputError: encoders of neither side.
        """
        word(self.encoders, ENCODERS, "elasticity.encoders")

    def __call__(
        self,
        robot: Robot,
        *,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        substeps: int | None = None,
    ) -> ElasticPlant:
        """Return the robot with these springs; see ``ElasticPlant``."""
        return ElasticPlant(
            robot,
            self,
            torque_limits=torque_limits,
            compensation=compensation,
            substeps=substeps,
        )


class ElasticPlant(SimulatedPlant):
    """M a + C v + g = K d + D (w - v), B dw/dt = tau - K d - D (w - v) - f(w), dd/dt = w - v.

    v is the velocity of the links, w that of the motors behind their gears, d by how far the motors
    are ahead; B is the armature of the robot and f its friction, both of the motors. M is that of
    the links alone. M. Spong, *Modeling and control of elastic joint robots*, J. Dyn. Syst. Meas.
    Control 109 (1987) 310-319. For K to infinity it is the robot that ``PinocchioPlant`` moves.

    It starts with the links at home, at rest, and the springs loaded by gravity. x and xd are those
    of the links whatever the encoders tell.

    A step is the implicit midpoint rule in d, v and w with M, C v + g and the friction's secant at
    the middle: second order, without energy of its own, stable for any stiffness. The friction is
    weighed as in ``FittedMidpoint``, so it never makes a motor faster.

    Attributes:
        elasticity: the springs.
    """

    def __init__(
        self,
        robot: Robot,
        elasticity: JointElasticity,
        *,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        substeps: int | None = None,
    ) -> None:
        """Take the robot, its springs, and what its motors do.

        Raises:
            InputError: springs that cannot be, or limits of another size.
            RobotError: a motor without inertia.
        """
        super().__init__(
            robot, torque_limits=torque_limits, compensation=compensation, substeps=substeps
        )
        self.elasticity = elasticity
        names = robot.joint_names
        self._K = vector(elasticity.stiffness, self.nv, "elasticity.stiffness", names=names)
        self._D = vector(elasticity.damping, self.nv, "elasticity.damping", names=names)
        if not (self._K > 0.0).all() or not (self._D >= 0.0).all():
            raise RobotError(
                "expected a positive stiffness and a damping that is not negative, got "
                f"{self._K.tolist()} and {self._D.tolist()}.",
                where="elasticity",
            )
        self._first = robot
        self._take(robot)
        self.reset()

    def reset(self) -> None:
        """Go home, at rest, at time 0, as the first robot, with the springs loaded by gravity."""
        if self.robot is not self._first:
            self._take(self._first)
        self._t, self._links, self._v = 0.0, self.robot.q0, np.zeros(self.nv)
        gravity = pin.computeGeneralizedGravity(self._model, self._data, self._links)
        self._d, self._w = gravity / self._K, np.zeros(self.nv)

    def become(self, robot: Robot) -> None:
        """Be another robot from now on, in the same state; the springs stay.

        Raises:
            RobotError: it has another chain, frame or task, or a motor without inertia.
        """
        check_successor(self.robot, robot, "robot")
        self._take(robot)

    def _take(self, robot: Robot) -> None:
        """Copy what moves; the rotors are those of the motors."""
        rotors = np.array(robot.model.armature)
        if not (rotors > 0.0).all():
            raise RobotError(
                "elastic joints need motors with inertia, got the armature "
                f"{rotors.tolist()} kg m^2.",
                where="armature",
                hint="Robot.changed(armature=...), or truth.armature.",
            )
        self.robot, self._B, self._friction = robot, rotors, robot.friction
        self._model = robot.model.copy()
        self._model.armature = np.zeros(self.nv)
        self._data = self._model.createData()

    def motors(self, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors give now when asked for one (nv)."""
        return self.motors_at(self._seen(), torque)

    def _seen(self) -> np.ndarray:
        """Return the configuration (nq) that the encoders tell."""
        if self.elasticity.encoders == "link":
            return self._links
        return np.asarray(pin.integrate(self._model, self._links, self._d))

    def measure(self) -> Measurement:
        """Return what perfect sensors say now."""
        robot, model = self.robot, self._model
        x, xd = robot.task.motion(model, self._data, robot.frame_id, self._links, self._v)
        v = self._v if self.elasticity.encoders == "link" else self._w
        return Measurement(self._t, self._seen(), v, x, None, xd)

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Hold what the motors give now, asked for a torque (nv) [N m or N], for dt [s]."""
        tau, count = self.motors(torque), self.steps_in(dt)
        h = dt / count
        for _ in range(count):
            links, v, w = self._links, self._v, self._w
            v_way, w_way = self._means(links, v, w, tau, 0.5 * h)
            middle = pin.integrate(self._model, links, 0.5 * h * v_way)
            v_way, w_way = self._means(middle, 2.0 * v_way - v, 2.0 * w_way - w, tau, h)
            self._links = pin.integrate(self._model, links, h * v_way)
            self._d = self._d + h * (w_way - v_way)
            self._v, self._w = 2.0 * v_way - v, 2.0 * w_way - w
        self._t += dt

    def energy(self) -> float:
        """Return kinetic energy of links and motors, of gravity, and of the springs [J]."""
        model, data = self._model, self._data
        links = pin.computeKineticEnergy(model, data, self._links, self._v)
        height = pin.computePotentialEnergy(model, data, self._links)
        stored = 0.5 * float(self._d @ (self._K * self._d) + self._w @ (self._B * self._w))
        return float(links + height) + stored

    def _means(
        self, q: np.ndarray, v: np.ndarray, w: np.ndarray, tau: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean velocities of links and motors (nv) over h [s] from the present state.

        M, C v + g and the friction's secant are those at q, v and w.
        """
        M = pin.crba(self._model, self._data, q)
        bias = pin.nonLinearEffects(self._model, self._data, q, v)
        F, inertia = _secant(self._friction, w), 2.0 / h * self._B
        theta = _weight(h * F / self._B)
        S = 0.5 * h * self._K + self._D
        E = inertia + S + 2.0 * theta * F
        pull = self._K * self._d
        drive = tau - pull + (inertia - (1.0 - 2.0 * theta) * F) * self._w
        left = 2.0 / h * M
        right = left @ self._v - bias + pull + S / E * drive
        left.flat[:: self.nv + 1] += S * (E - S) / E
        v_mean = np.linalg.solve(left, right)
        return v_mean, (drive + S * v_mean) / E


def _secant(friction: Friction, w: np.ndarray) -> np.ndarray:
    """Return f(w) / w (nv), positive, also at rest."""
    x = np.maximum(np.abs(w) / friction.threshold, 1e-6)
    return np.asarray(friction.viscous + friction.coulomb / friction.threshold * np.tanh(x) / x)


def _weight(z: np.ndarray) -> np.ndarray:
    """Return 1 / (1 - exp(-z)) - 1 / z (nv), as in ``FittedMidpoint``."""
    safe = np.maximum(z, 1e-3)
    return np.where(z < 1e-3, 0.5 + z / 12.0, -1.0 / np.expm1(-safe) - 1.0 / safe)
