"""From a user's few words to a controller."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive
from ..adaptation import Adaptation, BodyCone, Cone, Frozen, Gradient, Natural
from ..exceptions import InputError, ParameterError, did_you_mean
from ..laws import LAWS, Gains, Law, Posture
from ..parameters import BasisParameters, BodyParameters, DynamicParameters, KinematicParameters
from ..parameters.kinematic import TOOL, Translation
from ..robot import Robot
from ..signals import LowPass
from .controller import Controller
from .defaults import Defaults, default_gains, default_gradient_gain, reach

ADAPTATIONS = ("natural", "gradient", "none")


def make_controller(
    believed: Robot,
    *,
    law: str = "adaptive-inverse-dynamics",
    kinematic: str | Sequence[str | Translation] = (TOOL,),
    dynamic: str | Sequence[str] = "all",
    basis: ArrayLike | None = None,
    lmi: ArrayLike | Cone | None = None,
    adaptation: str = "natural",
    dt: float = 1e-3,
    Kv: ArrayLike | None = None,
    Kp: ArrayLike | None = None,
    alpha: float | None = None,
    gamma_d: ArrayLike | None = None,
    gamma_k: ArrayLike | None = None,
    R_k: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    lambda_: float | None = None,
    lambda_a: float | None = None,
) -> Controller:
    """Make an adaptive controller for a believed robot; every gain has a default derived from the robot and dt.

    Args:
        believed: what the user believes the robot to be; only read.
        law: a name of ``pinadapt.laws.LAWS``.
        kinematic: unknown translations: "tool", joint names, "joint:length", "lengths".
        dynamic: unknown bodies: "all", "payload" (the last one), "none", or joint names.
        basis: (10 n, p) matrix B of the user's own dynamic parameters, pi = B a, instead of bodies.
        lmi: (p, k, k) coefficient matrices of the inequality that natural adaptation keeps, for a basis.
        adaptation: "natural", "gradient" or "none".
        dt: controller period [s], for the defaults.
        Kv: velocity gain, number, list or matrix [1/s; N s/m for energy-based laws, N m s/rad on the rotations of a pose].
        Kp: position gain [1/s^2; N/m for energy-based laws, N m/rad on the rotations of a pose].
        alpha: [1/s].
        gamma_d: rate of the dynamic adaptation: a number for natural; number, list or matrix for gradient.
        gamma_k: rate of the kinematic adaptation, number, list or matrix.
        R_k: weight of the kinematic prediction error.
        Q: right-hand side of the Lyapunov equation of the law with task velocity.
        lambda_: velocity filter [1/s].
        lambda_a: acceleration filter [s].

    Raises:
        InputError: an unknown name, a gain that breaks a hypothesis, or parameters that cannot be used.
    """
    chosen = _law(law)
    kinematics = KinematicParameters(believed, kinematic)
    if lmi is not None and basis is None:
        raise ParameterError("an inequality belongs to a basis of your own.", where="unknown.lmi", hint="Give a basis too.")
    bodies = BodyParameters(believed, dynamic)  # checks the words even where a basis takes their place
    dynamics: DynamicParameters = bodies if basis is None else BasisParameters(believed, basis)
    default = default_gains(believed, chosen, positive(dt, "dt"))
    gains = Gains.checked(
        believed.task.size,
        K_v=default.Kv if Kv is None else Kv,
        K_P=default.Kp if Kp is None else Kp,
        alpha=default.alpha if alpha is None else alpha,
        R_k=default.R_k if R_k is None else R_k,
        Q=Q,
        margin=chosen.needs_margin,
        positions=believed.task.positions,
    )
    kind = _adaptation(adaptation)
    kind = kind if chosen.adapts else "none"
    _warn_of_lengths(kinematics, dynamics, kind)
    rates_k = default.gamma_k if gamma_k is None else gamma_k
    return Controller(
        chosen(gains, Posture(believed)),
        kinematics,
        dynamics,
        adaptation_k=Frozen() if kind == "none" else Gradient(rates_k, kinematics.size, "gamma_k"),
        adaptation_d=_dynamic_adaptation(kind, believed, dynamics, chosen, default, gamma_d, lmi),
        velocity_filter=LowPass(default.lambda_ if lambda_ is None else lambda_, "lambda"),
        acceleration_filter=LowPass(1.0 / (default.lambda_a if lambda_a is None else positive(lambda_a, "lambda_a"))),
    )


def _dynamic_adaptation(
    kind: str,
    believed: Robot,
    dynamics: DynamicParameters,
    law: type[Law],
    default: Defaults,
    gamma_d: ArrayLike | None,
    lmi: ArrayLike | Cone | None,
) -> Adaptation:
    if kind == "none" or not dynamics.size:
        return Frozen()
    if kind == "natural":
        return _natural(believed, dynamics, default.gamma_natural if gamma_d is None else gamma_d, lmi)
    rates = default_gradient_gain(believed, dynamics, law) if gamma_d is None else gamma_d
    return Gradient(rates, dynamics.size, "gamma_d")


def _law(name: str) -> type[Law]:
    if name not in LAWS:
        raise InputError(f"no law is called '{name}'; there are {list(LAWS)}.{did_you_mean(name, LAWS)}", where="law")
    return LAWS[name]


def _adaptation(name: str) -> str:
    if name not in ADAPTATIONS:
        what = f"no adaptation is called '{name}'; there are {list(ADAPTATIONS)}.{did_you_mean(name, ADAPTATIONS)}"
        raise InputError(what, where="adaptation")
    return name


def _natural(believed: Robot, dynamics: DynamicParameters, rate: ArrayLike, lmi: ArrayLike | Cone | None) -> Natural:
    """Return natural adaptation on the bodies' cone, or on the user's inequality for a basis."""
    if np.ndim(rate) != 0:
        raise InputError("natural adaptation has one scalar gain.", where="gamma_d")
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
    return Natural(positive(rate, "gamma_d"), cone)


def _warn_of_lengths(kinematics: KinematicParameters, dynamics: DynamicParameters, adaptation: str) -> None:
    """Say so when the regressor contains placements that are among the unknowns."""
    joints = [part.name for part in kinematics.translations if part.joint is not None]
    if joints and adaptation != "none" and isinstance(dynamics, BodyParameters) and dynamics.size:
        warnings.warn(
            f"the placements of {joints} are unknown, but the regressor of the bodies' parameters contains them at their "
            "believed values: the proof does not cover this closed loop. A basis of lumped parameters avoids it.",
            stacklevel=3,
        )
