"""From a user's few words, or own objects, to a controller."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from math import isinf
from typing import Any

from numpy.typing import ArrayLike

from .._checks import arithmetic, flag, instance, positive
from ..adaptation.adaptation import Adaptation
from ..adaptation.modifications import Leak
from ..adaptation.natural import MatrixInequality
from ..controller.belief import Belief
from ..controller.controller import Controller
from ..controller.estimator import Estimator
from ..controller.limits import make_box, make_limits
from ..controller.sensing import Guards, Senses, make_guards
from ..exceptions import InputError, did_you_mean
from ..filters.filters import LowPass
from ..laws import DEFAULT, LAWS
from ..laws.law import Law
from ..models.delay_compensation import DelayCompensator
from ..models.typical_motion import TypicalMotion
from ..records import Measurement
from ..robot.changes import Payload
from ..robot.motors import Compensation, compensation_of
from ..robot.robot import Robot
from ..sensing import Camera, SensorQuality
from ..tasks.joint import JointTask
from .defaults import bandwidth
from .noise import (
    SIGMA,
    Given,
    Remedies,
    Setting,
    chosen_modifications,
    modified,
    remedies,
    sensor_quality,
)
from .preflight import lightest_joint, stable_share_of_adaptation, stable_share_of_feedback
from .rates import (
    ADAPTATIONS,
    KINEMATIC_ADAPTATIONS,
    RATES,
    check_adaptation,
    dynamic_adaptation,
    metric_of,
    predicting_kind,
    prediction_weight,
)
from .rates import kinematic_adaptation as moved_kinematics
from .unknowns import (
    Words,
    believed_dynamics,
    believed_kinematics,
    lumped_lengths,
    warn_of_unused_gains,
)


@arithmetic("gains")
def make_controller(
    believed: Robot,
    *,
    law: str | Law = DEFAULT,
    adaptation: str | Adaptation = "natural",
    kinematic_adaptation: str | Adaptation | None = None,
    modifications: Given = None,
    kinematic: Words | None = None,
    dynamic: str | Sequence[str] = "all",
    joint: str | Sequence[str] | None = None,
    basis: ArrayLike | None = None,
    lmi: ArrayLike | MatrixInequality | None = None,
    regressor: str = "exact",
    dt: float = 1e-3,
    kinematic_box: ArrayLike | bool | None = None,
    torque_limits: ArrayLike | bool | None = True,
    compensated: Compensation | str | None = None,
    damping: float = 0.2,
    watch: bool = True,
    payload: Payload | None = None,
    guards: Mapping[str, bool] | bool = True,
    noise: Mapping[str, ArrayLike] | Sequence[Measurement] | None = None,
    encoder: ArrayLike = 0.0,
    camera: Camera | Mapping[str, float | None] | None = None,
    carry: bool = True,
    **gains: Any,
) -> Controller:
    """Make an adaptive controller for a believed robot; everything has a default.

    Args:
        believed: what the user believes the robot to be; only read. Its task says what is
            controlled.
        law: a name of ``pinadapt.LAWS``, or a law with its gains.
        adaptation: "natural", "gradient", "projected" (gradient that keeps M_hat positive definite)
            or "none"; "natural-composite", "composite" or "least-squares", which also learn from
            the prediction error of the torque; "natural-memory" or "composite-memory", which learn
            from all of its past; or an adaptation of the dynamic estimate with its gains.
        kinematic_adaptation: "gradient", "least-squares" on the prediction error of position or
            velocity, "none", or an adaptation with its gains; by default none where ``adaptation``
            is, else gradient.
        modifications: of the dynamic adaptation, around it in this order: "projection", "sigma",
            "e1", "dead-zone", "normalised", or a mapping from these to their gain: the leak [1/s],
            that of e1 at 1 mrad off, the zone in rad/s or m/s, and how much slower a typical motion
            makes the adaptation. True is the default, False none, not even the sigma that noise
            asks for.
        kinematic: unknown translations: "tool" (the default), joint names, "joint:length",
            "lengths", "base" (in the frame in which x is measured); a joint task has none.
        dynamic: unknown bodies: "all", "payload" (the last one), "none", or joint names.
        joint: unknown coefficients of the joints: "all", "none", or some of "armature", "viscous",
            "coulomb"; by default all for the law "separation", none for the published ones.
        basis: (10 n, p) matrix B of the user's own dynamic parameters, pi = B a, instead of bodies.
        lmi: (p, k, k) coefficient matrices of the inequality that natural adaptation keeps, for a
            basis.
        regressor: with unknown lengths, "exact" (lumped parameters) or, for comparison, "nominal"
            (believed lengths in it).
        dt: controller period [s].
        kinematic_box: where the kinematic estimates stay: a margin around the believed values [m],
            or p of them; lower and upper bounds; False for no box. By default a length stays within
            a fifth and five times, other coordinates within half the robot's reach.
        torque_limits: n bounds [N m or N] at which the torque is clipped and the adaptation of the
            tracking error rests; by default the efforts of the description, False for none.
        compensated: what the arm adds by itself to the torque that it is sent, which the controller
            takes off: "nominal" for the gravity torque of this robot, ``Gravity(described)`` for
            one without the believed load, or any callable of q (nq) that returns it (n).
        damping: the right inverse of J_hat is damped where its smallest singular value, estimated
            from below, falls under this fraction of home's; zero never damps.
        watch: end the run with a message when an M_hat to be inverted is not positive definite or
            the estimates run away.
        payload: a guess of the load on the last body, added to the believed robot; an announced one
            takes its place, see ``Controller.believe``.
        guards: what is not believed of the sensors, and when estimates rest; False for no guard, or
            some of "position", "velocity", "time" and "rest" with False. See ``Guards``.
        noise: standard deviations of the sensors, q and v [rad, rad/s, m, m/s] and x [m], or the
            first samples of an arm at rest, which show them; filters and rates follow.
        encoder: rad or m a count, one or one a joint, with v differenced from it over a period.
        camera: rate, delay and dropout of the camera that gives x, where it is not of every sample.
        carry: whether late frames are carried on to now by the believed kinematics; else they are
            taken for now.
        gains: of a law by name, as its class states them: Kv, Kp (units: ``Law.units``), alpha
            [1/s], R_k, Q, lambda_ [1/s], lambda_a [s], and ``posture``, the rest pose (n) or
            its frequency [rad/s] or both by name; and rates of an adaptation by name: gamma_d
            (a number for natural; number, list or matrix for gradient), gamma_joint of the joints'
            coefficients, gamma_k (number, list or matrix); of those that predict the torque,
            prediction_rate [1/s] at which that error decays, prediction_filter [1/s] through which
            it is seen, and forgetting [1/s] of least squares and memories; of least squares on the
            kinematics kinematic_rate and kinematic_forgetting [1/s].

    Raises:
        InputError: an unknown name, a gain that breaks a hypothesis, or parameters that cannot be
            used.
    """
    dt, belief = positive(dt, "dt"), _belief(believed, payload, carry=carry, watch=watch)
    believed = belief.robot(payload)
    chosen = _law_type(law, believed)
    kinematics = believed_kinematics(believed, kinematic, chosen)
    kind, kind_k = _kinds(adaptation, kinematic_adaptation, chosen)
    modifying = chosen_modifications(modifications)
    rates = {name: gains.pop(name, None) for name in RATES}
    lengths = lumped_lengths(kinematics, regressor, metric_of(kind), chosen, basis)
    joint = chosen.joint_effects if joint is None else joint
    dynamics = believed_dynamics(believed, dynamic, joint, basis, lmi, lengths)
    limits = make_limits(
        believed, kinematics, dynamics, torque=torque_limits, damping=damping, watch=watch
    )
    motion = TypicalMotion(believed, kinematics, dynamics, bandwidth(believed, dt), limits.torque)
    tuned, w = _tuned(law, motion, dt, gains)
    quality = sensor_quality(believed, dt, camera, noise, encoder)
    needed = remedies(quality, w, believed.reach)
    if isinstance(law, str):
        tuned = tuned.decorrelated(needed.decorrelation)
    _warn(tuned, (kind, kind_k), motion, gains | rates)
    box, given = make_box(believed, kinematics, kinematic_box), rates | gains
    adaptation_k = moved_kinematics(kind_k, tuned, motion, w, given, box, needed, quality)
    if isinstance(law, str) and gains.get("R_k") is None:
        tuned = _weighed(tuned, motion, adaptation_k, w, needed)
    if isinstance(kinematic_adaptation, Adaptation):
        adaptation_k = kinematic_adaptation
    setting = Setting(tuned, motion, w, dt, quality, needed)

    def adaptation_d(share: float = 1.0) -> Adaptation:
        if isinstance(adaptation, Adaptation):
            return modified(tuned.guarded(adaptation, dynamics), modifying, setting)
        return _adaptation(kind, modifying, setting, rates, lmi, share)

    controller = Controller(
        tuned,
        kinematics,
        dynamics,
        adaptation_k=adaptation_k,
        adaptation_d=adaptation_d(),
        limits=limits,
        senses=_senses(make_guards(believed, kinematics, guards, quality), needed, carry, quality),
        motion=motion,
        compensation=compensation_of(believed, compensated),
        period=dt,
        belief=belief,
    )
    if isinstance(adaptation, str) and rates["gamma_d"] is None and rates["gamma_joint"] is None:
        share = stable_share_of_adaptation(controller, dt)
        controller.adaptation_d = adaptation_d(share) if share < 1.0 else controller.adaptation_d
    return controller


def _belief(believed: Any, payload: Any, **flags: Any) -> Belief:
    """Return the belief in a robot and its load, once it is clear that they and flags are such.

    Raises:
        InputError: one of them is not.
    """
    instance(believed, Robot, "believed")
    instance(payload, Payload | None, "payload")
    for name, value in flags.items():
        flag(value, name)
    return Belief(believed.undrawn(), payload)


def _weighed(
    law: Law, motion: TypicalMotion, adaptation_k: Adaptation, w: float, needed: Remedies
) -> Law:
    """Return the law with the default weight of its kinematic prediction error."""
    weight = prediction_weight(law, motion, adaptation_k, w, needed.smoothing)
    return law.with_prediction_weight(weight)


def _adaptation(
    kind: str,
    modifying: Mapping[str, Any],
    setting: Setting,
    rates: Mapping[str, Any],
    lmi: ArrayLike | MatrixInequality | None,
    share: float,
) -> Adaptation:
    """Return how the dynamic estimate moves: what noise asks for is a leak, if none is chosen."""
    law, motion, w, needed = setting.law, setting.motion, setting.bandwidth, setting.needed
    moved = dynamic_adaptation(kind, law, motion, w, rates, lmi, share * needed.mode**2)
    if kind == "none":
        return moved
    moved = modified(moved, modifying, setting)
    return Leak(moved, needed.leak) if needed.leak and SIGMA not in modifying else moved


def _warn(
    law: Law, kinds: tuple[str, str], motion: TypicalMotion, gains: Mapping[str, Any]
) -> None:
    """Tell of gains that nothing uses, and of a joint too light for the law."""
    warn_of_unused_gains(law, kinds, motion.kinematics, motion.dynamics, gains)
    if kinds[0] != "none" and (light := lightest_joint(motion, law)):
        warnings.warn(str(light), stacklevel=4)


def _senses(guards: Guards, needed: Remedies, carry: bool, quality: SensorQuality) -> Senses:
    """Return how sensors of a quality are taken."""
    low_pass = None if isinf(needed.velocity) else LowPass(needed.velocity, "velocity filter")
    return Senses(guards, DelayCompensator(needed.smoothing, carry), low_pass, quality)


def _law_type(law: str | Law, believed: Robot) -> type[Law]:
    """Return the class of a law given by name or as an object.

    Raises:
        InputError: an unknown name, no law, or a law of joint space for a task of the frame.
    """
    if isinstance(law, str):
        if law not in LAWS:
            raise InputError(
                f"no law is called '{law}'; there are {list(LAWS)}.{did_you_mean(law, LAWS)}",
                where="law",
            )
        chosen = LAWS[law]
    elif isinstance(law, Law):
        chosen = type(law)
    else:
        raise InputError(f"expected a name or a Law, got {law!r}.", where="law")
    if chosen.joint_space and not isinstance(believed.task, JointTask):
        raise InputError(
            f"the law '{chosen.name}' is one of joint space; the task is '{believed.task.name}'.",
            where="law",
            hint='Load the robot with task = "joint".',
        )
    return chosen


def _kinds(
    adaptation: str | Adaptation, kinematic: str | Adaptation | None, law: type[Law]
) -> tuple[str, str]:
    """Return the kinds of the dynamic and of the kinematic adaptation.

    "none" for laws that do not adapt, "custom" for objects.
    """
    kind = _kind(adaptation, law, "adaptation", ADAPTATIONS)
    if kinematic is None:
        return kind, "none" if kind == "none" else "gradient"
    return kind, _kind(kinematic, law, "kinematic_adaptation", KINEMATIC_ADAPTATIONS)


def _kind(adaptation: str | Adaptation, law: type[Law], where: str, kinds: tuple[str, ...]) -> str:
    if isinstance(adaptation, str):
        check_adaptation(adaptation, where, kinds)
    elif not isinstance(adaptation, Adaptation):
        raise InputError(f"expected a name or an Adaptation, got {adaptation!r}.", where=where)
    kind = adaptation if isinstance(adaptation, str) else "custom"
    if not law.adapts:
        return "none"
    return predicting_kind(kind, law.name) if law.learns_from_torque else kind


def _tuned(
    law: str | Law, motion: TypicalMotion, dt: float, gains: dict[str, Any]
) -> tuple[Law, float]:
    """Return the law, and the bandwidth [rad/s] that it has at the period dt [s].

    The feedback of a law by name is slowed to what dt bears where none of its gains is given.
    """
    if isinstance(law, Law):
        if given := [name for name, gain in gains.items() if gain is not None]:
            raise InputError(f"a law given as an object has its gains; got {given}.", where="gains")
        return law, motion.bandwidth * law.bandwidth_share
    chosen = LAWS[law]
    tuned = chosen.tuned(motion, dt, **gains)
    if any(gains.get(name) is not None for name in ("Kv", "Kp", "alpha")):
        return tuned, motion.bandwidth * tuned.bandwidth_share
    share = stable_share_of_feedback(
        lambda share: chosen.tuned(motion, dt, share, **gains).feedback(motion), dt
    )
    if share != 1.0:
        tuned = chosen.tuned(motion, dt, share, **gains)
    return tuned, share * motion.bandwidth * tuned.bandwidth_share


def make_estimator(
    believed: Robot,
    *,
    adaptation: str | Adaptation = "natural-memory",
    kinematic: Words | None = None,
    dynamic: str | Sequence[str] = "all",
    joint: str | Sequence[str] = "all",
    dt: float = 1e-3,
    **options: Any,
) -> Estimator:
    """Make an estimator of a believed robot, with the default rates of a controller.

    Args:
        believed: what the user believes the robot to be; only read. With a task of the frame its
            position teaches translations; with a joint task none is needed.
        adaptation: one that predicts the torque, such as "natural-memory", "natural-composite" or
            "least-squares", or an object.
        kinematic: unknown translations, as ``make_controller`` has them.
        dynamic: unknown bodies, likewise.
        joint: unknown coefficients of the joints, likewise; all by default.
        dt: typical time between samples [s].
        options: others of ``make_controller`` that concern estimates: ``basis``, ``payload``,
            ``kinematic_box``, ``guards``, ``noise``, ``camera`` and the rates.

    Raises:
        InputError: as ``make_controller``.
        GainError: an adaptation that learns from tracking errors alone.
    """
    controller = make_controller(
        believed,
        adaptation=adaptation,
        kinematic=kinematic,
        dynamic=dynamic,
        joint=joint,
        dt=dt,
        torque_limits=False,
        **options,
    )
    return Estimator(controller)
