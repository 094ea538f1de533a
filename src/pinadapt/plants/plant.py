"""What a controller drives: a simulated robot, or a real one."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from .._checks import instance, whole
from .._compiled import Matrix, Vector, compiled
from ..exceptions import DivergedError, InputError, RobotError
from ..records import Measurement
from ..robot.changes import Friction
from ..robot.motors import (
    Actuators,
    CommandsUnderway,
    Compensation,
    LateTorque,
    compensation_of,
)
from ..robot.motors import torque_limits as limits_of
from ..robot.robot import Robot, check_successor


class Plant(ABC):
    """A robot that can be measured and moved: the interface that a closed loop needs.

    Attributes:
        nv: number of joints.
    """

    nv: int

    @abstractmethod
    def reset(self) -> None:
        """Return to the initial state and to time 0."""

    @abstractmethod
    def measure(self) -> Measurement:
        """Return the current q, v, task coordinates x and task velocity xd, with their time."""

    @abstractmethod
    def step(self, torque: np.ndarray, dt: float) -> None:
        """Command a torque (nv) [N m or N] and hold it for dt [s]; see ``motors``."""

    def become(self, robot: Robot) -> None:
        """Replace the robot at the same q, v and time, until the next ``reset``.

        Loads, tools, lengths and friction may differ, the joints may not.

        Raises:
            InputError: this plant cannot be changed during a motion.
            RobotError: the robot has another chain, frame or task.
        """
        raise InputError(
            f"{type(self).__name__} cannot become another robot during a motion.", where="changes"
        )

    def motors(self, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors apply now for a commanded one (nv) [N m or N]."""
        return torque


# [s]; integration errors stay below 0.1 % of the tracking error. They grow with its square.
LONGEST_STEP = 1e-3  # half, twice: a quarter of them, four times


class SimulatedPlant(Plant):
    """A simulated robot that starts at its home pose at rest, with limited motor torques.

    A subclass moves under a held torque, ``hold``; delay and bandwidth of the motors are here.

    Attributes:
        robot: the true robot as it is now; ``reset`` restores the first one.
        nv: number of joints.
        torque_limits: (nv) limits of the motor torques [N m or N], infinite for unlimited joints;
            or None.
        compensation: function of q (nq): torque that the arm itself adds to the command; or None.
            The limits apply to the sum.
        actuators: how a commanded torque comes to the links; what the arm adds is late too.
        substeps: integration steps per ``step``; None: as many as ``longest_step`` requires.
        longest_step: largest integration step [s] if ``substeps`` is None.
        described: whether the simulated parameters are those of ``robot``. If not, only joints and
            frame are, and the true parameters are unknown.
        springs: whether joints of this class may be elastic.
        bilateral: whether contacts neither lift nor slide.
    """

    longest_step: float = LONGEST_STEP
    described: bool = True
    springs = False
    bilateral = False

    def __init__(
        self,
        robot: Robot,
        *,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        actuators: Actuators | None = None,
        substeps: int | None = None,
    ) -> None:
        """Take the robot and the properties of its motors; see the attributes.

        Raises:
            InputError: not a robot, limits, compensation or actuators of a wrong size, springs that
                this plant has not, or less than one substep.
        """
        self._first = instance(robot, Robot, "robot")
        self.substeps = None if substeps is None else whole(substeps, "substeps", 1)
        self.torque_limits = limits_of(robot, torque_limits)
        self.compensation = compensation_of(robot, compensation)
        self.nv = robot.model.nv
        self.actuators = instance(actuators or Actuators(), Actuators, "actuators")
        if self.actuators.elastic and not self.springs:
            raise InputError(
                f"{type(self).__name__} has rigid joints.",
                where="actuators.stiffness",
                hint='Springs are simulated by ElasticPlant, with engine = "pinocchio".',
            )
        self._late = LateTorque(self.actuators.of(robot)) if self.actuators.late else None
        self._underway: CommandsUnderway | None = None

    def reset(self) -> None:
        """Return to the first robot, at its home pose at rest, at time 0."""
        self._underway = None
        self._take(self._first)
        self._t = 0.0
        self._q = self.robot.q0
        self._v = np.zeros(self.nv)

    def become(self, robot: Robot) -> None:
        """Replace the robot at the same q, v and time; torque limits and springs stay.

        Raises:
            RobotError: it has another chain, frame or task, or parameters that this plant has not.
        """
        check_successor(self.robot, robot, "robot")
        self._take(robot)

    def _take(self, robot: Robot) -> None:
        """Move as a robot from now on; a subclass takes what else it needs of it."""
        self.robot = robot
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._motion = partial(robot.task.motion, self._model, self._data, robot.frame_id)

    @abstractmethod
    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (nv) that the motors apply [N m or N]."""

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Command a torque (nv) [N m or N], and move for dt [s] under what the motors apply.

        Raises:
            InputError: a torque of another size.
            DivergedError: the torque is not finite.
        """
        tau = np.asarray(self.motors(torque), dtype=float)
        if tau.shape != (self.nv,):
            raise InputError(f"expected {self.nv} numbers, got {tau.shape}.", where="torque")
        if not math.isfinite(tau.dot(tau)) and not np.isfinite(tau).all():  # the first is quick
            raise DivergedError("the torque is not finite.", self._t)
        if self._late is None:
            self.hold(tau, dt)
            return
        pieces, self._underway = self._late.after(self._underway, tau, dt, LONGEST_STEP)
        for applied, part in pieces:
            self.hold(applied, part)

    def steps_in(self, dt: float) -> int:
        """Return the number of integration steps in dt [s]."""
        return self.substeps or max(math.ceil(dt / self.longest_step - 1e-9), 1)

    def motors(self, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors are to apply for a commanded one (nv) [N m or N].

        It is limited, and holds what the arm adds by itself; late motors apply it later.
        """
        return self.motors_at(self._q, torque)

    def motors_at(self, q: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that the motors apply at q (nq) for a commanded one (nv)."""
        limits = self.torque_limits
        if self.compensation is not None:
            torque = torque + self.compensation(q)
        if limits is None:
            return torque
        return np.minimum(np.maximum(torque, -limits), limits)


PlantMaker: TypeAlias = Callable[..., SimulatedPlant]
"""Function of a true robot that returns its plant.

Its options are torque_limits, compensation, substeps, and actuators where these are not ideal.
"""


def refuse_missing(robot: Robot, simulator: str, *known: type) -> None:
    """Refuse friction and constraints, all but those of ``known`` kinds, that a simulator lacks.

    Raises:
        InputError: a constraint of another kind.
        RobotError: friction other than viscous and Coulomb.
    """
    if not robot.friction.plain:
        raise RobotError(
            f"{simulator} has viscous and Coulomb friction alone, without offsets, loads, Stribeck "
            "effects and coupled shafts.",
            where="friction",
            hint="Simulate rigid joints with Pinocchio, or take pa.Friction(viscous, coulomb).",
        )
    for part in robot.constraints:
        if not isinstance(part, known):
            raise InputError(
                f"{simulator} would simulate the robot without {part}.",
                where="engine",
                hint='Take engine="pinocchio".',
            )


def fitted_friction(
    friction: Friction,
    inertia: np.ndarray,
    v: np.ndarray,
    start: np.ndarray,
    tau: np.ndarray,
    h: float,
) -> np.ndarray:
    """Return rows (4, nv) for a step of h [s]: D, theta, theta h D and tau - offset - D start.

    The friction torque at v (nv) without its offset is D v, D its secant; for theta, and what is
    solved with the other rows, see ``FittedMidpoint``.
    """
    fitted = np.empty((4, len(v)))
    dry = friction.coulomb, friction.asymmetry, friction.shape, friction.offset
    _fit(friction.viscous, *dry, inertia, v, start, tau, h, fitted)
    return fitted


@compiled()
def _fit(
    viscous: Vector,
    coulomb: Vector,
    asymmetry: Vector,
    shape: Matrix,
    offset: Vector,
    inertia: Vector,
    v: Vector,
    start: Vector,
    tau: Vector,
    h: float,
    fitted: Matrix,
) -> None:
    """Write the rows of ``fitted_friction``."""
    for i in range(len(v)):
        x = max(abs(v[i]) / shape[0, i], 1e-6)
        sigma = math.tanh(x) * (1.0 + shape[1, i] * math.exp(-abs(v[i]) * shape[2, i]))
        dry = coulomb[i] + asymmetry[i] * math.copysign(1.0, v[i])
        D = viscous[i] + dry * sigma / (x * shape[0, i])
        z = h * D / inertia[i]
        theta = 0.5 + z / 12.0 if z < 1e-3 else -1.0 / math.expm1(-z) - 1.0 / z
        fitted[0, i], fitted[1, i] = D, theta
        fitted[2, i], fitted[3, i] = theta * h * D, tau[i] - offset[i] - D * start[i]
