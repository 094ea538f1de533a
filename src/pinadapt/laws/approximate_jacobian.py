"""Set-point control: with an approximate Jacobian that is not adapted, and with bounded torque."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from .._checks import definite_matrix, take_checked
from ..adaptation.adaptation import Adaptation, Drive, Drives, positive_numbers
from ..adaptation.projections import GravityProjection
from ..description.chain import jacobian_bounds, position_bounds
from ..exceptions import DivergedError, GainError
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..models.typical_motion import TypicalMotion
from ..robot.robot import Robot
from ..signals import Signals
from ..tasks.task import Task
from .adaptive_jacobian import AdaptiveJacobian, of_joints
from .law import (
    Command,
    EstimatedModel,
    Feedback,
    Law,
    Truth,
    check_in_place,
    merged,
    task_gain,
)
from .separation import assumed_load


@dataclass(frozen=True, eq=False)
class Saturation:
    """s(dx) = w tanh(dx / w) by rows; w tanh(|phi| / w) phi / |phi| of a rotation vector.

    Near zero s(dx) = dx, far away |s_i| <= w_i. With diagonal K_P, one number on the rotations,
    K_P s is the gradient of S(dx) = sum K_P,i w_i^2 log cosh(dx_i / w_i), so that dS/dt =
    (K_P s)^T d(dx)/dt: radially also where d(phi)/dt is not the angular velocity, as phi^T
    d(phi)/dt = phi^T omega. S. Arimoto's saturating functions, with tanh in place of the sine.

    Attributes:
        task: whose errors are taken.
        width: (m) w [m or rad], equal on the rows of a rotation.
    """

    task: Task
    width: Any

    def __post_init__(self) -> None:
        """Turn the width into one per row.

        Raises:
            GainError: not positive, of another size, or different on the axes of a rotation.
        """
        take_checked(self, positive_numbers, "", "width", size=self.task.size)
        if (self._together * self.width != (self._together * self.width).T).any():
            raise GainError("must be one number on the rotation rows.", where="width")

    @cached_property
    def _together(self) -> np.ndarray:
        """One where two rows (m, m) are of one rotation, or the same; else zero."""
        shared = np.eye(self.task.size)
        for group in self.task.groups:
            if group.name == "rotation":
                shared[group.rows, group.rows] = 1.0
        return shared

    def _sizes(self, dx: np.ndarray) -> np.ndarray:
        """Return |dx_i| / w_i (m), on the rows of a rotation |phi| / w."""
        return np.sqrt(self._together @ (dx * dx)) / self.width

    def of(self, dx: np.ndarray) -> np.ndarray:
        """Return s (m) of an error dx (m) [m or rad]."""
        return _ratio(self._sizes(dx)) * dx

    def rate(self, dx: np.ndarray, dxd: np.ndarray) -> np.ndarray:
        """Return ds/dt (m) of an error dx (m) that moves at dxd (m)."""
        u = self._sizes(dx)
        squares = self._together @ (dx * dx)
        radial = self._together @ (dx * dxd) / np.maximum(squares, np.finfo(float).tiny) * dx
        slope = 1.0 - np.tanh(u) ** 2
        ratio = _ratio(u)
        return ratio * dxd + (slope - ratio) * radial

    def potential(self, dx: np.ndarray) -> np.ndarray:
        """Return S_i (m) with S = sum K_P,i S_i [m^2 or rad^2]; a rotation's in equal parts."""
        u = self._sizes(dx)
        S = self.width**2 * (np.logaddexp(u, -u) - np.log(2.0))
        return S / self._together.sum(axis=1)


def _ratio(u: np.ndarray) -> np.ndarray:
    """Return tanh(u) / u."""
    return np.divide(np.tanh(u), u, out=np.ones(u.size), where=u > 0.0)


# of the reach; [rad]; half: the same; twice: bounded torques near gravity exceed their bound
_WIDTH, _TURN = 0.05, 0.1
# in bandwidths, the slowest mode that is damped critically; half: the same; twice: as above
_NULL = 0.5
# for which the tolerated error of the Jacobian is largest; half: as above; twice: the same
_WEIGHT = 0.6


@dataclass(frozen=True, eq=False)
class ApproximateJacobian(Law):
    """Set point with an approximate Jacobian, constant parameters J_hat, adaptive gravity.

    C. Cheah, S. Kawamura, S. Arimoto, J. Robotic Systems 16 (1999) 119-134 (gravity known: here
    adaptation "none"); C. Cheah, M. Hirano, S. Kawamura, S. Arimoto, IEEE T. Robot. Autom. 19
    (2003) 692-702 (gravity adapted). Theirs has a scalar in place of the matrix weight K_v^-1, the
    same for K_v that are multiples of the identity, and other functions s; what follows is proved
    for this form.

    Law:          tau = Z(q) a_d + g_0(q) - J_hat^T K_P s(dx) - K_v qd, g = Z a_d + g_0 the gravity
                  torque, Z its regressor, s saturating (``Saturation``).
    Adaptation:   da_d/dt = -Gamma_d Z^T y, y = qd + z, z = weight K_v^-1 J_hat^T K_P s(dx). None of
                  the kinematics.
    Closed loop:  M qdd + C qd = Z da_d - J_hat^T K_P s - K_v qd - f(qd), f the true friction less
                  its offset.
    V:            qd^T M qd / 2 + qd^T M z + S(dx) + D_d(a_d), dS/d(dx) = K_P s;
                  dV/dt = -y^T (J_hat^T K_P s + K_v qd + f(qd)) + qd^T J^T K_P s + qd^T (C z + M
                  dz/dt), an equality. With J = J_hat and f = 0 its first line is -|qd|^2 - weight
                  qd^T F - weight |F|^2 with F = J_hat^T K_P s, in the metrics K_v and K_v^-1.
    Convergence:  |(J - J_hat)^T K_P s| <= mismatch |F| and qd^T (C z + M dz/dt) <= mu |qd|^2, in
                  these metrics, make dV/dt <= -(1 - mu) |qd|^2 + (weight + mismatch) |qd| |F| -
                  weight |F|^2, negative where (weight + mismatch)^2 < 4 weight (1 - mu); mu is
                  about weight / 4 for critical damping near the set point, and z is bounded as s
                  is. Then qd and F go to zero, and with them dx, as J_hat has full row rank.
    Assumptions:  set point: the desired motion comes to rest; constant parameters; exact gravity
                  regressor; J_hat of full row rank and not too wrong, as above. Needed are
                  q, qd and x; nothing is inverted.
    Redundancy:   K_v damps the null space; where it comes to rest is not controlled.
    Pose:         s is radial in the rotation vector, so that S has the derivative above. Joints: J
                  = I, P. Tomei's adaptive PD controller with a saturating s.

    Default gains for the bandwidth w: K_P = w^2 m with the mass or inertia m felt at the frame at
    home, of joints their own; width a twentieth of the reach, 0.1 rad on rotations and joints;
    K_v damps critically the modes of J_hat^T K_P J_hat and M_hat, those of the null space at w / 2,
    in the mean over a typical motion.

    Attributes:
        kinematics: the estimated ones; only dV/dt evaluates them here.
        K_v: (n, n) damping of the joints [N m s/rad or N s/m].
        K_P: (m, m), diagonal [N/m; N m/rad on rotations and joints].
        width: (m) of the saturation [m or rad].
        weight: of the position in what drives the estimate, below 2.
    """

    kinematics: TaskKinematics
    _: KW_ONLY
    K_v: Any
    K_P: Any
    width: Any
    weight: float = _WEIGHT

    name = "approximate-jacobian"
    sources: ClassVar[tuple[str, ...]] = (
        "CheahKawamuraArimoto1999",
        "CheahHiranoKawamuraArimoto2003",
    )
    set_point = True
    uses_acceleration = False
    learns_kinematics = False
    bandwidth_powers: ClassVar[dict[str, float]] = {"Kv": 1.0, "Kp": 2.0}
    units = ("N m s/rad", "N/m, for rotations and joints N m/rad")

    def __post_init__(self) -> None:
        """Turn gains into matrices.

        Raises:
            GainError: gains that break a hypothesis of the proof.
        """
        check_in_place(self, "K_P", "weight")
        if (np.diag(np.diag(self.K_P)) != self.K_P).any():
            raise GainError("must be diagonal: K_P s is to be a gradient.", where="Kp")
        if not self.weight < 2.0:
            raise GainError(
                f"must be below 2, got {self.weight:g}: no Jacobian is exact enough then.",
                where="weight",
            )
        object.__setattr__(self, "K_v", definite_matrix(self.K_v, self.kinematics.nv, "Kv"))
        object.__setattr__(self, "width", self.saturation.width)

    @property
    def task(self) -> Task:
        """The controlled coordinates, m of them."""
        return self.kinematics.task

    @cached_property
    def saturation(self) -> Saturation:
        """The function s."""
        return Saturation(self.task, self.width)

    @cached_property
    def _compliance(self) -> np.ndarray:
        return np.linalg.inv(self.K_v)

    @classmethod
    def tuned(
        cls, motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any
    ) -> ApproximateJacobian:
        """Return the law with the default gains of the class; see ``Law.tuned``."""
        gains = merged(cls.default_gains(motion, dt, share * motion.bandwidth), given)
        return cls(motion.kinematics, **gains)

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, as the class states them."""
        stiffness = w * w * AdaptiveJacobian.felt(motion, dt)
        return {
            "Kv": _joint_damping(motion, stiffness, w),
            "Kp": stiffness,
            "width": motion.kinematics.task.per_row(_WIDTH * motion.robot.reach, _TURN),
            "weight": _WEIGHT,
        }

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the torque and the drive Z^T y; the kinematic estimate is not adapted."""
        sizes = s.dx.dot(s.dx) + s.xd_d.dot(s.xd_d) + s.xdd_d.dot(s.xdd_d)
        if not math.isfinite(sizes):  # a bounded torque would not show it, nor use xd_d and xdd_d
            raise DivergedError("the error of the task, or the desired motion, is not finite.")
        rest = np.zeros(s.v.size)
        F = self._proportional(s)
        # tau = Z a_d + g_0 - J_hat^T K_P s(dx) - K_v qd
        torque = model.dynamics.torque(s.q, rest, rest) - F - self.brake(s.v)
        # Z^T y, y = qd + weight K_v^-1 J_hat^T K_P s(dx)
        y = s.v + self.weight * self._compliance.dot(F)
        dynamic = Drive(model.dynamics.regressor(s.q, rest, rest), y)
        return Command(torque, Drives(dynamic, Drive.none(s.a_k.size)))

    def brake(self, v: np.ndarray) -> np.ndarray:
        """Return the damping torque K_v qd (n) [N m or N] at joint velocity v (n)."""
        return self.K_v.dot(v)

    def _proportional(self, s: Signals) -> np.ndarray:
        """Return F = J_hat^T K_P s(dx) (n) [N m or N]."""
        return self.K_P.dot(self.saturation.of(s.dx)).dot(s.J)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return qd^T M (qd / 2 + z) + S(dx), M the true mass matrix."""
        z = self.weight * self._compliance @ self._proportional(s)
        potential = np.diag(self.K_P) @ self.saturation.potential(s.dx)
        return s.v @ (truth.M @ (0.5 * s.v + z)) + potential

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt, with the true task velocity where ``Signals.xd`` is measured."""
        dxd = s.xd - s.xd_d if s.delta is None else s.xd - s.xd_d + s.delta
        force = self.K_P @ self.saturation.of(s.dx)
        F = self._proportional(s)
        self.kinematics.update(s.a_k, s.q, s.v)
        turning = self.kinematics.jacobian_rate(np.zeros(s.a_k.size)).T @ force
        stretching = s.J.T @ (self.K_P @ self.saturation.rate(s.dx, dxd))
        z = self.weight * self._compliance @ F
        zd = self.weight * self._compliance @ (turning + stretching)
        friction = truth.friction.torque
        f = friction(s.v) - friction(np.zeros(s.v.size))  # Z holds what acts at rest
        lost = (s.v + z) @ (F + self.brake(s.v) + f)
        return force @ dxd - lost + s.v @ (truth.C @ z + truth.M @ zd)

    def parameter_effects(self, motion: TypicalMotion) -> np.ndarray:
        """Return Phi = M_hat^-1/2 Z (N, n, p_d) at each state."""
        rest = np.zeros(motion.robot.model.nv)
        regressor = motion.dynamics.regressor
        return motion.unit_masses @ np.array([regressor(q, rest, rest) for q in motion.states.q])

    def feedback(self, motion: TypicalMotion) -> Feedback:
        """Return the feedback of the joints."""
        W = motion.unit_masses
        D = W @ self.K_v @ W.swapaxes(1, 2)
        return Feedback(of_joints(motion, self.K_P), D, 0.0 * D, D)


def _joint_damping(motion: TypicalMotion, stiffness: Any, w: float) -> np.ndarray:
    """Return the default K_v (n, n) for a stiffness of the task and a bandwidth w [rad/s]."""
    K_P = np.diag(np.broadcast_to(stiffness, motion.kinematics.task.size))
    squares, modes = np.linalg.eigh(of_joints(motion, K_P))
    root = np.linalg.solve(motion.unit_masses, modes)
    frequencies = np.sqrt(np.maximum(squares, (_NULL * w) ** 2))
    dampings = (root * frequencies[:, None]) @ root.swapaxes(1, 2)
    return 2.0 * dampings.mean(axis=0)


@dataclass(frozen=True, eq=False)
class ApproximateJacobianGravity(ApproximateJacobian):
    """Set point with an approximate Jacobian and gravity regressor: link lengths are uncertain.

    After H. Yazarel, C. Cheah, IEEE TAC 47 (2002) 1580-1585, whose law could not be recovered
    exactly. The torque is that of ``ApproximateJacobian`` with Z_hat, the regressor at the nominal
    lengths, in place of Z: unknown lengths are not lumped with the inertias, and any adaptation
    does, natural included. What follows is proved for this form.

    Law:          tau = Z_hat(q) a_d + g_0(q) - J_hat^T K_P s(dx) - K_v qd.
    Adaptation:   da_d/dt = -Gamma_d Z_hat^T y, y = qd + weight K_v^-1 J_hat^T K_P s(dx).
    Closed loop:  M qdd + C qd = Z_hat (a_d - a) - r - J_hat^T K_P s - K_v qd - f(qd), with any a,
                  and r(q) = g(q) - Z_hat(q) a - g_0(q), what the approximate regressor leaves.
    V:            that of ``ApproximateJacobian`` with D_d(a_d) from a; dV/dt = that of
                  ``ApproximateJacobian`` - y^T r, an equality; ``dissipation`` returns the first
                  part, as r is unknown.
    Convergence:  take an a for which r vanishes where the arm is to rest, Z_hat a + g_0 = g there.
                  Then |r| <= nu |F|, F = J_hat^T K_P s, in the metric K_v^-1, nu the smaller the
                  stiffer K_P, and dV/dt <= -(1 - mu) |qd|^2 + (weight + mismatch + nu) |qd| |F| -
                  weight (1 - nu) |F|^2: nu counts as an error of the Jacobian does.
    Assumptions:  those of ``ApproximateJacobian`` but for the exact regressor; gravity at the set
                  point in the range of Z_hat, which the ten parameters of all bodies span but for
                  vertical axes, where both are zero; those of the last body alone do not.
                  Redundant arms: locally, as the set point does not fix where they rest.
    """

    name = "approximate-jacobian-gravity"
    sources = ("YazarelCheah2002",)
    approximate_regressor = True


_LEAST = 0.1  # share of the bound left to the feedback, half of it to the spring


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

    Default gains: the bound is the limit of the motors; without one, the largest torque of gravity
    and of the gains of ``ApproximateJacobian``. The share of gravity is the largest gravity torque
    in the workspace with bodies 30 % heavier and a load of a tenth of the mass, a twentieth of the
    reach off the flange, plus what the feedback leaves, between 10 and 90 % of the bound. Half of
    the rest is for the spring: K_P and width are reduced where necessary, K_P by the square of the
    factor of width, unless one of them or K_v is given. K_v damps critically.

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
        take_checked(self, positive_numbers, "", "bound", "gravity", size=self.kinematics.nv)
        if not (self.brake_limit > 0.0).all():
            i = np.argmin(self.brake_limit)
            raise GainError(
                f"the bound of {self.kinematics.joint_names[i]}, {self.bound[i]:.4g} N m or N, is "
                f"not above gravity's {self.gravity[i]:.4g} and the spring's.",
                where="bound",
                hint="Take a smaller Kp, width or gravity, or a larger bound.",
            )

    @cached_property
    def brake_limit(self) -> np.ndarray:
        """What the damping torque stays below (n) [N m or N], d."""
        spring = _spring(self.kinematics, self.K_P, self.width)
        return self.bound - self.gravity - spring

    @classmethod
    def tuned(
        cls, motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any
    ) -> BoundedTorque:
        """Return the law with its default gains; see ``Law.tuned``."""
        kinematics = motion.kinematics
        w = share * motion.bandwidth
        gains = merged(cls.default_gains(motion, dt, w), given)
        width = Saturation(kinematics.task, gains["width"]).width
        spring = _spring(kinematics, task_gain(gains["K_P"], kinematics.task, "Kp"), width)
        asked = _worst_gravity(motion.robot)
        bound = given.get("bound")
        gravity = given.get("gravity")
        if bound is None:
            free = (asked + 2.0 * spring) / (1.0 - _LEAST)
            bound = np.where(np.isfinite(motion.efforts), motion.efforts, free)
        bound = positive_numbers(bound, "bound", kinematics.nv)
        if gravity is None:
            gravity = np.maximum(asked, bound - 2.0 * spring)
            gravity = np.clip(gravity, _LEAST * bound, (1.0 - _LEAST) * bound)
        gains |= {"bound": bound, "gravity": gravity}
        chosen = all(given.get(name) is None for name in ("Kv", "Kp", "width"))
        if chosen and np.less(gravity, bound).all():  # else the bound is refused below
            room = 0.5 * (bound - gravity)
            part = room / np.maximum(spring, room)
            narrower = (part.min() if kinematics.positions else part) ** (1.0 / 3.0)
            K_P = narrower**2 * gains["K_P"]
            slower = np.min(narrower)
            gains |= {"K_P": K_P, "width": narrower * width, "bandwidth_share": slower}
            gains["K_v"] = _joint_damping(motion, K_P, slower * w)
        return cls(kinematics, **gains)

    def brake(self, v: np.ndarray) -> np.ndarray:
        """Return the damping torque K_v qd tanh(r) / r (n) [N m or N]."""
        asked = self.K_v.dot(v)
        r = np.abs(asked / self.brake_limit).max()
        return asked * (np.tanh(r) / r) if r > 0.0 else asked

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the torque and the drives.

        The torque is clipped for estimates that no ``GravityProjection`` keeps in their bounds;
        otherwise clipping changes nothing.
        """
        command = super().command(s, model)
        return Command(np.clip(command.torque, -self.bound, self.bound), command.drives)

    def guarded(self, adaptation: Adaptation, dynamics: Dynamics) -> Adaptation:
        """Return the adaptation with a projection that keeps gravity within its share."""
        return GravityProjection(adaptation, dynamics, self.gravity)


def _spring(kinematics: TaskKinematics, K_P: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return what |J_hat^T K_P s| stays below (n) [N m or N].

    Raises:
        GainError: nothing bounds the Jacobian.
    """
    force = np.diag(K_P) * width
    p = kinematics.positions
    robot = kinematics.robot
    if not p:
        return force
    linear, angular = jacobian_bounds(robot.model, robot.frame_id)
    if not np.isfinite(linear).all():
        raise GainError(
            "does not exist: a slide beyond a revolute joint has no position limits.",
            where="bound",
            hint='State them in the description, or take the law "approximate-jacobian".',
        )
    return linear * np.linalg.norm(force[:p]) + angular * force[p:].max(initial=0.0)


def _worst_gravity(robot: Robot) -> np.ndarray:
    """Return what gravity may ask of each joint (n) [N m or N] at seeded configurations."""
    load = assumed_load(robot)
    model = robot.changed(inertial_scale=1.3, payload=load).model
    data = model.createData()
    neutral = pin.neutral(model)
    low, high = position_bounds(model)
    moves = np.random.default_rng(0).uniform(low, high, (500, model.nv))
    places = [robot.q0, *(pin.integrate(model, neutral, move) for move in moves)]
    asked = [pin.computeGeneralizedGravity(model, data, q) for q in places]
    aside = 0.05 * robot.reach * load.mass * np.linalg.norm(model.gravity.linear)
    return np.abs(asked).max(axis=0) + aside
