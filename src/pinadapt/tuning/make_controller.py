"""Controllers and estimators with default gains, made from few words or from own objects."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache, partial
from math import isinf
from typing import Any

import numpy as np

from .._checks import arithmetic, instance, positive, word
from ..adaptation.adaptation import Adaptation, Frozen
from ..adaptation.least_squares import LeastSquares
from ..controller.announcement import NominalRobot
from ..controller.controller import Controller
from ..controller.first_samples import FirstSamples
from ..controller.governor import explained_age
from ..controller.limits import Limits, limits_for, make_box
from ..controller.residuals import make_guards
from ..controller.sensing import Senses
from ..controller.slow_start import SlowStart
from ..exceptions import InputError
from ..filters import LowPass
from ..laws import DEFAULT, LAWS
from ..laws.fast_feedback import FastFeedback
from ..laws.law import NAMES, Law
from ..models.delay_compensation import DelayCompensator
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..models.typical_motion import TypicalMotion
from ..records import Sensors
from ..robot.changes import Load
from ..robot.motors import Actuators, Compensation, compensation_of, overloaded
from ..robot.robot import Robot
from ..tasks.task import JointTask
from .defaults import bandwidth, elastic_mode, feedback_lag
from .noise import (
    SIGMA,
    Given,
    Tuning,
    chosen_modifications,
    modified,
    noise_settings,
)
from .preflight import stable_share_of_adaptation, stable_share_of_feedback
from .rates import (
    ADAPTATIONS,
    KINEMATIC_ADAPTATIONS,
    MEMORIES,
    METRICS,
    RATES,
    dynamic_adaptation,
    predicting_kind,
    with_prediction_weight,
)
from .rates import kinematic_adaptation as moved_kinematics
from .unknowns import (
    Unknown,
    UnknownLike,
    lumped_lengths,
    nominal_dynamics,
    nominal_kinematics,
    warn_of_unused_gains,
)


@arithmetic("gains")
def make_controller(
    robot: Robot,
    *,
    law: str | Law | FastFeedback = DEFAULT,
    adaptation: str | Adaptation | None = None,
    kinematic_adaptation: str | Adaptation | None = None,
    modifications: Given = None,
    unknown: UnknownLike = None,
    sensors: Sensors | None = None,
    limits: Limits | None = None,
    payload: Load = None,
    compensated: Compensation | str | None = None,
    dt: float = 1e-3,
    **gains: Any,
) -> Controller:
    """Make an adaptive controller for a robot as far as it is known; everything has a default.

    Args:
        robot: the nominal model; only read. Its task says what is controlled.
        law: a name of ``pinadapt.laws.LAWS``, or a law with its gains; either may be inside of a
            ``FastFeedback``, for elastic joints.
        adaptation: "natural", "gradient", "projected" (gradient that keeps M_hat positive definite)
            or "none"; "natural-composite", "composite" or "least-squares", which also learn from
            the prediction error of the torque; "natural-memory" or "composite-memory", which learn
            from all of its past; or an adaptation of the dynamic estimate with its gains. By
            default "natural-memory" with the law "separation" where the inertial parameters of
            bodies are unknown, else "natural".
        kinematic_adaptation: "gradient", "least-squares" on the prediction error of position or
            velocity, "none", or an adaptation with its gains; by default none where ``adaptation``
            is, else least squares with the law "separation" where no lengths are unknown, else
            gradient.
        modifications: of the dynamic adaptation, around it in this order: "projection", "sigma",
            "e1", "dead-zone", "normalised", or a mapping from these to their gain: the leak [1/s],
            that of e1 at an error of 1 mrad, the zone in rad/s or m/s, and the factor by which a
            typical motion slows the adaptation. True is the default, False none, not even the sigma
            that noisy sensors need.
        unknown: what is adapted, see ``Unknown``, or words for it such as "payload"; by default the
            tool of a task of the frame and all bodies, with the law "separation" the joints'
            friction and rotor inertia too.
        sensors: of the robot, from which filters and rates follow; None: perfect ones.
        limits: of torques, estimates and measurements, see ``Limits``; None: its defaults.
        payload: a guess of the load on the last body, added to the nominal model; an announced one
            takes its place, see ``Controller.announce``; of several task frames by their names.
        compensated: what the arm adds by itself to the torque that it is sent, which the controller
            takes off: "nominal" for the gravity torque of this robot, ``Gravity(described)`` for
            one without the payload, or any callable of q (nq) that returns it (n).
        dt: controller period [s].
        gains: of a law by name, as its class states them: Kv, Kp (units: ``Law.units``), alpha
            [1/s], R_k, Q, lambda_ [1/s], lambda_a [s], and ``posture``, the rest pose (n) or
            its frequency [rad/s] or both by name; and rates of an adaptation by name: gamma_d
            (a number for natural; number, list or matrix for gradient), gamma_joint of the joints'
            coefficients, gamma_k (number, list or matrix); of those that predict the torque,
            prediction_rate [1/s] at which that error decays, prediction_filter [1/s] of the low
            pass on it, and forgetting [1/s] of least squares and memories.

    Raises:
        InputError: an unknown name, a gain that breaks a hypothesis, or parameters that cannot be
            used.
    """
    for name in gains:
        word(name, (*NAMES, *RATES), "controller")
    dt = positive(dt, "dt")
    unknown = Unknown.of(unknown)
    instance(robot, Robot, "robot")
    sensors = Sensors() if sensors is None else instance(sensors, Sensors, "sensors")
    limits = Limits() if limits is None else instance(limits, Limits, "limits")
    nominal = NominalRobot(robot.undrawn(), payload)
    robot = nominal.robot(payload)
    fast, law = (law, law.law) if isinstance(law, FastFeedback) else (None, law)
    chosen = _law_type(law, robot)
    kinematics = nominal_kinematics(robot, unknown, chosen)
    if robot.constraints:
        kinematics.constraints = robot.constrained
    kind, kind_k = _kinds(adaptation, kinematic_adaptation, chosen, kinematics)
    modifying = chosen_modifications(modifications)
    rates = {name: gains.pop(name, None) for name in RATES}
    lengths = lumped_lengths(kinematics, unknown, METRICS.get(kind, kind), chosen)
    dynamics = nominal_dynamics(robot, unknown, chosen.joint_effects, lengths)
    applied = limits_for(robot, kinematics, dynamics, limits, sensors, chosen)
    if adaptation is None and kind == "natural" and chosen.remembers and dynamics.per_body:
        kind = "natural-memory"
    w = bandwidth(robot, dt, chosen.own_bandwidth)
    motion = TypicalMotion(robot, kinematics, dynamics, w, applied.torque)
    K_f = None if fast is None else fast.gain_for(robot, applied.actuators, dt)
    tuned, w = _tuned(law, motion, dt, gains, applied.actuators, K_f)
    quality = sensors.quality(robot.model.nv, dt)
    settings = noise_settings(quality, w, robot.reach)
    # a faster adaptation learns wrong inertias from links that swing on their springs
    elastic = 0.5 * elastic_mode(robot, applied.actuators) / (tuned.adaptation_mode * w)
    settings = settings._replace(mode=min(settings.mode, elastic))
    if isinstance(law, str):
        lambda_s = gains.get("lambda_s") or settings.decorrelation
        tuned = tuned.adjusted(lambda_s=lambda_s, lead=1.0 / settings.velocity)
    if applied.governor is not None and getattr(tuned, "speeds", None) is None:
        tuned = tuned.adjusted(speeds=applied.governor.velocity)
    tuning = Tuning(tuned, motion, w, dt, quality, settings, gains | rates, unknown.lmi)
    warn_of_unused_gains(tuning, kind, kind_k, NAMES if isinstance(law, str) else ())
    box = make_box(kinematics, limits.box)
    adaptation_k = moved_kinematics(kind_k, tuning, box)
    if isinstance(law, str) and gains.get("R_k") is None:
        tuning = tuning._replace(law=with_prediction_weight(tuning, adaptation_k))
    if isinstance(kinematic_adaptation, Adaptation):
        adaptation_k = kinematic_adaptation

    if settings.leak and kind not in MEMORIES and not isinstance(adaptation, Adaptation):
        modifying.setdefault(SIGMA, None)  # noisy sensors ask for a leak

    def adaptation_d(share: float = 1.0) -> Adaptation:
        """Return the adaptation of the dynamics, at a share of its rate, inside modifications."""
        if isinstance(adaptation, Adaptation):
            moved = tuning.law.guarded(adaptation, dynamics)
        elif kind == "none":
            return Frozen()
        else:
            moved = dynamic_adaptation(kind, tuning, share)
        return modified(moved, modifying, tuning)

    compensation = compensation_of(robot, compensated)
    path = applied.governor  # with one the arm may wait for frames
    gap = DelayCompensator.longest_gap if path is None else path.settings.blind
    gap += explained_age(sensors)
    compensator = DelayCompensator(settings.smoothing, sensors.compensate_delay, gap)
    velocity = settings.velocity
    low_pass = None if isinf(velocity) else LowPass(velocity, "velocity filter")
    first = None
    watched = limits.watched
    falls = compensation is None and not robot.constraints and robot.model.gravity.linear.any()
    if watched["gravity"] and falls:
        first = FirstSamples(robot, nominal.unloaded, sensors, dt)
    span = kinematics.bounds if box is None else box
    guards = make_guards(robot, kinematics, watched, quality, box=span, sensors=sensors, dt=dt)
    senses = Senses(guards, compensator, low_pass, quality, sensors, watched["time"], first)
    slowly = not kinematics.calibrated and not isinstance(adaptation_k, Frozen)
    controller = (SlowStart if slowly else Controller)(
        tuning.law if fast is None else replace(fast, law=tuning.law, gain=K_f),
        kinematics,
        dynamics,
        adaptation_k=adaptation_k,
        adaptation_d=adaptation_d(),
        limits=applied,
        senses=senses,
        motion=motion,
        compensation=compensation,
        period=dt,
        nominal=nominal,
    )
    if not isinstance(adaptation, Adaptation) and rates["gamma_d"] is rates["gamma_joint"] is None:
        share = stable_share_of_adaptation(controller, motion, dt)
        if share < 1.0:
            controller.adaptation_d = adaptation_d(share)
    if applied.torque is not None and compensation is None:
        held = overloaded(robot, applied.torque, "the model")
        if held is not None:
            warnings.warn(held, stacklevel=2)
    return controller


def _law_type(law: str | Law, robot: Robot) -> type[Law]:
    """Return the class of a law given by name or as an object.

    Raises:
        InputError: an unknown name, no law, or a law of joint space for a task of the frame.
    """
    chosen = type(law) if isinstance(law, Law) else LAWS[word(law, LAWS, "law")]
    if chosen.joint_space and not isinstance(robot.task, JointTask):
        raise InputError(
            f"the law '{chosen.name}' is for joint tasks; the task is '{robot.task.name}'.",
            where="law",
            hint='Load the robot with task = "joint".',
        )
    if robot.constraints and not chosen.constrained:
        raise InputError(
            f"the law '{chosen.name}' is for robots without constraints.",
            where="law",
            hint=f"Take '{DEFAULT}', or load one chain: name a frame.",
        )
    return chosen


def _kinds(
    adaptation: str | Adaptation | None,
    kinematic: str | Adaptation | None,
    law: type[Law],
    kinematics: TaskKinematics,
) -> tuple[str, str]:
    """Return the kinds of the dynamic and of the kinematic adaptation.

    "none" for laws that do not adapt, "custom" for objects, "natural" for the default, which is in
    its metric.

    The default of the kinematics is "least-squares" with a law that learns from positions where the
    tool, the base or both are unknown, else "gradient". The prediction of a position is exact for
    the true translations, whatever the torque does and however late the frame is, and least squares
    averages the noise of frames. Where lengths of links are unknown too, a motion hardly separates
    them, and a fast change of them disturbs the estimates of the inertias with which they are
    multiplied. Published laws keep what is published.
    """
    kind = "natural" if adaptation is None else _kind(adaptation, "adaptation", ADAPTATIONS)
    if law.learns_from_torque:
        kind = predicting_kind(kind, law.name)
    if not law.adapts:
        return "none", "none"
    if kinematic is not None:
        return kind, _kind(kinematic, "kinematic_adaptation", KINEMATIC_ADAPTATIONS)
    few = all(part.joint in (None, FIRST) for part in kinematics.translations)
    usual = LeastSquares.name if law.uses_position_error and few else "gradient"
    return kind, "none" if kind == "none" else usual


def _kind(adaptation: str | Adaptation, where: str, kinds: tuple[str, ...]) -> str:
    return "custom" if isinstance(adaptation, Adaptation) else word(adaptation, kinds, where)


def _tuned(
    law: str | Law,
    motion: TypicalMotion,
    dt: float,
    gains: dict[str, Any],
    actuators: Actuators,
    K_f: np.ndarray | None,
) -> tuple[Law, float]:
    """Return the law, and the bandwidth [rad/s] that it has at the period dt [s].

    The feedback of a law by name is made as slow as a stable loop at dt needs with the actuators,
    where none of its gains is given.
    """
    if isinstance(law, Law):
        if given := [name for name, gain in gains.items() if gain is not None]:
            raise InputError(f"a law given as an object has its gains; got {given}.", where="gains")
        return law, motion.bandwidth * law.bandwidth_share
    if not actuators.ideal and gains.get("lag") is None and gains.get("Kv") is None:
        gains = gains | {"lag": feedback_lag(motion.robot, dt, actuators)}
    make: Any = LAWS[law].tuned
    made = cache(partial(make, motion, dt, **gains))
    share = 1.0
    if all(gains.get(name) is None for name in ("Kv", "Kp", "alpha")):
        share = stable_share_of_feedback(
            lambda share: made(share).feedback(motion), dt, motion, actuators, K_f
        )
    tuned = made(share)
    return tuned, share * motion.bandwidth * tuned.bandwidth_share
