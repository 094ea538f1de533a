"""From a user's few words to a controller."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive
from ..adaptation import Adaptation, BodyCone, Boxed, Cone, Frozen, Gradient, Natural, Positive, Stacked
from ..exceptions import InputError, ParameterError, did_you_mean
from ..laws import LAWS, Gains, Law, Posture
from ..parameters import (
    BasisParameters,
    BodyParameters,
    DynamicParameters,
    JointParameters,
    KinematicParameters,
    StackedParameters,
)
from ..parameters.joint import NONE, chosen_kinds, without_joint_effects
from ..parameters.kinematic import TOOL, Translation
from ..robot import Robot
from ..robot.workspace import reach
from ..signals import LowPass
from .controller import Controller
from .defaults import INERTIAL_MODE, JOINT_MODE, KINEMATIC_MODE, PREDICTION_RATE, default_gains, default_gradient_gain
from .limits import make_box, make_limits
from .modes import TypicalLoop, frequency, gain_matrix, rate_for, typical_motion

ADAPTATIONS = ("natural", "gradient", "none")


def make_controller(
    believed: Robot,
    *,
    law: str = "adaptive-inverse-dynamics",
    kinematic: str | Sequence[str | Translation] = (TOOL,),
    dynamic: str | Sequence[str] = "all",
    joint: str | Sequence[str] = NONE,
    basis: ArrayLike | None = None,
    lmi: ArrayLike | Cone | None = None,
    adaptation: str = "natural",
    dt: float = 1e-3,
    Kv: ArrayLike | None = None,
    Kp: ArrayLike | None = None,
    alpha: float | None = None,
    gamma_d: ArrayLike | None = None,
    gamma_joint: float | None = None,
    gamma_k: ArrayLike | None = None,
    R_k: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    lambda_: float | None = None,
    lambda_a: float | None = None,
    kinematic_box: ArrayLike | bool | None = None,
    torque_limits: ArrayLike | bool | None = None,
    damping: float = 0.2,
    watch: bool = True,
) -> Controller:
    """Make an adaptive controller for a believed robot; every gain has a default derived from the robot and dt.

    Args:
        believed: what the user believes the robot to be; only read.
        law: a name of ``pinadapt.laws.LAWS``.
        kinematic: unknown translations: "tool", joint names, "joint:length", "lengths".
        dynamic: unknown bodies: "all", "payload" (the last one), "none", or joint names.
        joint: unknown coefficients of the joints: "all", "none", or some of "armature", "viscous", "coulomb".
        basis: (10 n, p) matrix B of the user's own dynamic parameters, pi = B a, instead of bodies.
        lmi: (p, k, k) coefficient matrices of the inequality that natural adaptation keeps, for a basis.
        adaptation: "natural", "gradient" or "none".
        dt: controller period [s], for the defaults.
        Kv: velocity gain, number, list or matrix [1/s; N s/m for energy-based laws, N m s/rad on the rotations of a pose].
        Kp: position gain [1/s^2; N/m for energy-based laws, N m/rad on the rotations of a pose].
        alpha: [1/s].
        gamma_d: rate of the inertial adaptation: a number for natural; number, list or matrix for gradient.
        gamma_joint: rate of the joints' coefficients, which always adapt naturally and so stay positive.
        gamma_k: rate of the kinematic adaptation, number, list or matrix.
        R_k: weight of the kinematic prediction error.
        Q: right-hand side of the Lyapunov equation of the law with task velocity.
        lambda_: velocity filter [1/s].
        lambda_a: acceleration filter [s].
        kinematic_box: where the kinematic estimates stay: a margin around the believed values [m], or p of them; lower and
            upper bounds; False for no box. By default a length stays within a fifth and five times, other coordinates within
            half the robot's reach.
        torque_limits: n bounds [N m or N] at which the torque is clipped and the adaptation of the tracking error rests; True
            for the efforts of the robot's description.
        damping: the right inverse of J_hat is damped where its smallest singular value, estimated from below, falls under this
            fraction of home's; zero never damps.
        watch: end the run with a message when an M_hat to be inverted is not positive definite or the estimates run away;
            False goes on regardless.

    Raises:
        InputError: an unknown name, a gain that breaks a hypothesis, or parameters that cannot be used.
    """
    chosen = _law(law)
    kinematics = KinematicParameters(believed, kinematic)
    dynamics = _dynamics(believed, dynamic, basis, lmi, joint)
    default = default_gains(believed, chosen, positive(dt, "dt"))
    kind = _adaptation(adaptation, chosen)
    _warn_of_lengths(kinematics, dynamics, kind)
    gains = Gains.checked(
        believed.task.size,
        K_v=default.Kv if Kv is None else Kv,
        K_P=default.Kp if Kp is None else Kp,
        alpha=default.alpha if alpha is None else alpha,
        R_k=1.0 if R_k is None else R_k,
        Q=Q,
        margin=chosen.needs_margin,
        positions=believed.task.positions,
    )
    w = default.bandwidth
    loop = TypicalLoop(chosen, kinematics, dynamics, typical_motion(believed, kinematics, w))
    box = make_box(believed, kinematics, kinematic_box)
    adaptation_k = _kinematic_adaptation(kind, loop, gains, w, gamma_k, box)
    if R_k is None:
        gains = replace(gains, R_k=_prediction_weight(loop, adaptation_k, w) * gains.R_k)
    return Controller(
        chosen(gains, Posture(believed)),
        kinematics,
        dynamics,
        adaptation_k=adaptation_k,
        adaptation_d=_dynamic_adaptation(kind, believed, loop, w, gamma_d, gamma_joint, lmi),
        velocity_filter=LowPass(default.lambda_ if lambda_ is None else lambda_, "lambda"),
        acceleration_filter=LowPass(1.0 / (default.lambda_a if lambda_a is None else positive(lambda_a, "lambda_a"))),
        limits=make_limits(believed, dynamics, torque=torque_limits, damping=damping, watch=watch),
        loop=loop,
    )


def _dynamics(
    believed: Robot,
    dynamic: str | Sequence[str],
    basis: ArrayLike | None,
    lmi: ArrayLike | Cone | None,
    joint: str | Sequence[str],
) -> DynamicParameters:
    """Return the inertial parameters, stacked with those of the joints where some are unknown or friction is believed."""
    if lmi is not None and basis is None:
        raise ParameterError("an inequality belongs to a basis of your own.", where="unknown.lmi", hint="Give a basis too.")
    kinds = chosen_kinds(joint)
    stacked = bool(kinds) or believed.friction.present
    carrier = without_joint_effects(believed) if stacked else believed
    bodies = BodyParameters(carrier, dynamic)  # checks the words even where a basis takes their place
    inertial = bodies if basis is None else BasisParameters(carrier, basis)
    return StackedParameters(inertial, JointParameters(believed, kinds)) if stacked else inertial


def _kinematic_adaptation(
    kind: str,
    loop: TypicalLoop,
    gains: Gains,
    bandwidth: float,
    gamma_k: ArrayLike | None,
    box: np.ndarray | None,
) -> Adaptation:
    size = loop.kinematics.size
    if kind == "none":
        return Frozen()
    if gamma_k is None:
        m = loop.kinematics.task.positions
        stiffness = float(np.linalg.eigvalsh((gains.K_P + gains.alpha * gains.K_v)[:m, :m])[-1])
        effects = [np.sqrt(stiffness) * Y_p for Y_p in loop.kinematic]
        gamma_k = rate_for(KINEMATIC_MODE * bandwidth, effects, Gradient(1.0, size), loop.kinematics.initial)
    gradient = Gradient(gamma_k, size, "gamma_k")
    return gradient if box is None else Boxed(gradient, *box, names=loop.kinematics.names, where="unknown.kinematic_box")


def _prediction_weight(loop: TypicalLoop, adaptation: Adaptation, bandwidth: float) -> float:
    """Return R_k with which the prediction error decays at its share of the bandwidth over a typical motion."""
    rate = frequency(loop.kinematic, gain_matrix(adaptation, loop.kinematics.initial)) ** 2
    return PREDICTION_RATE * bandwidth / rate if rate > 0.0 else 1.0


def _dynamic_adaptation(
    kind: str,
    believed: Robot,
    loop: TypicalLoop,
    bandwidth: float,
    gamma_d: ArrayLike | None,
    gamma_joint: float | None,
    lmi: ArrayLike | Cone | None,
) -> Adaptation:
    dynamics = loop.dynamics
    if kind == "none" or not dynamics.size:
        return Frozen()
    inertial = dynamics.inertial if isinstance(dynamics, StackedParameters) else dynamics
    effects = [Phi[:, : inertial.size] for Phi in loop.dynamic]
    adaptation: Adaptation = Frozen()
    if inertial.size and kind == "natural":
        cone = _cone(believed, inertial, lmi)
        mode, unit = INERTIAL_MODE * bandwidth, Natural(1.0, cone)
        adaptation = _natural(rate_for(mode, effects, unit, unit.admit(inertial.initial)) if gamma_d is None else gamma_d, cone)
    elif inertial.size:
        rates = default_gradient_gain(believed, inertial, loop.law) if gamma_d is None else gamma_d
        adaptation = Gradient(rates, inertial.size, "gamma_d")
    if not isinstance(dynamics, StackedParameters) or not dynamics.joint.size:
        return adaptation
    joint = dynamics.joint
    if gamma_joint is None:
        effects = [Phi[:, inertial.size :] for Phi in loop.dynamic]
        gamma_joint = rate_for(JOINT_MODE * bandwidth, effects, Positive(1.0, joint.typical), joint.typical)
    return Stacked([(adaptation, inertial.size), (Positive(gamma_joint, joint.typical), joint.size)])


def _law(name: str) -> type[Law]:
    if name not in LAWS:
        raise InputError(f"no law is called '{name}'; there are {list(LAWS)}.{did_you_mean(name, LAWS)}", where="law")
    return LAWS[name]


def _adaptation(name: str, law: type[Law]) -> str:
    """Return the kind of adaptation, "none" for a law that does not adapt."""
    if name not in ADAPTATIONS:
        what = f"no adaptation is called '{name}'; there are {list(ADAPTATIONS)}.{did_you_mean(name, ADAPTATIONS)}"
        raise InputError(what, where="adaptation")
    return name if law.adapts else "none"


def _natural(rate: ArrayLike, cone: Cone) -> Natural:
    if np.ndim(rate) != 0:
        raise InputError("natural adaptation has one scalar gain.", where="gamma_d")
    return Natural(positive(rate, "gamma_d"), cone)


def _cone(believed: Robot, dynamics: DynamicParameters, lmi: ArrayLike | Cone | None) -> Cone:
    """Return the bodies' cone, or the user's inequality for a basis."""
    cone: Cone
    if isinstance(dynamics, BodyParameters):
        names = [believed.joint_names[body] for body in dynamics.bodies]
        mass = sum(inertia.mass for inertia in believed.model.inertias[1:]) / believed.model.nv
        cone = BodyCone(names, least_mass=1e-3 * mass, least_radius=1e-2 * reach(believed))
    elif lmi is None:
        raise ParameterError(
            "natural adaptation of a user's basis needs the inequality that keeps M positive definite.",
            where="unknown.lmi",
            hint='Give one (see robots/planar_2r/lmi.csv), or use adaptation = "gradient".',
        )
    else:
        cone = lmi if isinstance(lmi, Cone) else Cone(lmi)
    if cone.size != dynamics.size:
        raise ParameterError(f"the inequality has {cone.size} coefficients, there are {dynamics.size} parameters.", where="lmi")
    return cone


def _warn_of_lengths(kinematics: KinematicParameters, dynamics: DynamicParameters, adaptation: str) -> None:
    """Say so when the regressor contains placements that are among the unknowns."""
    joints = [part.name for part in kinematics.translations if part.joint is not None]
    if joints and adaptation != "none" and isinstance(dynamics, BodyParameters) and dynamics.size:
        warnings.warn(
            f"the placements of {joints} are unknown, but the regressor of the bodies' parameters contains them at their "
            "believed values: the proof does not cover this closed loop. A basis of lumped parameters avoids it.",
            stacklevel=3,
        )
