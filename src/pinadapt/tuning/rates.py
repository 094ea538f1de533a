"""Adaptations by name, with their default rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

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
from ..exceptions import InputError, ParameterError
from ..laws.law import Law
from ..models.bodies import ALL, chosen_bodies
from ..models.dynamics import Dynamics
from ..models.joint_effects import chosen_coefficients
from ..models.linear_kinematics import OFF
from ..models.typical_motion import TypicalMotion
from ..robot.robot import LOAD, Robot
from .defaults import (
    frequency,
    gradient_shape,
    mean_diagonal,
    prior_variances,
    quiet_start,
    rate_for,
    typical_torques,
)
from .noise import Tuning

MEMORIES = ("natural-memory", "composite-memory")
FORGETTING = (*MEMORIES, LeastSquares.name)
METRICS = {
    "composite": "gradient",
    "natural-composite": "natural",
    "composite-memory": "gradient",
    "natural-memory": "natural",
    "least-squares": "gradient",
}  # of the adaptations that predict the torque
PREDICTING = tuple(METRICS)
ADAPTATIONS = ("natural", "gradient", "projected", *PREDICTING, "none")
KINEMATIC_ADAPTATIONS = ("gradient", "least-squares", "none")
RATES = (
    "gamma_d",
    "gamma_joint",
    "gamma_k",
    "prediction_rate",
    "prediction_filter",
    "forgetting",
)  # as users write them

# least thickness of the last body, as a share of the reach; it is above that of two robots of 129:
# finger_edu and tiago_arm learn it a quarter or four times as fast with half or twice
_THICKNESS = 1e-2

# of the bandwidth: forgetting of least squares, and decay of the kinematic prediction error; half:
# drifting parameters are followed half as fast; twice: what a motion shows is lost within a turn
_SLOW = 0.125
# initial rate of least squares on the torque, in bandwidths; half, twice: little difference
_LEAST_SQUARES = 1e3
# noise that a memory assumes, of the torque that its covariance explains; half: errors of up to
# 0.11 % of the radius with Stribeck friction in place of 0.064; twice: 0.061
_NOISE = 0.01
# of a memory that cannot explain all of the torque; 3: its parameters follow the errors of others
# until some loops at 1 kHz are unstable (human_left_arm); 12: errors of some arms are larger
_DOUBT = 6.0
# of P in standard deviations of the prior; half: errors as there of up to 0.23 %; twice: 0.06
_WIDTH = 3.0
# in 1 / bandwidth: encoder noise then adds as much information as the prior; half, twice: noisy
# encoders count for more, for less
_HORIZON = 2000.0


def predicting_kind(kind: str, law: str) -> str:
    """Return the kind of adaptation that predicts the torque in the metric of another.

    Raises:
        InputError: there is none.
    """
    if kind in METRICS or kind in ("none", "custom"):
        return kind
    for name, metric in METRICS.items():
        if metric == kind:
            return name
    raise InputError(
        f"the law '{law}' learns from the prediction of the torque alone; '{kind}' predicts none.",
        where="adaptation",
        hint=f"Take one of {list(METRICS)}.",
    )


def dynamic_adaptation(kind: str, tuning: Tuning, share: float = 1.0) -> Adaptation:
    """Return the dynamic adaptation with given rates or a share of the default ones.

    Beside a memory the tracking error adapts at most at the bandwidth.

    Args:
        kind: of adaptation.
        tuning: of the loop, which the default rates follow.
        share: of the default rates, beside that which noise leaves.

    Raises:
        InputError: a rate or an inequality that does not fit the parameters.
    """
    law = tuning.law
    motion = tuning.motion
    mode = tuning.settings.mode
    dynamics = motion.dynamics
    joints = dynamics.joints
    if not dynamics.size:
        return Frozen()
    if kind in MEMORIES:
        mode = min(mode, 1.0 / law.adaptation_mode)
    share *= mode**2
    w = tuning.bandwidth * share**0.5
    size = dynamics.inertial.size
    effects = law.parameter_effects(motion)
    moved = _inertial_adaptation(kind, tuning, effects[..., :size], law.adaptation_mode * w)
    if joints is not None and joints.size:
        typical = joints.typical
        gamma = tuning.rates.get("gamma_joint")
        if gamma is None:
            unit = Stacked(_of_joints(1.0, typical, joints.signed))
            gamma = rate_for(law.joint_mode * w, effects[..., size:], unit, Estimate(typical))
        moved = Stacked([(moved, size), *_of_joints(gamma, typical, joints.signed)])
    if kind in METRICS:
        moved = predicting(kind, moved, tuning, share)
    return law.guarded(moved, dynamics)


def _of_joints(gamma: float, typical: np.ndarray, signed: int) -> list[tuple[Adaptation, int]]:
    """Return the adaptations of coefficients (p), the last ``signed`` of which may be negative."""
    count = typical.size - signed
    parts = [
        (ExponentiatedGradient(gamma, typical[:count]), count),
        (Gradient(gamma * typical[count:] ** 2, signed, "gamma_joint"), signed),
    ]
    return [part for part in parts if part[1]]


def _inertial_adaptation(kind: str, tuning: Tuning, effects: np.ndarray, mode: float) -> Adaptation:
    """Return the adaptation of the inertial parameters; by default its fastest mode is ``mode``."""
    dynamics = tuning.motion.dynamics.inertial
    gamma_d = tuning.rates.get("gamma_d")
    robot = tuning.motion.dynamics.bare(tuning.motion.robot)
    if not dynamics.size:
        return Frozen()
    if METRICS.get(kind, kind) == "natural":
        cone = _cone(robot, dynamics, tuning.lmi)
        natural = Natural(1.0, cone)
        if gamma_d is None:
            gamma_d = rate_for(mode, effects, natural, natural.init(dynamics.initial))
        shares = _shares(robot, dynamics, natural, LOAD if kind in MEMORIES else 0.0)
        return Natural(gamma_d, cone, shares=shares)
    if gamma_d is None:
        shape = gradient_shape(robot, dynamics, effects)
        unit = Gradient(shape, dynamics.size)
        gamma_d = shape * rate_for(mode, effects, unit, Estimate(dynamics.initial))
    gradient = Gradient(gamma_d, dynamics.size, "gamma_d")
    return MassMatrixProjection(gradient, dynamics, robot) if kind == "projected" else gradient


def _shares(robot: Robot, dynamics: Dynamics, unit: Natural, load: float) -> np.ndarray | None:
    """Return relative rates, one per body, where that of a frame may carry a load; else None.

    Mass and thickness of a body scale how far its parameters may move in the metric, but an unknown
    load may be on the body of the frame whatever its description says: that body is learned as fast
    as if it had a load, a share of the robot's mass, besides, or a thickness of a hundredth of the
    reach.
    """
    if not dynamics.per_body:
        return None
    shares = np.ones(len(dynamics.bodies))
    for index in np.flatnonzero(np.isin(dynamics.bodies, robot.carriers)):
        P = unit.cone.matrices(unit.init(dynamics.initial).value)[index]
        mass = P[3, 3]
        centre = P[:3, 3] / mass
        square = np.linalg.eigvalsh(P[:3, :3] / mass - np.outer(centre, centre))[0]
        thick = (_THICKNESS * robot.reach) ** 2 / max(square, 1e-8)
        shares[index] = max(1.0, thick, 1.0 + load * robot.mass / mass)
    return shares if shares.max() > 1.0 else None


def _cone(
    robot: Robot, dynamics: Dynamics, lmi: ArrayLike | MatrixInequality | None
) -> MatrixInequality:
    """Return the bodies' cone, or the user's inequality for a basis."""
    cone: MatrixInequality
    if dynamics.per_body:
        names = [robot.joint_names[body] for body in dynamics.bodies]
        mass = robot.mass / robot.model.nv
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


def predicting(kind: str, moved: Adaptation, tuning: Tuning, share: float) -> Adaptation:
    """Return an adaptation that also follows the prediction error of the torque.

    That error decays at ``Law.prediction_mode`` times the bandwidth w, after a low pass of
    bandwidth w. Least squares, whose gain decreases as it learns, starts at 1000 w: this assumes
    noise of 3 % of the torque due to the initial uncertainty, independent after 1 / w. Each
    direction forgets by itself, at w / 8: no motion excites all ten parameters of every body, so
    that bounded-gain forgetting, which waits for all of them, would forget nothing.

    A memory moves the estimate at the same rate whatever the noise and the period are, because it
    averages the noise and is stable at any period. It assumes noise of 1 % of the torque due to the
    initial uncertainty, and forgets at w where new data contradict it by that noise. Its
    covariance is that of the default rates, of which the tracking error has the given share.

    Noise of the joint velocity, behind its low pass, is noise of the acceleration in W, of the size
    of the torque filter's bandwidth times it. Its spurious information on the parameters adds up,
    whatever the motion, and would move those that nothing excites. The memory's noise is so large
    that this reaches the initial uncertainty after 2000 time constants of that filter, about a
    minute; the motion gives hundreds of times as much meanwhile. And the start is remembered as
    well as the noise, with the metric as its weight: least squares on a noisy W says that what no
    motion shows is zero.

    Args:
        kind: of ``PREDICTING``.
        moved: adaptation to the tracking error.
        tuning: of the loop.
        share: of the default rates, for noise and the period.

    Raises:
        GainError: a rate that is not positive.
    """
    w = tuning.bandwidth
    motion = tuning.motion
    mode = tuning.law.prediction_mode
    low_pass = tuning.rate("prediction_filter", w)
    torques = typical_torques(moved, motion)
    Gamma = moved.gain(quiet_start(moved, motion.dynamics.typical))
    if kind in MEMORIES:
        rate = tuning.rate("prediction_rate", mode * w)
        dynamics = motion.dynamics
        friction = set(chosen_coefficients(motion.robot, ("viscous", "coulomb")))
        whole = list(dynamics.bodies) == chosen_bodies(motion.robot, ALL)
        explains_all = whole and friction.issubset(dynamics.names)
        unit = _WIDTH**2 * _unit(Gamma, motion)  # P = unit Gamma
        variance = _NOISE**2 * unit * torques
        prior = None
        if tuning.jitter:
            shaken = unit * _shaken_torques(moved, motion, low_pass * tuning.jitter)
            variance += _HORIZON * shaken
            # the metric at typical parameters, with the trace of what the noise adds per second
            added = np.sum(low_pass * shaken / variance) / len(Gamma)
            prior = added * np.linalg.inv(Gamma) / unit
        return CompositeMemory(
            moved,
            low_pass,
            rate=rate,
            noise=np.sqrt(variance + tuning.quality.tau**2),
            forgetting=tuning.rate("forgetting", w),
            share=1.0 / unit,
            doubt=1.0 if explains_all else _DOUBT,
            interval=0.5 / rate,
            unit=1.0 / _WIDTH**2,
            prior=prior,
        )
    if kind != LeastSquares.name:
        rate = tuning.rate("prediction_rate", mode * w * share)
        return Composite(moved, low_pass, rate=rate, floor=0.01 * torques)
    rate = tuning.rate("prediction_rate", _LEAST_SQUARES * w * share)
    return LeastSquares(
        Gamma,
        motion.dynamics.size,
        low_pass,
        weight=rate / torques,
        forgetting=tuning.rate("forgetting", _SLOW * w * share),
        directional=True,
        unit=_unit(Gamma, motion),
    )


def _unit(Gamma: np.ndarray, motion: TypicalMotion) -> float:
    """Return the size of the prior covariance relative to Gamma (p, p), the median over the bodies.

    Where no body is unknown, the joints' coefficients are off by typical ones. One where there is
    no prior.
    """
    prior: np.ndarray | None = motion.dynamics.typical**2
    if motion.dynamics.inertial.size:
        prior = prior_variances(motion.robot, motion.dynamics)
    if prior is None:
        return 1.0
    return np.median(prior / np.diag(Gamma)[: len(prior)])


def _shaken_torques(adaptation: Adaptation, motion: TypicalMotion, a: float) -> np.ndarray:
    """Return the mean diagonal (n) of E Y Gamma Y^T, Y due to accelerations of the joints alone.

    These have the standard deviation ``a`` [rad/s^2 or m/s^2].
    """
    regressor = motion.dynamics.regressor
    rest = np.zeros(motion.robot.model.nv)
    changes = []
    for q, free in zip(motion.states.q, motion.free, strict=True):
        still = regressor(q, rest, rest)
        changes += [free @ (regressor(q, rest, e) - still) for e in np.eye(rest.size)]
    return a**2 * rest.size * mean_diagonal(adaptation, motion, changes)


def kinematic_adaptation(kind: str, tuning: Tuning, box: np.ndarray | None) -> Adaptation:
    """Return the kinematic adaptation with given or default rates, in a box or without.

    Args:
        kind: of ``KINEMATIC_ADAPTATIONS``, or "custom", for which nothing is tuned.
        tuning: of the loop; the default rate follows the law's coupling of estimate and error.
        box: (2, p) bounds or None.
    """
    law = tuning.law
    kinematics = tuning.motion.kinematics
    gamma_k = tuning.rates.get("gamma_k")
    size = kinematics.size
    if kind == "none" or not size or not law.learns_kinematics:
        return Frozen()
    start = Estimate(kinematics.initial)
    if gamma_k is None:
        loop = law.kinematic_loop()
        stiffness = 1.0 if loop is None else loop.stiffness
        effects = np.sqrt(stiffness) * tuning.motion.kinematic_regressors
        mode = min(law.kinematic_mode * tuning.bandwidth, tuning.settings.kinematic)
        unit = Gradient(kinematics.sizes**2, size)
        gamma_k = rate_for(mode, effects, unit, start) * kinematics.sizes**2
    moved: Adaptation = Gradient(gamma_k, size, "gamma_k")
    if kind == LeastSquares.name:
        moved = kinematic_least_squares(moved.gain(start), tuning)
    return moved if box is None else BoxProjection(moved, *box, names=kinematics.names)


def kinematic_least_squares(P_0: np.ndarray, tuning: Tuning) -> LeastSquares:
    """Return least squares on the prediction error of position or velocity, with gain P(0) (p, p).

    Error and gain decrease at the bandwidth w, so that the loop can follow the reference, which
    contains da_k/dt, until the gain is the ratio of the camera's noise to translation errors of a
    tenth of the reach; from then on frames are averaged. Each direction forgets by itself, at w / 8
    or an eighth of the bandwidth of the low pass on the frames. A given weight R_k replaces all but
    the forgetting.
    """
    law, motion, w, quality = tuning.law, tuning.motion, tuning.bandwidth, tuning.quality
    kinematics = motion.kinematics
    unit = (OFF * motion.robot.reach) ** 2 / np.mean(np.diag(P_0) / kinematics.sizes**2)
    seen = motion.position_regressors
    spread = quality.x
    if not law.uses_position_error:  # noise of the velocity behind its filter
        seen = motion.kinematic_regressors
        spread *= getattr(law, "lambda_", w)
    typical = np.mean(np.einsum("nij,jk,nik->ni", seen, P_0, seen))
    # variance of the measured signal over that of the prior, white over a second
    noise = w * spread**2 / (unit * quality.rate) if spread else 0.0
    return LeastSquares(
        P_0,
        kinematics.size,
        weight=None,
        rate=w if tuning.rates.get("R_k") is None else None,
        floor=max(noise, 1e-6 * typical) or 1.0,
        forgetting=_SLOW * min(w, tuning.settings.smoothing),
        directional=True,
        unit=unit,
    )


def with_prediction_weight(tuning: Tuning, adaptation: Adaptation) -> Law:
    """Return the law with R_k, by which the kinematic prediction error decays at w / 8.

    It decays at most as fast as the camera's noise allows, with the kinematics' ``adaptation``.
    """
    law = tuning.law
    motion = tuning.motion
    seen = motion.position_regressors if law.uses_position_error else motion.kinematic_regressors
    rate = frequency(seen, adaptation.gain(Estimate(motion.kinematics.initial))) ** 2
    wanted = min(_SLOW * tuning.bandwidth, tuning.settings.smoothing)
    return law.adjusted(R_k=wanted / rate if rate > 0.0 else 1.0)
