"""The gains that a controller was given by default, as a scenario would state them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..adaptation.adaptation import Adaptation, Wrapper
from ..adaptation.exponentiated_gradient import ExponentiatedGradient
from ..adaptation.natural import Natural
from ..adaptation.stacked import Stacked
from ..controller.controller import Controller

_MEANINGS = {
    "alpha": "of the position error in the velocity to follow [1/s]",
    "beta": "observer of the position [1/s]",
    "lag": "by which Kv gives way to the inertia of what moves together [s]",
    "R_k": "weight of the tool's prediction error",
    "lambda_": "velocity filter [1/s]",
    "lambda_a": "acceleration filter [s]",
    "width": "beyond which the position feedback saturates [m, for rotations rad]",
    "bound": "no torque beyond it [N m or N]",
    "gravity": "what of it gravity may ask for [N m or N]",
}


def default_gains(controller: Controller) -> Iterable[tuple[str, str, str]]:
    """Return key, value as written and meaning with unit of each gain that was chosen."""
    law: Any = controller.law
    velocity, position = law.units
    if _diagonal(law.K_v):  # a whole matrix is not for a comment
        yield "Kv", _gain(law.K_v), f"velocity gain [{velocity}]"
    if hasattr(law, "K_P"):
        yield "Kp", _gain(law.K_P), f"position gain [{position}]"
    for name, meaning in _MEANINGS.items():
        if hasattr(law, name):
            yield name.rstrip("_"), _gain(getattr(law, name)), meaning
    bodies, joints = _parts(controller.adaptation_d)
    yield "gamma_d", _gain(bodies.gamma), "rate of the inertial parameters"
    if joints is not None:
        yield "gamma_joint", _gain(joints.gamma), "rate of armature and friction"
    if law.learns_kinematics:
        rate_k = controller.adaptation_k.gain(controller.kinematics.initial)
        yield "gamma_k", _gain(rate_k), "rate of the tool"


def _diagonal(gain: np.ndarray) -> bool:
    """Tell whether a gain (n, n) has no entries beside its diagonal."""
    return bool((np.diag(np.diag(gain)) == gain).all())


def _parts(adaptation: Adaptation) -> tuple[Natural, ExponentiatedGradient | None]:
    """Return what moves bodies and joints in the default adaptation of a law."""
    while isinstance(adaptation, Wrapper):
        adaptation = adaptation.inner
    parts = (
        [part for part, _ in adaptation.parts] if isinstance(adaptation, Stacked) else [adaptation]
    )
    bodies, *joints = parts
    assert isinstance(bodies, Natural)  # the default
    joint = joints[0] if joints else None
    assert joint is None or isinstance(joint, ExponentiatedGradient)
    return bodies, joint


def _gain(gain: float | np.ndarray) -> str:
    """Return a gain as written: a number, or a list or a diagonal whose entries differ."""
    numbers = np.asarray(gain)
    values = [three_digits(x) for x in (np.diag(numbers) if numbers.ndim == 2 else numbers.flat)]
    return str(values[0]) if len(set(values)) == 1 else str(values)


def three_digits(number: float) -> float:
    """Return a number rounded to three significant digits."""
    return float(f"{number:.3g}")
