"""From a user's few words to a controller."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from numpy.typing import ArrayLike

from .._checks import positive
from ..adaptation.adaptation import Adaptation
from ..adaptation.matrix_inequality import MatrixInequality
from ..controller.controller import Controller
from ..controller.limits import make_box, make_limits
from ..exceptions import InputError, ParameterError, did_you_mean
from ..filters.low_pass import LowPass
from ..laws import LAWS
from ..laws.gains import Gains
from ..laws.law import Law
from ..laws.posture import Posture
from ..models.basis import BasisDynamics
from ..models.bodies import BodyDynamics
from ..models.dynamics import Dynamics
from ..models.frame_kinematics import FrameKinematics
from ..models.joint_effects import NONE, JointEffects, chosen_kinds, without_joint_effects
from ..models.lumped import LumpedDynamics
from ..models.stacked import StackedDynamics
from ..models.translations import TOOL, Translation
from ..robot.robot import Robot
from .adaptation_rates import dynamic_adaptation, kinematic_adaptation, prediction_weight
from .defaults import Defaults, default_gains
from .light_joint import lightest_joint
from .linearised_loop import LinearisedLoop, typical_motion
from .preflight import stable_share_adaptation, stable_share_feedback

ADAPTATIONS = ("natural", "gradient", "projected", "none")
REGRESSORS = ("exact", "nominal")


def make_controller(
    believed: Robot,
    *,
    law: str = "adaptive-inverse-dynamics",
    kinematic: str | Sequence[str | Translation] = (TOOL,),
    dynamic: str | Sequence[str] = "all",
    joint: str | Sequence[str] = NONE,
    basis: ArrayLike | None = None,
    lmi: ArrayLike | MatrixInequality | None = None,
    adaptation: str = "natural",
    regressor: str = "exact",
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

    Args: believed: what the user believes the robot to be; only read. law: a name of
        ``pinadapt.laws.LAWS``. kinematic: unknown translations: "tool", joint names,
        "joint:length", "lengths". dynamic: unknown bodies: "all", "payload" (the last one), "none",
        or joint names. joint: unknown coefficients of the joints: "all", "none", or some of
        "armature", "viscous", "coulomb". basis: (10 n, p) matrix B of the user's own dynamic
        parameters, pi = B a, instead of bodies. lmi: (p, k, k) coefficient matrices of the
        inequality that natural adaptation keeps, for a basis. adaptation: "natural", "gradient",
        "projected" (gradient that keeps M_hat positive definite) or "none". regressor: with unknown
        lengths, "exact" (lumped parameters) or, for comparison, "nominal" (believed lengths in it).
        dt: controller period [s], for the defaults. Kv: velocity gain, number, list or matrix [1/s;
        N s/m for energy-based laws, N m s/rad on the rotations of a pose]. Kp: position gain
        [1/s^2; N/m for energy-based laws, N m/rad on the rotations of a pose]. alpha: [1/s].
        gamma_d: rate of the inertial adaptation: a number for natural; number, list or matrix for
        gradient. gamma_joint: rate of the joints' coefficients, which always adapt naturally and so
        stay positive. gamma_k: rate of the kinematic adaptation, number, list or matrix. R_k:
        weight of the kinematic prediction error. Q: right-hand side of the Lyapunov equation of the
        law with task velocity. lambda_: velocity filter [1/s]. lambda_a: acceleration filter [s].
        kinematic_box: where the kinematic estimates stay: a margin around the believed values [m],
        or p of them; lower and upper bounds; False for no box. By default a length stays within a
        fifth and five times, other coordinates within half the robot's reach. torque_limits: n
        bounds [N m or N] at which the torque is clipped and the adaptation of the tracking error
        rests; True for the efforts of the robot's description. damping: the right inverse of J_hat
        is damped where its smallest singular value, estimated from below, falls under this fraction
        of home's; zero never damps. watch: end the run with a message when an M_hat to be inverted
        is not positive definite or the estimates run away; False goes on regardless.

    Raises: InputError: an unknown name, a gain that breaks a hypothesis, or parameters that cannot
        be used.
    """
    chosen, kinematics = _law(law), FrameKinematics(believed, kinematic)
    kind = _adaptation(adaptation, chosen)
    dynamics = _dynamics(
        believed, dynamic, basis, lmi, joint, _lumped(kinematics, regressor, kind, chosen, basis)
    )
    default, posture = default_gains(believed, chosen, positive(dt, "dt")), Posture(believed)
    loop = LinearisedLoop(
        chosen, kinematics, dynamics, typical_motion(believed, kinematics, default.bandwidth)
    )
    default, gains = _feedback(
        believed, loop, posture, default, dt, K_v=Kv, K_P=Kp, alpha=alpha, R_k=R_k, Q=Q
    )
    if kind != "none" and (light := lightest_joint(believed, loop, gains)):
        warnings.warn(str(light), stacklevel=2)
    w = default.bandwidth
    adaptation_k = kinematic_adaptation(
        kind, loop, gains, w, gamma_k, make_box(believed, kinematics, kinematic_box)
    )
    gains = (
        gains
        if R_k is not None
        else replace(gains, R_k=prediction_weight(loop, adaptation_k, w) * gains.R_k)
    )
    adaptation_d = partial(dynamic_adaptation, kind, believed, loop, w, gamma_d, gamma_joint, lmi)
    controller = Controller(
        chosen(gains, posture),
        kinematics,
        dynamics,
        adaptation_k=adaptation_k,
        adaptation_d=adaptation_d(),
        velocity_filter=LowPass(default.lambda_ if lambda_ is None else lambda_, "lambda"),
        acceleration_filter=LowPass(
            1.0 / (default.lambda_a if lambda_a is None else positive(lambda_a, "lambda_a"))
        ),
        limits=make_limits(believed, dynamics, torque=torque_limits, damping=damping, watch=watch),
        loop=loop,
    )
    return (
        controller
        if gamma_d is not None or gamma_joint is not None
        else _slowed(controller, adaptation_d, dt)
    )


def _slowed(
    controller: Controller, adaptation_d: Callable[[float], Adaptation], dt: float
) -> Controller:
    """Return the controller with the share of the default rates that the period dt [s] bears, by the check before a run."""
    if (share := stable_share_adaptation(controller, dt)) < 1.0:
        controller.adaptation_d = adaptation_d(share)
    return controller


def _feedback(
    believed: Robot,
    loop: LinearisedLoop,
    posture: Posture,
    default: Defaults,
    dt: float,
    **given: Any,
) -> tuple[Defaults, Gains]:
    """Return defaults and checked gains; where no gain of the feedback is given, slowed to what the period dt [s] bears."""
    gains = _gains(believed, loop.law, default, **given)
    if any(given[name] is not None for name in ("K_v", "K_P", "alpha")):
        return default, gains
    default = default.slowed(stable_share_feedback(loop.law(gains, posture), loop, dt))
    return default, _gains(believed, loop.law, default, **given)


def _gains(believed: Robot, law: type[Law], default: Defaults, **given: Any) -> Gains:
    """Return the checked gains, the given ones and the defaults of the others; R_k, whose default comes later, is one."""
    defaults: dict[str, Any] = {
        "K_v": default.Kv,
        "K_P": default.Kp,
        "alpha": default.alpha,
        "R_k": 1.0,
    }
    taken: dict[str, Any] = {
        name: value if value is not None else defaults.get(name) for name, value in given.items()
    }
    return Gains.checked(
        believed.task.size, **taken, margin=law.needs_margin, positions=believed.task.positions
    )


def _dynamics(
    believed: Robot,
    dynamic: str | Sequence[str],
    basis: ArrayLike | None,
    lmi: ArrayLike | MatrixInequality | None,
    joint: str | Sequence[str],
    lengths: Sequence[Translation],
) -> Dynamics:
    """Return the inertial parameters, stacked with those of the joints where some are unknown or friction is believed."""
    if lmi is not None and basis is None:
        raise ParameterError(
            "an inequality belongs to a basis of your own.",
            where="unknown.lmi",
            hint="Give a basis too.",
        )
    kinds = chosen_kinds(joint)
    stacked = bool(kinds) or believed.friction.present
    carrier = without_joint_effects(believed) if stacked else believed
    inertial: Dynamics = BodyDynamics(
        carrier, dynamic
    )  # checks the words even where others take their place
    if basis is not None:
        inertial = BasisDynamics(carrier, basis)
    elif lengths:
        inertial = LumpedDynamics(carrier, lengths, dynamic)
    return StackedDynamics(inertial, JointEffects(believed, kinds)) if stacked else inertial


def _law(name: str) -> type[Law]:
    if name not in LAWS:
        raise InputError(
            f"no law is called '{name}'; there are {list(LAWS)}.{did_you_mean(name, LAWS)}",
            where="law",
        )
    return LAWS[name]


def _adaptation(name: str, law: type[Law]) -> str:
    """Return the kind of adaptation, "none" for a law that does not adapt."""
    if name not in ADAPTATIONS:
        what = f"no adaptation is called '{name}'; there are {list(ADAPTATIONS)}.{did_you_mean(name, ADAPTATIONS)}"
        raise InputError(what, where="adaptation")
    return name if law.adapts else "none"


def _lumped(
    kinematics: FrameKinematics, regressor: str, kind: str, law: type[Law], basis: ArrayLike | None
) -> list[Translation]:
    """Return the translations that have to be lumped with the inertias because the bodies' regressor contains them."""
    if regressor not in REGRESSORS:
        what = f"must be one of {list(REGRESSORS)}, got '{regressor}'.{did_you_mean(regressor, REGRESSORS)}"
        raise InputError(what, where="unknown.regressor")
    lengths = [part for part in kinematics.translations if part.joint is not None]
    names = [part.name for part in lengths]
    if not lengths or kind == "none" or basis is not None:
        return []
    if regressor == "nominal":
        warnings.warn(
            f"the placements of {names} are unknown, but the nominal regressor contains them at their believed values: "
            'the proof does not cover this closed loop. regressor = "exact" does.',
            stacklevel=3,
        )
        return []
    if kind == "natural":
        raise ParameterError(
            f"natural adaptation does not apply while the placements of {names} are unknown: lengths multiply inertias, and "
            "the lumped parameters that remain are no longer the inertias of bodies, so they have no cone to stay in.",
            where="adaptation",
            hint='Use "gradient" with the law "adaptive-jacobian" or "adaptive-inverse-dynamics-improved", which never invert '
            'M_hat, or "projected", which keeps it positive definite, with any law.',
        )
    if kind == "gradient" and law.inverts_estimate:
        warnings.warn(
            f"the law '{law.name}' inverts M_hat, which plain gradient adaptation does not keep positive definite; "
            'adaptation = "projected" does.',
            stacklevel=3,
        )
    return lengths
