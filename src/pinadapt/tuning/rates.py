"""Adaptations by name, with their default rates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive
from ..adaptation.adaptation import Adaptation, Estimate, Frozen, Stacked
from ..adaptation.composite import Composite, CompositeMemory
from ..adaptation.gradient import Gradient
from ..adaptation.least_squares import LeastSquares
from ..adaptation.natural import (
    BodyInequality,
    ExponentiatedGradient,
    MatrixInequality,
    Natural,
)
from ..adaptation.projections import BoxProjection, MassMatrixProjection
from ..exceptions import InputError, ParameterError, did_you_mean
from ..laws.law import Law
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..models.typical_motion import TypicalMotion
from ..records import SensorQuality
from ..robot.robot import Robot
from .defaults import (
    PREDICTION_RATE,
    frequency,
    gradient_shape,
    prior_variances,
    rate_for,
    typical_start,
    typical_torques,
)
from .noise import NoiseSettings

MEMORIES = ("natural-memory", "composite-memory")
FORGETTING = (*MEMORIES, LeastSquares.name)
PREDICTING = ("natural-composite", "composite", *FORGETTING)
_METRICS = {
    "composite": "gradient",
    "natural-composite": "natural",
    "composite-memory": "gradient",
    "natural-memory": "natural",
    "least-squares": "gradient",
}  # of the adaptations that predict the torque
ADAPTATIONS = ("natural", "gradient", "projected", *_METRICS, "none")
KINEMATIC_ADAPTATIONS = ("gradient", "least-squares", "none")
RATES = (
    "gamma_d",
    "gamma_joint",
    "gamma_k",
    "prediction_rate",
    "prediction_filter",
    "forgetting",
    "kinematic_rate",
    "kinematic_forgetting",
)  # as users write them

_THICKNESS = 1e-2  # least thickness of the last body, as a share of the reach
_THINNEST = 1e-4  # [m]
_LOAD = 0.1  # load that the last body may have, as a share of the robot's mass

# prediction of the torque; rates in bandwidths
_LEAST_SQUARES = 1e3  # initial rate
_FORGETTING = 0.125
# noise that a memory assumes, of the torque that its covariance explains; half: errors of up to
# 0.11 % of the radius with Stribeck friction in place of 0.064; twice: 0.061
_NOISE = 0.01
_INTERVAL = 0.5  # between evaluations, in 1 / rate
# of a memory that cannot explain all of the torque; 3: its parameters follow the errors of others
# until some loops at 1 kHz are unstable (human_left_arm); 12: errors of some arms are larger
_DOUBT = 6.0
# of P in standard deviations of the prior; half: errors as there of up to 0.23 %; twice: 0.06
_WIDTH = 3.0
_HORIZON = 2000.0  # in 1 / bandwidth: encoder noise then adds as much information as the prior
_FLOOR = 1e-2  # of the torque due to the gain for the tracking error over a typical motion

# prediction of position or velocity; rates in bandwidths
_KINEMATIC_RATE = 1.0
_KINEMATIC_FORGETTING = 0.125
_PRIOR = 0.1  # error of the translations, as a share of the reach
_FINEST = 1e-3  # least noise, as a share of the signal by that prior


def check_adaptation(kind: str, where: str, kinds: Sequence[str]) -> None:
    """Refuse an unknown kind of adaptation.

    Raises:
        InputError: unknown; the nearest is suggested.
    """
    if kind not in kinds:
        raise InputError(
            f"no adaptation is called '{kind}'; there are {list(kinds)}."
            f"{did_you_mean(kind, kinds)}",
            where=where,
        )


def default_adaptation(law: type[Law], dynamics: Dynamics) -> str:
    """Return the kind of adaptation of a controller that names none.

    It is "natural-memory" with a law that ``remembers`` for parameters of bodies, else "natural".
    """
    return "natural-memory" if law.remembers and dynamics.per_body else "natural"


def default_kinematic_adaptation(law: type[Law], kinematics: TaskKinematics) -> str:
    """Return the kind of kinematic adaptation of a controller that names none but adapts.

    It is "least-squares" with a law that learns from positions where the tool, the base or both are
    unknown, else "gradient". The prediction of a position is exact for the true translations,
    whatever the torque does and however late the frame is, and least squares averages the noise
    of frames. Where lengths of links are unknown too, a motion hardly separates them, and a fast
    change of them disturbs the estimates of the inertias with which they are multiplied. Published
    laws keep what is published.
    """
    few = all(part.joint in (None, FIRST) for part in kinematics.translations)
    return LeastSquares.name if law.uses_position_error and few else "gradient"


def metric_of(kind: str) -> str:
    """Return the kind of adaptation in whose metric another moves: most in their own."""
    return _METRICS.get(kind, kind)


def predicting_kind(kind: str, law: str) -> str:
    """Return the kind of adaptation that predicts the torque in the metric of another.

    Raises:
        InputError: there is none.
    """
    if kind in _METRICS or kind in ("none", "custom"):
        return kind
    for name, metric in _METRICS.items():
        if metric == kind:
            return name
    raise InputError(
        f"the law '{law}' learns from the prediction of the torque alone; '{kind}' predicts none.",
        where="adaptation",
        hint=f"Take one of {list(_METRICS)}.",
    )


def dynamic_adaptation(
    kind: str,
    law: Law,
    motion: TypicalMotion,
    bandwidth: float,
    rates: Mapping[str, Any],
    lmi: ArrayLike | MatrixInequality | None,
    share: float = 1.0,
    jitter: float = 0.0,
    torque: float = 0.0,
) -> Adaptation:
    """Return the dynamic adaptation with given rates or a share of the default ones.

    Args:
        kind: of adaptation.
        law: whose loop the default rates follow.
        motion: of the model.
        bandwidth: w [rad/s].
        rates: those given, by the names of ``RATES``.
        lmi: matrix inequality for a basis of the user's own.
        share: of the default rates.
        jitter: standard deviation of the joint velocity behind its low pass [rad/s or m/s].
        torque: by which a declared torque sensor is off [N m or N].

    Raises:
        InputError: a rate or an inequality that does not fit the parameters.
    """
    if kind == "none" or not motion.dynamics.size:
        return Frozen()
    w, load = bandwidth * share**0.5, _LOAD if kind in MEMORIES else 0.0
    moved = _tracking_adaptation(metric_of(kind), law, motion, w, rates, lmi, load)
    if kind in _METRICS:
        mode = law.prediction_mode
        moved = predicting(kind, moved, motion, bandwidth, share, rates, mode, jitter, torque)
    return law.guarded(moved, motion.dynamics)


def _tracking_adaptation(
    kind: str,
    law: Law,
    motion: TypicalMotion,
    w: float,
    rates: Mapping[str, Any],
    lmi: ArrayLike | MatrixInequality | None,
    load: float,
) -> Adaptation:
    """Return the adaptation to the tracking error at a bandwidth w [rad/s]."""
    dynamics, effects = motion.dynamics, law.parameter_effects(motion)
    inertial, joints = dynamics.inertial, dynamics.joints
    own = [Phi[:, : inertial.size] for Phi in effects]
    mode, gamma_d = law.adaptation_mode * w, rates.get("gamma_d")
    bare = dynamics.bare(motion.robot)
    adaptation = _inertial_adaptation(kind, bare, inertial, own, mode, gamma_d, lmi, load)
    if joints is None or not joints.size:
        return adaptation
    typical, gamma_joint = joints.typical, rates.get("gamma_joint")
    if gamma_joint is None:
        own = [Phi[:, inertial.size :] for Phi in effects]
        unit = Stacked(_of_joints(1.0, typical, joints.signed))
        gamma_joint = rate_for(law.joint_mode * w, own, unit, Estimate(typical))
    of_joints = _of_joints(gamma_joint, typical, joints.signed)
    return Stacked([(adaptation, inertial.size), *of_joints])


def _of_joints(gamma: float, typical: np.ndarray, signed: int) -> list[tuple[Adaptation, int]]:
    """Return the adaptations of coefficients (p), the last ``signed`` of which may be negative."""
    count = typical.size - signed
    parts: list[tuple[Adaptation, int]] = []
    if count:
        parts.append((ExponentiatedGradient(gamma, typical[:count], "gamma_joint"), count))
    if signed:
        gain = positive(gamma, "gamma_joint") * typical[count:] ** 2
        parts.append((Gradient(gain, signed, "gamma_joint"), signed))
    return parts


def _inertial_adaptation(
    kind: str,
    robot: Robot,
    dynamics: Dynamics,
    effects: list[np.ndarray],
    mode: float,
    gamma_d: ArrayLike | None,
    lmi: ArrayLike | MatrixInequality | None,
    load: float,
) -> Adaptation:
    """Return the adaptation of the inertial parameters; by default its fastest mode is ``mode``."""
    if not dynamics.size:
        return Frozen()
    if kind == "natural":
        cone = _cone(robot, dynamics, lmi)
        unit = Natural(1.0, cone)
        if gamma_d is None:
            gamma_d = rate_for(mode, effects, unit, unit.init(dynamics.initial))
        if isinstance(gamma_d, Iterable) and not isinstance(gamma_d, str):
            raise InputError("natural adaptation has one scalar gain.", where="gamma_d")
        shares = _shares(robot, dynamics, unit, load)
        return Natural(positive(gamma_d, "gamma_d"), cone, shares=shares)
    if gamma_d is None:
        shape = gradient_shape(robot, dynamics, effects)
        start = Estimate(dynamics.initial)
        gamma_d = shape * rate_for(mode, effects, Gradient(shape, dynamics.size), start)
    gradient = Gradient(gamma_d, dynamics.size, "gamma_d")
    return MassMatrixProjection(gradient, dynamics, robot) if kind == "projected" else gradient


def _shares(robot: Robot, dynamics: Dynamics, unit: Natural, load: float) -> np.ndarray | None:
    """Return relative rates, one per body, where the last one may carry more than it is; else None.

    Mass and thickness of a body scale how far its parameters may move in the metric, but an unknown
    load may be on the last body whatever its description says: that body is learned as fast as if
    it had a load, a share of the robot's mass, besides, or a thickness of a hundredth of the reach.
    """
    last = robot.model.nv - 1
    if not dynamics.per_body or last not in dynamics.bodies:
        return None
    shares = np.ones(len(dynamics.bodies))
    index = list(dynamics.bodies).index(last)
    P = unit.cone.matrices(unit.init(dynamics.initial).value)[index]
    about_centre = P[:3, :3] / P[3, 3] - np.outer(P[:3, 3], P[:3, 3]) / P[3, 3] ** 2
    radius = np.sqrt(max(np.linalg.eigvalsh(about_centre)[0], 0.0))
    shares[index] = max(1.0, (_THICKNESS * robot.reach / max(radius, _THINNEST)) ** 2)
    shares[index] = max(shares[index], 1.0 + load * pin.computeTotalMass(robot.model) / P[3, 3])
    return shares if shares[index] > 1.0 else None


def _cone(
    robot: Robot, dynamics: Dynamics, lmi: ArrayLike | MatrixInequality | None
) -> MatrixInequality:
    """Return the bodies' cone, or the user's inequality for a basis."""
    cone: MatrixInequality
    if dynamics.per_body:
        names = [robot.joint_names[body] for body in dynamics.bodies]
        mass = pin.computeTotalMass(robot.model) / robot.model.nv
        cone = BodyInequality(names, least_mass=1e-3 * mass, least_radius=1e-2 * robot.reach)
    elif lmi is None:
        raise ParameterError(
            "natural adaptation of a user's basis needs the inequality that keeps M positive "
            "definite.",
            where="unknown.lmi",
            hint='Give one (see robots/planar_2r/lmi.csv), or use adaptation = "gradient".',
        )
    else:
        cone = lmi if isinstance(lmi, MatrixInequality) else MatrixInequality(lmi)
    if cone.size != dynamics.size:
        raise ParameterError(
            f"the inequality has {cone.size} coefficients, there are {dynamics.size} parameters.",
            where="lmi",
        )
    return cone


def predicting(
    kind: str,
    moved: Adaptation,
    motion: TypicalMotion,
    bandwidth: float,
    share: float,
    rates: Mapping[str, Any],
    mode: float,
    jitter: float,
    torque: float,
) -> Adaptation:
    """Return an adaptation that also follows the prediction error of the torque.

    That error decays at ``mode`` times the bandwidth w, after a low pass of bandwidth w. Least
    squares, whose gain decreases as it learns, starts at 1000 w: this assumes noise of 3 % of the
    torque due to the initial uncertainty, independent after 1 / w. Each direction forgets by
    itself, at w / 8: no motion excites all ten parameters of every body, so that bounded-gain
    forgetting, which waits for all of them, would forget nothing. Of three
    values tried on panda, ur5 and z1 for 3 s, 1000 is the largest; the others make little
    difference there.

    A memory moves the estimate at the same rate whatever the noise and the period are, because it
    averages the noise and is stable at any period. It assumes noise of 1 % of the torque due to the
    initial uncertainty, and forgets at w where new data contradict it by that noise. Its
    covariance is that of the default rates, of which the tracking error has the given share.

    Noise of the joint velocity, behind its low pass, is noise of the acceleration in W, of the size
    of the torque filter's bandwidth times it. Its spurious information on the parameters adds up,
    whatever the motion, and would move those that nothing excites. The memory's noise is so large
    that this reaches the initial uncertainty after 2000 time constants of that filter, about a
    minute; the motion gives hundreds of times as much meanwhile. And the start is remembered as
    well as the noise, see ``prior_information``: least squares on a noisy W says that what no
    motion shows is zero.

    Args:
        kind: of ``PREDICTING``.
        moved: adaptation to the tracking error.
        motion: of the model.
        bandwidth: w [rad/s].
        share: of the default rates, for noise and the period.
        rates: given ``prediction_rate``, ``prediction_filter`` and ``forgetting``.
        mode: ``Law.prediction_mode``.
        jitter: standard deviation of the joint velocity behind its low pass [rad/s or m/s].
        torque: by which a declared torque sensor is off [N m or N].

    Raises:
        GainError: a rate that is not positive.
    """
    default = _LEAST_SQUARES if kind == LeastSquares.name else mode
    rate = _given(rates, "prediction_rate", default * bandwidth * share)
    low_pass = _given(rates, "prediction_filter", bandwidth)
    torques = typical_torques(moved, motion)
    if kind in MEMORIES:
        rate = _given(rates, "prediction_rate", mode * bandwidth)
        forgetting = _given(rates, "forgetting", bandwidth)
        unit = _WIDTH**2 * _unit(moved, motion)  # P = unit Gamma
        variance, prior = _NOISE**2 * unit * torques, None
        if jitter:
            shaken = unit * shaken_torques(moved, motion, low_pass * jitter)
            variance += _HORIZON * shaken
            prior = prior_information(moved, motion, low_pass * shaken / variance) / unit
        return CompositeMemory(
            moved,
            low_pass,
            rate=rate,
            noise=np.sqrt(variance + torque**2),
            forgetting=forgetting,
            share=1.0 / unit,
            doubt=1.0 if explains_all(motion) else _DOUBT,
            interval=_INTERVAL / rate,
            unit=1.0 / _WIDTH**2,
            prior=prior,
        )
    if kind != LeastSquares.name:
        return Composite(moved, low_pass, rate=rate, floor=_FLOOR * torques)
    forgetting = _given(rates, "forgetting", _FORGETTING * bandwidth * share)
    P_0, size = moved.gain(typical_start(moved, motion)), motion.dynamics.size
    weight = rate / torques
    return LeastSquares(
        P_0,
        size,
        low_pass,
        weight=weight,
        forgetting=forgetting,
        directional=True,
        unit=_unit(moved, motion),
    )


def _unit(adaptation: Adaptation, motion: TypicalMotion) -> float:
    """Return the size of the prior covariance relative to Gamma, the median over the bodies.

    Where no body is unknown, the joints' coefficients are off by typical ones. One where there is
    no prior.
    """
    prior: np.ndarray | None = motion.dynamics.typical**2
    if motion.dynamics.inertial.size:
        prior = prior_variances(motion.robot, motion.dynamics)
    if prior is None:
        return 1.0
    Gamma = adaptation.gain(typical_start(adaptation, motion))
    return float(np.median(prior / np.diag(Gamma)[: len(prior)]))


def explains_all(motion: TypicalMotion) -> bool:
    """Return whether all bodies and the friction of all joints are among the parameters."""
    joints = motion.robot.joint_names
    friction = {f"{name}.{kind}" for name in joints for kind in ("viscous", "coulomb")}
    dynamics = motion.dynamics
    return friction.issubset(dynamics.names) and len(dynamics.bodies) == len(joints)


def prior_information(
    adaptation: Adaptation, motion: TypicalMotion, noise: np.ndarray
) -> np.ndarray:
    """Return the information (p, p) that the start has as often as noise has its own, per second.

    It is the metric of the adaptation at typical parameters, with the trace of the noise: a motion
    gives hundreds of times as much on what it excites.

    Args:
        adaptation: with Gamma.
        motion: of the model.
        noise: (n) diagonal of R E[Y Gamma Y^T], what the noise of each row adds per second.
    """
    Gamma = adaptation.gain(typical_start(adaptation, motion))
    return np.asarray(noise.sum() / len(Gamma) * np.linalg.inv(Gamma))


def shaken_torques(adaptation: Adaptation, motion: TypicalMotion, a: float) -> np.ndarray:
    """Return the mean diagonal (n) of E Y Gamma Y^T, Y due to accelerations of the joints alone.

    Args:
        adaptation: with Gamma.
        motion: of the model.
        a: standard deviation of the acceleration of each joint [rad/s^2 or m/s^2].
    """
    start, regressor = typical_start(adaptation, motion), motion.dynamics.regressor
    rest, found = np.zeros(motion.robot.model.nv), []
    for q in motion.states.q:
        still = np.array(regressor(q, rest, rest))
        for e in np.eye(rest.size):
            Y = regressor(q, rest, e) - still
            found.append(np.sum(Y.T * adaptation.gain_times(start, Y.T), axis=0))
    return np.asarray(a**2 * rest.size * np.mean(found, axis=0))


def tracking_share(kind: str, law: Law, mode: float) -> float:
    """Return the share of the law's default rates for the tracking error.

    Beside a memory its mode is at most the bandwidth.

    Args:
        kind: of adaptation.
        law: with its mode, at the default rates.
        mode: share of it that the noise of the sensors leaves.
    """
    if kind in MEMORIES:
        mode = min(mode, 1.0 / law.adaptation_mode)
    return mode**2


def _given(rates: Mapping[str, Any], name: str, default: float) -> float:
    given = rates.get(name)
    return default if given is None else positive(given, name, zero=name == "forgetting")


def kinematic_adaptation(
    kind: str,
    law: Law,
    motion: TypicalMotion,
    bandwidth: float,
    rates: Mapping[str, Any],
    box: np.ndarray | None,
    settings: NoiseSettings,
    quality: SensorQuality,
) -> Adaptation:
    """Return the kinematic adaptation with given or default rates, in a box or without.

    Args:
        kind: of ``KINEMATIC_ADAPTATIONS``, or "custom", for which nothing is tuned.
        law: whose coupling of estimate and error the default rate follows.
        motion: of the model.
        bandwidth: w [rad/s].
        rates: those given by name, ``gamma_k`` a number, list or matrix.
        box: (2, p) bounds or None.
        settings: of the filters, for noise and delay of the camera.
        quality: of the camera.
    """
    kinematics, gamma_k = motion.kinematics, rates.get("gamma_k")
    size, loop = kinematics.size, law.kinematic_loop()
    if kind == "none" or not size or not law.learns_kinematics:
        return Frozen()
    if gamma_k is None:
        stiffness = 1.0 if loop is None else loop.stiffness
        effects = [np.sqrt(stiffness) * Y_p for Y_p in motion.kinematic_regressors]
        mode = min(law.kinematic_mode * bandwidth, settings.kinematic)
        unit = Gradient(kinematics.sizes**2, size)
        start = Estimate(kinematics.initial)
        gamma_k = rate_for(mode, effects, unit, start) * kinematics.sizes**2
    moved: Adaptation = Gradient(gamma_k, size, "gamma_k")
    if kind == LeastSquares.name:
        P_0 = moved.gain(Estimate(kinematics.initial))
        moved = kinematic_least_squares(P_0, law, motion, bandwidth, rates, settings, quality)
    if box is None:
        return moved
    return BoxProjection(moved, *box, names=kinematics.names)


def kinematic_least_squares(
    P_0: np.ndarray,
    law: Law,
    motion: TypicalMotion,
    bandwidth: float,
    rates: Mapping[str, Any],
    settings: NoiseSettings,
    quality: SensorQuality,
) -> LeastSquares:
    """Return least squares on the prediction error of position or velocity, with gain P(0) (p, p).

    Error and gain decrease at the bandwidth w, so that the loop can follow the reference, which
    contains da_k/dt, until the gain is the ratio of the camera's noise to translation errors of a
    tenth of the reach; from then on frames are averaged. Each direction forgets by itself, at w / 8
    or an eighth of the bandwidth of the low pass on the frames. A given weight R_k replaces all but
    the forgetting.

    Args:
        P_0: the gain at the start.
        law: that predicts positions or velocities.
        motion: of the model.
        bandwidth: w [rad/s].
        rates: given ``kinematic_rate``, ``kinematic_forgetting`` and ``R_k``.
        settings: of the filters.
        quality: of the camera.

    Raises:
        GainError: a rate that is not positive.
    """
    rate, forgetting = rates.get("kinematic_rate"), rates.get("kinematic_forgetting")
    if forgetting is None:
        forgetting = _KINEMATIC_FORGETTING * min(bandwidth, settings.smoothing)
    kinematics, size = motion.kinematics, motion.kinematics.size
    unit = (_PRIOR * motion.robot.reach) ** 2 / np.mean(np.diag(P_0) / kinematics.sizes**2)
    options: dict[str, Any] = {
        "weight": None, "forgetting": forgetting, "directional": True, "unit": unit
    }  # fmt: skip
    if rates.get("R_k") is not None and rate is None:
        return LeastSquares(P_0, size, **options)
    rate = _KINEMATIC_RATE * bandwidth if rate is None else positive(rate, "kinematic_rate")
    seen = motion.position_regressors if law.uses_position_error else motion.kinematic_regressors
    squares = [np.einsum("ij,jk,ik->i", X, P_0, X) for X in seen]
    typical = float(np.mean(squares)) if squares else 0.0
    # noise of the measured signal over its size by the prior, white over a second
    spread = quality.x if law.uses_position_error else quality.x * _velocity_filter(law, bandwidth)
    off = math.sqrt(unit * typical)
    noise = rate * (spread / off) ** 2 / quality.rate if spread and off else 0.0
    floor = typical * max(noise, _FINEST**2)
    return LeastSquares(P_0, size, rate=rate, floor=floor or 1.0, **options)


def _velocity_filter(law: Law, bandwidth: float) -> float:
    """Return the bandwidth [1/s] of the velocity filter of a law that predicts velocities."""
    return float(getattr(law, "lambda_", bandwidth))


def prediction_weight(
    law: Law, motion: TypicalMotion, adaptation: Adaptation, bandwidth: float, noise: float
) -> float:
    """Return R_k with which the prediction error decays at its share of the bandwidth.

    Args:
        law: that predicts velocities or positions.
        motion: of the model.
        adaptation: of the kinematic estimate.
        bandwidth: w [rad/s].
        noise: largest rate that the camera's noise allows [1/s].
    """
    seen = motion.position_regressors if law.uses_position_error else motion.kinematic_regressors
    rate = frequency(seen, adaptation.gain(Estimate(motion.kinematics.initial))) ** 2
    return min(PREDICTION_RATE * bandwidth, noise) / rate if rate > 0.0 else 1.0
