"""Set-point control whose torque is bounded before anything moves."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from .._checks import numbers
from ..adaptation.adaptation import Adaptation
from ..adaptation.projections import GravityProjection
from ..description.chain import jacobian_bounds, position_bounds
from ..exceptions import GainError
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..models.typical_motion import TypicalMotion
from ..robot.changes import Payload
from ..robot.robot import Robot
from ..signals import Signals
from .approximate_jacobian import ApproximateJacobian, joint_damping
from .law import Command, EstimatedModel

_LEAST, _SPRING = 0.1, 0.5  # share of the bound left to the feedback; of that to the spring
_HEAVIER = 1.3  # bodies, for what gravity may ask
_LOAD, _ARM = 0.1, 0.05  # of the mass, of the reach off the frame
_SMALL = 0.01  # of the bound
_TIGHTER = 1.0 / 3.0  # how much of a smaller spring is a smaller width, as a power
_CONFIGURATIONS = 500


@dataclass(frozen=True, eq=False)
class BoundedTorque(ApproximateJacobian):
    """Set point with an approximate Jacobian and a guaranteed torque bound.

    After W. Dixon, IEEE TAC 52 (2007) 488-493, whose law adapts the Jacobian as well and could not
    be recovered exactly: feedback by tanh and a projected estimate are his, what follows is proved
    for this form.

    Law:          tau = Z(q) a_d + g_0(q) - J_hat^T K_P s(dx) - K_v qd tanh(r) / r, r the largest of
                  |K_v qd|_i / d_i over the joints, s = w tanh(dx / w), J_hat of constant
                  parameters.
    Adaptation:   da_d/dt = -Gamma_d Z^T y, y = qd + weight K_v^-1 J_hat^T K_P s(dx), projected onto
                  |Z_i a_d + g_0,i| <= G_i at the measured q; see ``GravityProjection``.
    Bound:        |tau_i| <= G_i + l_i |K_P w| + d_i = b_i at every q, qd, x and estimate: l_i
                  bounds column i of J_hat over all configurations, see ``jacobian_bounds``, the
                  norm is of the rows of the position, and rotations and joints count by their own.
                  d is what the given bound b, gravity's share G and the spring leave.
    Closed loop:  M qdd + C qd = Z da_d - J_hat^T K_P s - K_v qd tanh(r) / r - f(qd).
    V:            that of ``ApproximateJacobian``, dV/dt as well with K_v qd tanh(r) / r in place of
                  K_v qd, an equality but where the projection acts, which lowers V.
    Convergence:  as there while r is not far beyond one, so for starts that depend on the bound:
                  semiglobal.
    Assumptions:  those of ``ApproximateJacobian``; the true gravity torque within G where the arm
                  goes; slides beyond a revolute joint have position limits.

    Default gains: the bound is the limit of the motors, where there is none the torque that gravity
    and the gains of ``ApproximateJacobian`` may ask for. Gravity has what it asks for at most in
    the workspace with bodies 30 % heavier and a load of a tenth of the mass, a twentieth of the
    reach off the frame, and what the feedback leaves, but at most 90 % of the bound. Half of the
    rest is the spring's: K_P and width become smaller where they must, K_P by the square of what
    width does. K_v damps critically.

    Attributes:
        kinematics, K_v, K_P, width, weight: as ``ApproximateJacobian``.
        bound: (n) b [N m or N].
        gravity: (n) G [N m or N].
        bandwidth_share: share of the bandwidth for which the bound leaves torque.
    """

    _: KW_ONLY
    bound: Any
    gravity: Any
    bandwidth_share: float = 1.0

    name = "bounded-torque"
    sources = ("Dixon2007",)

    def __post_init__(self) -> None:
        """Turn gains into matrices.

        Raises:
            GainError: gains that break a hypothesis of the proof, or the bound.
        """
        super().__post_init__()
        for name in ("bound", "gravity"):
            object.__setattr__(self, name, _torques(getattr(self, name), self.kinematics, name))
        if not (self.brake_limit > 0.0).all():
            i = int(np.argmin(self.brake_limit))
            spring = _spring(self.kinematics, self.K_P, self.width)
            raise GainError(
                f"{self.kinematics.joint_names[i]} may give {self.bound[i]:.4g}: gravity's share "
                f"is {self.gravity[i]:.4g}, the position feedback's {spring[i]:.4g}, nothing is "
                "left for damping.",
                where="bound",
                hint="Take a smaller Kp, width or gravity, or a larger bound.",
            )

    @cached_property
    def brake_limit(self) -> np.ndarray:
        """What the damping torque stays below (n) [N m or N], d."""
        spring = _spring(self.kinematics, self.K_P, self.width)
        return np.asarray(self.bound - self.gravity - spring)

    @classmethod
    def _defaults(
        cls, motion: TypicalMotion, dt: float, share: float, given: dict[str, Any]
    ) -> dict[str, Any]:
        gains, kinematics = super()._defaults(motion, dt, share, given), motion.kinematics
        width = np.broadcast_to(_or(given.get("width"), gains["width"]), kinematics.task.size)
        K_P = np.broadcast_to(gains["Kp"], kinematics.task.size)
        asked, spring = _worst_gravity(motion), _spring(kinematics, np.diag(K_P), width)
        free = (asked + spring / _SPRING) / (1.0 - _LEAST)
        bound = _or(given.get("bound"), np.where(np.isfinite(motion.efforts), motion.efforts, free))
        bound = _torques(bound, kinematics, "bound")
        most = (1.0 - _LEAST) * bound
        gravity = _or(
            given.get("gravity"),
            np.clip(np.maximum(asked, bound - spring / _SPRING), _SMALL * bound, most),
        )
        gravity = _torques(gravity, kinematics, "gravity")
        _check_holds(motion.robot, gravity)
        part = _affordable(motion, K_P, width, _SPRING * (bound - gravity))
        width_part = part**_TIGHTER if given.get("width") is None else np.ones(part.size)
        K_P, slower = K_P * part / width_part, float(np.min(part / width_part)) ** 0.5
        return gains | {
            "Kp": K_P,
            "width": width * width_part,
            "Kv": joint_damping(motion, K_P, slower * share * motion.bandwidth),
            "bound": bound,
            "gravity": gravity,
            "bandwidth_share": slower,
        }

    def brake(self, v: np.ndarray) -> np.ndarray:
        """Return the damping torque K_v qd tanh(r) / r (n) [N m or N]."""
        asked = self.K_v.dot(v)
        r = float(np.abs(asked / self.brake_limit).max())
        return asked * (np.tanh(r) / r) if r > 0.0 else asked

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the torque and the drives.

        The torque is clipped for estimates that no ``GravityProjection`` keeps in their bounds;
        otherwise clipping changes nothing.
        """
        command = super().command(s, model)
        return Command(np.clip(command.torque, -self.bound, self.bound), command.drives)

    def guarded(self, adaptation: Adaptation, dynamics: Dynamics) -> Adaptation:
        """Return the adaptation with a projection that keeps gravity within its share.

        Raises:
            InputError: least squares, whose estimate cannot be projected.
        """
        if not dynamics.size:
            return adaptation
        return GravityProjection(adaptation, dynamics, self.gravity)


def _or(given: Any, default: Any) -> Any:
    return default if given is None else given


def _torques(given: Any, kinematics: TaskKinematics, name: str) -> np.ndarray:
    """Return one torque a joint (n) [N m or N].

    Raises:
        GainError: of another size, or not positive.
    """
    torques = numbers(given, name, error=GainError)
    if torques.shape not in ((), (kinematics.nv,)) or not (torques > 0.0).all():
        raise GainError(
            f"expected a positive number or {kinematics.nv} of them, got {torques.tolist()}.",
            where=name,
        )
    return np.broadcast_to(torques, kinematics.nv).copy()


def _levers(kinematics: TaskKinematics) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds of the Jacobian's columns, of the position (n) and of what follows it (n).

    Raises:
        GainError: there is none.
    """
    n = kinematics.nv
    if not kinematics.positions:
        return np.zeros(n), np.ones(n)
    robot = kinematics.robot
    linear, angular = jacobian_bounds(robot.model, robot.frame_id)
    if not np.isfinite(linear).all():
        names = [kinematics.joint_names[i] for i in np.flatnonzero(~np.isfinite(linear))]
        raise GainError(
            f"no torque bound of {names} exists: a slide beyond has no position limits.",
            where="bound",
            hint='State them in the description, or take the law "approximate-jacobian".',
        )
    return linear, angular


def _spring(kinematics: TaskKinematics, K_P: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return what |J_hat^T K_P s| stays below (n) [N m or N]."""
    force, p = np.diag(K_P) * width, kinematics.positions
    linear, angular = _levers(kinematics)
    turning = force[p:].max(initial=0.0) if p else force
    return np.asarray(linear * np.linalg.norm(force[:p]) + angular * turning)


def _affordable(
    motion: TypicalMotion, K_P: np.ndarray, width: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Return the largest parts (m) of K_P (m) whose spring stays below a torque (n)."""
    kinematics = motion.kinematics
    (linear, angular), p, part = _levers(kinematics), kinematics.positions, np.ones(K_P.size)
    if not p:
        return np.minimum(1.0, torque / (K_P * width))
    groups = 2.0 if K_P.size > p else 1.0
    tiny = 1e-9 * linear.max()
    force = np.min(torque / groups / np.maximum(linear, tiny))
    part[:p] = min(1.0, force / np.linalg.norm(K_P[:p] * width[:p]))
    if K_P.size > p:
        moment = np.min(torque[angular > 0.0] / groups)
        part[p:] = min(1.0, moment / np.max(K_P[p:] * width[p:]))
    return part


def _worst_gravity(motion: TypicalMotion) -> np.ndarray:
    """Return what gravity may ask of each joint (n) [N m or N] at seeded configurations."""
    load = _LOAD * pin.computeTotalMass(motion.robot.model)
    robot = motion.robot.changed(inertial_scale=_HEAVIER, payload=Payload(load))
    model, rng = robot.model, np.random.default_rng(0)
    data, (low, high) = model.createData(), position_bounds(model)
    torque, neutral = pin.computeGeneralizedGravity, pin.neutral(model)
    moves = rng.uniform(low, high, (_CONFIGURATIONS, model.nv))
    asked = [torque(model, data, pin.integrate(model, neutral, move)).copy() for move in moves]
    worst = np.abs([torque(model, data, robot.q0).copy(), *asked]).max(axis=0)
    weight, turns = load * np.linalg.norm(model.gravity.linear), _levers(motion.kinematics)[1]
    return np.asarray(worst + weight * _ARM * robot.reach * turns)


def _check_holds(robot: Robot, gravity: np.ndarray) -> None:
    """Refuse a share of gravity (n) that does not hold the nominal robot at home.

    Raises:
        GainError: it does not.
    """
    model = robot.model
    weight = np.abs(pin.computeGeneralizedGravity(model, model.createData(), robot.q0))
    short = [
        f"{name} ({weight[i]:.3g} of {gravity[i]:.3g})"
        for i, name in enumerate(robot.joint_names)
        if weight[i] > gravity[i]
    ]
    if short:
        raise GainError(
            f"gravity's share of the torque does not hold the robot at home: {', '.join(short)}.",
            where="bound",
            hint="Take a larger bound, or say what gravity may have of it (gravity=).",
        )
