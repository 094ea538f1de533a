"""Gains that were given and change nothing, which their user should know."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from ..exceptions import UnusedGainWarning
from ..laws.gains import NAMES, SYMBOLS
from ..laws.law import Law
from ..models.dynamics import Dynamics
from ..models.stacked import StackedDynamics
from ..models.task_kinematics import TaskKinematics
from .prediction_rates import FORGETTING, PREDICTING


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
    stacked = isinstance(dynamics, StackedDynamics)
    joint = dynamics.joint.size if isinstance(dynamics, StackedDynamics) else 0
    rates = {
        "gamma_d": kind not in ("none", "custom") and dynamics.size > joint,
        "gamma_joint": kind not in ("none", "custom") and stacked and joint > 0,
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
