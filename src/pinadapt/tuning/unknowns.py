"""From the words that say what is unknown to the models of the believed robot."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from .._checks import word
from ..adaptation.natural import MatrixInequality
from ..exceptions import ParameterError, UnusedGainWarning
from ..laws.gains import NAMES, SYMBOLS
from ..laws.law import Law
from ..models.basis import BasisDynamics
from ..models.bodies import BodyDynamics
from ..models.dynamics import Dynamics, StackedDynamics
from ..models.frame_kinematics import FrameKinematics
from ..models.joint_effects import JointEffects, chosen_kinds, without_joint_effects
from ..models.joint_kinematics import JointKinematics
from ..models.lumped import LumpedDynamics
from ..models.task_kinematics import TaskKinematics
from ..models.translations import BASE, FIRST, TOOL, Translation
from ..robot.robot import Robot
from ..tasks.joint import JointTask
from .prediction_rates import FORGETTING, PREDICTING

REGRESSORS = ("exact", "nominal")

Words = str | Sequence[str | Translation]


def believed_kinematics(believed: Robot, unknown: Words | None, law: type[Law]) -> TaskKinematics:
    """Return the believed kinematics; by default the tool is unknown, of a joint task nothing.

    Raises:
        InputError: unknown translations that cannot be used, or not by this law.
    """
    if isinstance(believed.task, JointTask):
        return JointKinematics(believed, () if unknown is None else unknown)
    kinematics = FrameKinematics(believed, (TOOL,) if unknown is None else unknown)
    if not law.uses_position_error and any(p.joint == FIRST for p in kinematics.translations):
        raise ParameterError(
            f"the law '{law.name}' learns from velocities, in which '{BASE}' does not show.",
            where="unknown.kinematic",
            hint='Take the law "separation", which learns from positions too.',
        )
    return kinematics


def believed_dynamics(
    believed: Robot,
    dynamic: str | Sequence[str],
    joint: str | Sequence[str],
    basis: ArrayLike | None,
    lmi: ArrayLike | MatrixInequality | None,
    lengths: Sequence[Translation],
) -> Dynamics:
    """Return the inertial parameters, stacked with those of the joints where there are some.

    Args:
        believed: the believed robot.
        dynamic: unknown bodies.
        joint: unknown coefficients of the joints.
        basis: (10 n, p) matrix of the user's own parameters, or None.
        lmi: inequality of these parameters, or None.
        lengths: unknown translations to be lumped with the inertias, see ``lumped_lengths``.

    Raises:
        InputError: words or a basis that cannot be used, or an inequality without a basis.
    """
    if lmi is not None and basis is None:
        raise ParameterError(
            "an inequality belongs to a basis of your own.",
            where="unknown.lmi",
            hint="Give a basis too.",
        )
    kinds = chosen_kinds(joint)
    stacked = bool(kinds) or believed.friction.present
    carrier = without_joint_effects(believed) if stacked else believed
    inertial: Dynamics = BodyDynamics(carrier, dynamic)  # checks the words in any case
    if basis is not None:
        inertial = BasisDynamics(carrier, basis)
    elif lengths:
        inertial = LumpedDynamics(carrier, lengths, dynamic)
    return StackedDynamics(inertial, JointEffects(believed, kinds)) if stacked else inertial


def lumped_lengths(
    kinematics: TaskKinematics, regressor: str, kind: str, law: type[Law], basis: ArrayLike | None
) -> list[Translation]:
    """Return the translations to be lumped with the inertias, whose regressor contains them.

    Args:
        kinematics: the believed kinematics.
        regressor: "exact", or "nominal" for none.
        kind: of adaptation, "custom" for an object.
        law: of the controller.
        basis: of the user's own, which takes care of lengths itself, or None.

    Raises:
        InputError: an unknown regressor, or an adaptation that does not apply to lumped parameters.
    """
    word(regressor, REGRESSORS, "unknown.regressor")
    lengths = [part for part in kinematics.translations if part.joint not in (None, FIRST)]
    names = [part.name for part in lengths]
    if not lengths or kind == "none" or basis is not None or law.approximate_regressor:
        return []
    if regressor == "nominal":
        warnings.warn(
            f"the placements of {names} are unknown, but the nominal regressor contains them at "
            "their believed values: the proof does not cover this closed loop. "
            'regressor = "exact" does.',
            stacklevel=4,
        )
        return []
    if kind == "natural":
        raise ParameterError(
            f"natural adaptation does not apply while the placements of {names} are unknown: "
            "lengths multiply inertias, and the lumped parameters that remain are no longer the "
            "inertias of bodies, so they have no cone to stay in.",
            where="adaptation",
            hint='Use "gradient", "composite" or "least-squares" with the law "separation", '
            '"adaptive-jacobian" or "adaptive-inverse-dynamics-improved", which never invert '
            'M_hat, or "projected", which keeps it positive definite, with any law.',
        )
    if kind == "gradient" and law.inverts_estimate:
        warnings.warn(
            f"the law '{law.name}' inverts M_hat, which plain gradient adaptation does not keep "
            'positive definite; adaptation = "projected" does.',
            stacklevel=4,
        )
    return lengths


def warn_of_unused_gains(
    law: Law,
    kinds: tuple[str, str],
    kinematics: TaskKinematics,
    dynamics: Dynamics,
    given: Mapping[str, Any],
) -> None:
    """Name the given gains that neither the law nor the adaptation uses, and those that they do.

    Args:
        law: of the controller.
        kinds: of adaptation, of the dynamic and the kinematic estimate; "custom" for an object.
        kinematics: with the unknown translations.
        dynamics: with the unknown inertias and coefficients of the joints.
        given: gains as users write them; None is not given.
    """
    kind, kind_k = kinds
    inertial = dynamics.inertial.size
    rates = {
        "gamma_d": kind not in ("none", "custom") and inertial > 0,
        "gamma_joint": kind not in ("none", "custom") and dynamics.size > inertial,
        "gamma_k": kind_k not in ("none", "custom")
        and law.learns_kinematics
        and kinematics.size > 0,
    }
    predicts = kind in PREDICTING and dynamics.size > 0
    rates |= dict.fromkeys(("prediction_rate", "prediction_filter"), predicts)
    rates["forgetting"] = predicts and kind in FORGETTING
    fitted = kind_k == "least-squares" and kinematics.size > 0
    rates |= dict.fromkeys(("kinematic_rate", "kinematic_forgetting"), fitted)
    used = [name for name in NAMES if hasattr(law, SYMBOLS.get(name, name))]
    used += [name for name, moves in rates.items() if moves]
    idle = [name for name, gain in given.items() if gain is not None and name not in used]
    if idle:
        warnings.warn(
            f"nothing uses {_written(idle)}: the law '{law.name}', its adaptation ('{kind}') and "
            f"what is unknown here use {_written(used)}.",
            UnusedGainWarning,
            stacklevel=5,
        )


def _written(names: list[str]) -> str:
    return ", ".join(name.rstrip("_") for name in names)
