"""From a user's few words to an estimator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..adaptation.adaptation import Adaptation
from ..controller.estimator import Estimator
from ..robot.robot import Robot
from .make_controller import make_controller
from .unknowns import Words


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
