"""What a control law returns, what it must state about itself, and its gains."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix, positive
from .._kernels import linear_algebra as kernels
from ..adaptation.adaptation import Adaptation, Drive, Drives, Estimate
from ..exceptions import DivergedError, GainError, InputError
from ..filters import Filters
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..models.typical_motion import TypicalMotion
from ..robot.changes import Friction
from ..signals import Signals
from ..tasks.task import JointTask, Task
from .posture import Posture


@dataclass(slots=True, eq=False)
class Command:
    """What a law returns: the torque, and the drives of both estimates.

    The torque is affine in the joint acceleration a: torque + feedthrough @ a.

    Attributes:
        torque: (n) the part that does not depend on the acceleration [N m or N].
        drives: what moves the estimates; new at every call, as the controller adds the prediction
            error of the torque to the dynamic one, where the adaptation uses it.
        feedthrough: (n, n) factor of the acceleration [kg m^2 or kg], or None for zero.
        feedforward: (n) part of the torque that follows from the reference and the estimate alone,
            which declared late motors get earlier; None: the law has none.
    """

    torque: np.ndarray
    drives: Drives
    feedthrough: np.ndarray | None = None
    feedforward: np.ndarray | None = None


@dataclass(slots=True, eq=False)
class EstimatedModel:
    """The model at the current estimates, for a law to evaluate while it computes its command.

    Attributes:
        kinematics: evaluated at the signals' q, v and a_k.
        dynamics: with a_d loaded; a law that loads another estimate loads a_d again.
        adaptation_k, adaptation_d: how the kinematic and the dynamic estimate move; while they are
            held, ``Frozen``.
        kinematic, dynamic: the estimates with the memory of their adaptations.
        dt: time for which the torque will be held [s]; None where the loop is integrated as one
            differential equation.
        stop_on_divergence: whether an M_hat that is not positive definite ends the run.
    """

    kinematics: TaskKinematics
    dynamics: Dynamics
    adaptation_k: Adaptation
    adaptation_d: Adaptation
    kinematic: Estimate
    dynamic: Estimate
    dt: float | None = None
    stop_on_divergence: bool = True

    def acceleration_drive(
        self, M: np.ndarray, J: np.ndarray, e: np.ndarray, Y: np.ndarray
    ) -> Drive:
        """Return the drive Phi^T e with Phi = J M^-1 Y, which has Y and the error M^-1 J^T e (n).

        Args:
            M: (n, n) estimated mass matrix.
            J: (m, n) Jacobian.
            e: (m) error of the task.
            Y: (n, p) regressor.

        Raises:
            DivergedError: M is not positive definite, as every mass matrix is; without
                ``stop_on_divergence`` any regular M will do.
        """
        solution = e.dot(J)
        if not self.stop_on_divergence:
            return Drive(Y, np.linalg.solve(M, solution))
        if not kernels.solve_definite(M.copy(), solution):
            raise DivergedError(
                "the estimated mass matrix is no longer positive definite, and this law inverts "
                "it. Natural and projected adaptation keep it positive definite; with plain "
                "gradient adaptation try a smaller gamma_d, or the law 'separation' or "
                "'adaptive-jacobian', which invert no mass matrix."
            )
        return Drive(Y, solution)


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


class Feedback(NamedTuple):
    """The linearised feedback of a law: d^2 x/dt^2 = -S x - (D + N) dx/dt.

    x is the task error, and the matrices (m, m) hold at all states; or it is the error of the
    joints in coordinates of unit mass, M^1/2 v, and they are (N, n, n), at N states. Default rates
    and the check before a run use it.

    Attributes:
        S: stiffness [1/s^2].
        D: damping by the gains [1/s].
        N: damping that does not depend on the gains, such as that of the posture [1/s].
        E: damping of the error that drives the adaptation [1/s].
    """

    S: np.ndarray
    D: np.ndarray
    N: np.ndarray
    E: np.ndarray


class KinematicLoop(NamedTuple):
    """The coupling of kinematic estimate and task error: de/dt = -damping e + w a, and back.

    Attributes:
        stiffness: k with w^2 = k eig(Y_p Gamma_k Y_p^T).
        damping: [1/s].
        weight: (m_p, m_p) R_k, weight of the prediction error.
    """

    stiffness: float
    damping: float
    weight: np.ndarray


Own = TypeVar("Own", bound="Law")


class Law(ABC):
    """A control law: torque, drives of the estimates, and the Lyapunov function that proves it.

    A law is an immutable object with its gains, made for one task. A new law is one file with one
    subclass; the three abstract methods are all that a controller and the proof need. To be made by
    name, with default gains and rates and a check before the run, it also states
    ``default_gains``, ``parameter_effects``, ``feedback`` and ``kinematic_loop``.

    Attributes:
        name: as written in scenarios.
        adapts: whether it uses estimates that move.
        needs_task_velocity: whether it uses ``Signals.xd``, which is J_hat v where no sensor
            measures it.
        uses_position_error: whether ``Signals.epsilon`` drives its kinematic estimate, so that it
            learns from positions; else it learns from velocities.
        velocity_error: whether the error of the joint velocity drives the dynamic estimate.
        uses_acceleration: whether ``command`` reads ``Signals.a`` for torque or drives. If not, a
            continuous loop with the ideal acceleration evaluates the law once instead of twice.
        inverts_estimate: whether it needs M_hat^-1 at the moving estimate.
        keeps_speeds: whether its reference may be shortened to speeds that joints have, its
            attribute ``speeds``. Else a governor stops the path before singularities of J_hat.
        joint_space: whether it is for joint tasks only.
        set_point: whether it needs a desired motion that comes to rest, see ``Trajectory.settles``.
        constrained: whether its V holds under constraints, see ``robot.constraints``: its reference
            is a velocity of the right inverse, and K_D s its feedback.
        learns_kinematics: whether it moves the kinematic estimate.
        approximate_regressor: whether its proof allows a regressor at the nominal lengths.
        learns_from_torque: whether nothing but the prediction error of the torque moves its dynamic
            estimate.
        joint_effects: joint coefficients that are unknown by default: "all" or "none".
        bandwidth_powers: gains of the feedback, by the names that users write, with the power of
            the bandwidth to which each is proportional.
        adaptation_mode: default of the fastest mode of the adaptation of inertias, in bandwidths;
            beside a memory of all torques it is one bandwidth.
        remembers: whether its default adaptation has a memory of all torques, where parameters of
            bodies are unknown.
        joint_mode: the same for the coefficients of the joints.
        kinematic_mode: the same for the translations.
        own_bandwidth: w, for robots of every size [rad/s]; None: by the reach.
        prediction_mode: default rate at which the prediction error of the torque decays, in
            bandwidths, for adaptations that use it.
        posture_share: of the bandwidth, that the default posture follows.
        units: of velocity and position gain, as printed.
        bandwidth_share: share of the bandwidth that the law's own gains use; default rates follow
            it.
        sources: keys of ``references.bib``, or BibTeX entries of your own; see ``citation``.
    """

    name: str
    adapts = True
    needs_task_velocity = False
    uses_position_error = False
    velocity_error = False
    uses_acceleration = True
    inverts_estimate = False
    keeps_speeds = False
    joint_space = False
    set_point = False
    constrained = False
    learns_kinematics = True
    approximate_regressor = False
    learns_from_torque = False
    joint_effects = "none"
    bandwidth_powers: ClassVar[dict[str, float]] = {"Kv": 1.0, "alpha": 1.0, "Kp": 2.0}
    adaptation_mode = 2.0
    remembers = False
    joint_mode = 3.0
    kinematic_mode = 0.15
    own_bandwidth: float | None = None
    prediction_mode = 0.5
    posture_share = 1.0
    units = ("", "")
    sources: ClassVar[tuple[str, ...]] = ()
    bandwidth_share: float = 1.0

    @abstractmethod
    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the torque and the drives of the estimates for the signals of one instant.

        The torque may depend on the acceleration ``s.a`` through ``Command.feedthrough`` only; the
        drives may depend on it in any way.
        """

    @abstractmethod
    def storage(self, s: Signals, truth: Truth) -> float:
        """Return V without the parts of the parameters, the adaptations' ``storage``."""

    @abstractmethod
    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt as the proof has it.

        An equality in continuous time with the ideal acceleration and constant true parameters.
        """

    @property
    def filters(self) -> Filters:
        """The law's memory besides its estimates."""
        return Filters()

    @classmethod
    def tuned(
        cls: type[Own], motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any
    ) -> Own:
        """Return the law with default gains for a model at the period dt [s].

        Args:
            motion: the model along a typical motion, and the bandwidth of the feedback.
            dt: sampling period [s].
            share: of the bandwidth, where all of it is too fast for dt.
            given: gains in place of the defaults, by name.

        Raises:
            GainError: a gain that breaks a hypothesis of the proof.
        """
        w = share * motion.bandwidth
        gains = merged(cls.default_gains(motion, dt, w), given)
        posture = Posture.of(motion.robot, given.get("posture"), cls.posture_share * w)
        return cls(motion.kinematics.task, posture, **gains)  # type: ignore[call-arg]

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, by the names that users write.

        Args:
            motion: the model along a typical motion.
            dt: sampling period [s].
            w: bandwidth [rad/s].
        """
        raise InputError(
            f"the law '{cls.name}' has no default gains.", where="law", hint="Pass it as an object."
        )

    def adjusted(self: Own, **values: Any) -> Own:
        """Return the law with other values of those of its attributes that it has.

        Filters and rates of a controller set R_k, the weight of the kinematic prediction error;
        lambda_s and lead, above which a regressor is free of the noise of v, and the time by which
        the low pass on v delays it; the speeds that a reference keeps; and where the posture rests.
        """
        own = {name: value for name, value in values.items() if name in vars(self)}
        return replace(self, **own) if own and is_dataclass(self) else self

    def of_joints(self, task: JointTask) -> Law | None:
        """Return the same feedback with the joints as its task; None if there is no such form."""
        return None

    def guarded(self, adaptation: Adaptation, dynamics: Dynamics) -> Adaptation:
        """Return the adaptation of the dynamics, wrapped in what the law's proof needs."""
        return adaptation

    def parameter_effects(self, motion: TypicalMotion) -> np.ndarray:
        """Return Phi (N, ., p_d) at each state, by which parameter errors move the driving error e.

        de/dt = ... + Phi da with the drive Y^T e = Phi^T e in suitable coordinates of e; here it is
        M_hat^-1/2 Y, the joint acceleration in coordinates of unit mass.
        """
        return motion.unit_masses @ motion.regressors

    def feedback(self, motion: TypicalMotion) -> Feedback | None:
        """Return the linearised feedback, or None if unknown."""
        return None

    def kinematic_loop(self) -> KinematicLoop | None:
        """Return how kinematic estimate and task error couple, or None if unknown."""
        return None


# Gains, checked against the hypotheses of the proofs


NAMES = (
    "Kv",
    "Kp",
    "alpha",
    "beta",
    "R_k",
    "Q",
    "lambda_",
    "lambda_a",
    "lambda_s",
    "lag",
    "posture",
    "width",
    "weight",
    "bound",
    "gravity",
)  # as users write them
SYMBOLS = {"Kv": "K_v", "Kp": "K_P"}  # what the laws call those that they call otherwise
_TASK_GAINS = {symbol: name for name, symbol in SYMBOLS.items()}


def task_gain(value: ArrayLike, task: Task, name: str, *, copies: int = 1) -> np.ndarray:
    """Return a gain matrix (m k, m k) of a task of size m, k = ``copies``.

    A number is a multiple of the identity, a list a diagonal.

    Raises:
        GainError: not positive definite, of another size, or on the rotations of a pose no multiple
            of the identity.
    """
    gain = definite_matrix(value, copies * task.size, name)
    m = task.size
    blocks = gain.reshape(copies, m, copies, m).swapaxes(1, 2).reshape(-1, m, m)
    for rows in (group.rows for group in task.groups if group.name == "rotation"):
        for block in blocks / np.abs(gain).max():
            turning = block[rows.start, rows.start] * np.eye(m)[rows]
            if not np.allclose((block[rows], block[:, rows].T), turning, rtol=1e-9, atol=1e-9):
                raise GainError(
                    "the rotation rows must be one number times the identity, not coupled to the "
                    "position: phi^T K delta = 0, on which the proof for a pose rests, holds for "
                    "such gains only.",
                    where=name,
                    hint=f"Give one number, or {m} numbers whose last three are equal.",
                )
    return gain


def check_in_place(law: Any, *names: str) -> None:
    """Turn gains of a frozen law that is being made into what they are checked to be.

    K_v and K_P are gains of the task, R_k is a weight of its positions (m_p, m_p), all others are
    positive numbers.

    Raises:
        GainError: one of them is not, or of another size.
    """
    task: Task = law.task
    for name in names:
        value = getattr(law, name)
        if name in _TASK_GAINS:
            value = task_gain(value, task, _TASK_GAINS[name])
        elif name == "R_k":
            value = definite_matrix(value, task.positions, name)
        else:
            value = positive(value, name)
        object.__setattr__(law, name, value)


def check_margin(K_v: np.ndarray, alpha: float) -> None:
    """Refuse gains without K_v - alpha I > 0.

    Raises:
        GainError: K_v - alpha I is not positive definite.
    """
    beta = np.linalg.eigvalsh(K_v)[0] - alpha
    if beta <= 0.0:
        raise GainError(
            f"K_v - alpha I must be positive definite; its smallest eigenvalue is {beta:.4g}.",
            where="alpha",
            hint=f"Take alpha below {beta + alpha:.4g}, or a larger Kv.",
        )


def merged(defaults: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the defaults of a law's gains with the given ones in their place, by its own symbols.

    None gives nothing; gains that only other laws have are left out, so that one set of gains
    serves for a comparison of laws.
    """
    own = {}
    for name, default in defaults.items():
        value = given.get(name)
        own[SYMBOLS.get(name, name)] = default if value is None else value
    return own
