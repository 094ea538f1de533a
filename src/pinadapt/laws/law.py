"""What a control law returns, and what it must state about itself."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..adaptation.adaptation import Adaptation, Drive, Drives, Estimate
from ..exceptions import InputError
from ..filters.filters import Filters, NoFilters
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..models.typical_motion import TypicalMotion
from ..robot.changes import Friction
from ..signals import Signals
from .feedback import Feedback, KinematicLoop, SetPointLoop


@dataclass(slots=True, eq=False)
class Command:
    """A torque, affine in the joint acceleration where the law measures it.

    The torque at joint acceleration a is torque + feedthrough @ a. A law may subclass it for what
    it wants back when it adapts, so that nothing is computed twice.

    Attributes:
        torque: (n) N m or N.
        feedthrough: (n, n) or None for zero.
    """

    torque: np.ndarray
    feedthrough: np.ndarray | None = None

    def at(self, a: np.ndarray | None) -> np.ndarray:
        """Return the torque (n) at joint acceleration a (n)."""
        return self.torque if self.feedthrough is None else self.torque + self.feedthrough @ a


@dataclass(slots=True, eq=False)
class Believed:
    """The believed robot, to be asked while a command is worked out.

    Attributes:
        kinematics: evaluated at the signals' q, v and a_k.
        dynamics: with a_d loaded; a law that loads another estimate loads a_d again.
        adaptation: how the kinematic estimate moves.
        adaptation_d: how the dynamic estimate moves.
        watch: whether an M_hat that is not positive definite ends the run of a law that inverts it.
        memory: what it remembers.
        dt: [s] over which the torque will be held; None where the loop is one differential
            equation.
    """

    kinematics: TaskKinematics
    dynamics: Dynamics
    adaptation: Adaptation
    adaptation_d: Adaptation
    watch: bool = True
    memory: tuple = ()
    dt: float | None = None

    @property
    def prediction(self) -> float:
        """Bandwidth of the low pass behind ``Signals.predicted`` [1/s], infinite for none."""
        return self.adaptation_d.prediction or math.inf

    def kinematic_rate(self, s: Signals, drive: Drive) -> np.ndarray:
        """Return the rate of a_k (p_k) under a drive, by the chosen adaptation."""
        if s.adapting:
            return self.adaptation.rate(s.kinematic, drive).value
        return np.zeros(s.a_k.size)

    def dynamic_rate(self, s: Signals, drive: Drive) -> np.ndarray:
        """Return the rate of a_d (p_d) under a drive, its mean over the period that begins."""
        estimate = Estimate(s.a_d, self.memory)
        if not s.adapting:
            return np.zeros(s.a_d.size)
        if self.dt is None:
            return self.adaptation_d.rate(estimate, drive).value
        return (self.adaptation_d.step(estimate, drive, self.dt).value - s.a_d) / self.dt


class Truth(NamedTuple):
    """The true values at one instant, known in simulation only.

    Attributes:
        a_k, a_d: (p_k), (p_d) true parameters.
        M: (n, n) true mass matrix at q.
        C: (n, n) true Coriolis matrix at q, qd: dM/dt = C + C^T.
        friction: true friction of the joints.
    """

    a_k: np.ndarray
    a_d: np.ndarray
    M: np.ndarray
    C: np.ndarray
    friction: Friction


class Law(ABC):
    """A control law: torque, drives of the estimates, and the Lyapunov function that proves it.

    A law is an immutable object with its gains, made for one task. A new one is one file with one
    subclass; the four abstract methods are all that a controller and the proof need. To be made by
    name, with default gains and rates and with a check before the run, it also states ``tuned``,
    ``parameter_effects``, ``feedback`` and ``kinematic_loop``.

    Attributes:
        name: as written in scenarios.
        adapts: whether it uses estimates that move.
        needs_task_velocity: whether it uses ``Signals.xd``, which is J_hat v where no sensor gives
            it.
        needs_prediction: whether it uses ``Signals.epsilon``.
        needs_acceleration: whether it uses the joint acceleration.
        velocity_error: whether the error of the joint velocity drives the dynamic estimate.
        inverts_estimate: whether it needs M_hat^-1 at the moving estimate.
        joint_space: whether it is a law for joint tasks only.
        set_point: whether it needs a desired motion that comes to rest, see ``Trajectory.settles``.
        learns_kinematics: whether it moves the kinematic estimate.
        approximate_regressor: whether its proof bears a regressor at the believed lengths.
        predicts_torque: whether the dynamic estimate has no other drive than the prediction of the
            torque.
        joint_effects: joint coefficients that are unknown by default: "all" or "none".
        bandwidth_powers: gains of the feedback, by the names that users write, with the powers of
            the bandwidth that they go with.
        adaptation_mode: fastest mode of the inertias' adaptation by default, in bandwidths.
        joint_mode: the same of the joints' coefficients.
        kinematic_mode: the same of the translations.
        prediction_mode: rate at which adaptations that predict the torque let that error decay.
        units: of velocity and position gain, for people.
        pace: share of the bandwidth that the law's own gains use; default rates follow it.
        sources: keys of ``references.bib``, or BibTeX entries of your own; see ``citation``.
    """

    name: ClassVar[str]
    adapts: ClassVar[bool] = True
    needs_task_velocity: ClassVar[bool] = False
    needs_prediction: ClassVar[bool] = False
    needs_acceleration: ClassVar[bool] = False
    velocity_error: ClassVar[bool] = False
    inverts_estimate: ClassVar[bool] = False
    joint_space: ClassVar[bool] = False
    set_point: ClassVar[bool] = False
    learns_kinematics: ClassVar[bool] = True
    approximate_regressor: ClassVar[bool] = False
    predicts_torque: ClassVar[bool] = False
    joint_effects: ClassVar[str] = "none"
    bandwidth_powers: ClassVar[dict[str, float]] = {"Kv": 1.0, "alpha": 1.0, "Kp": 2.0}
    adaptation_mode: ClassVar[float] = 2.0
    joint_mode: ClassVar[float] = 3.0
    kinematic_mode: ClassVar[float] = 0.15
    prediction_mode: ClassVar[float] = 0.5
    units: ClassVar[tuple[str, str]] = ("", "")
    sources: ClassVar[tuple[str, ...]] = ()
    pace: float = 1.0

    @abstractmethod
    def command(self, s: Signals, believed: Believed) -> Command:
        """Return the torque for the signals of one instant."""

    @abstractmethod
    def drives(self, s: Signals, believed: Believed, command: Any, a: np.ndarray) -> Drives:
        """Return what moves the estimates, given the command and the joint acceleration a (n)."""

    @abstractmethod
    def storage(self, s: Signals, truth: Truth) -> float:
        """Return V without the parts of the parameters, the adaptations' ``divergence``."""

    @abstractmethod
    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt as the proof has it.

        An equality in continuous time with the ideal acceleration and constant true parameters.
        """

    @property
    def filters(self) -> Filters:
        """The law's memory besides its estimates."""
        return NoFilters()

    @classmethod
    def tuned(cls, motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any) -> Law:
        """Return the law with default gains for a believed robot at the period dt [s].

        Args:
            motion: the believed robot, and the bandwidth of the feedback.
            dt: sampling period [s].
            share: of the bandwidth, where all of it is too fast for dt.
            given: gains to take instead of the defaults, by name.

        Raises:
            GainError: a gain that the law does not have, or that breaks a hypothesis of its proof.
        """
        raise InputError(
            f"the law '{cls.name}' has no default gains.", where="law", hint="Pass it as an object."
        )

    def with_prediction_weight(self, weight: float) -> Law:
        """Return the law with this default weight R_k of the kinematic prediction error."""
        return self

    def decorrelated(self, bandwidth: float) -> Law:
        """Return the law with its regressor free of the noise of v above a bandwidth [1/s].

        A law that cannot is returned as it is.
        """
        return self

    def guarded(self, adaptation: Adaptation, dynamics: Dynamics) -> Adaptation:
        """Return an adaptation of the dynamics with what the law's proof needs around it."""
        return adaptation

    def mismatch(self, J_hat: np.ndarray, J: np.ndarray) -> tuple[float, float] | None:
        """Return how wrong J_hat (m, n) is beside the true J (m, n), and how wrong it may be.

        None for a law that bears any, or learns it.
        """
        return None

    def set_point_loop(self, J_hat: np.ndarray, J: np.ndarray) -> SetPointLoop | None:
        """Return the loop linearised in a set point, or None for a law that follows motions."""
        return None

    def parameter_effects(self, motion: TypicalMotion) -> list[np.ndarray]:
        """Return Phi (., p_d) at each state, by which parameter errors move the driving error e.

        de/dt = ... + Phi da with the drive Y^T e = Phi^T e in suitable coordinates of e.
        """
        return motion.momentum_effects

    def feedback(self, motion: TypicalMotion) -> Sequence[Feedback]:
        """Return the linearised feedback at each state, once if constant, [] if unknown."""
        return []

    def kinematic_loop(self) -> KinematicLoop | None:
        """Return how kinematic estimate and task error couple, or None if unknown."""
        return None
