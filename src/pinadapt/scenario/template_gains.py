"""The gains that a controller was given by default, as a scenario would state them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..adaptation.natural import Natural
from ..controller.controller import Controller


def default_gains(controller: Controller) -> Iterable[tuple[str, str, str]]:
    """Return key, value as written and meaning with unit of each gain that was chosen."""
    law: Any = controller.law
    natural = controller.adaptation_d
    assert isinstance(natural, Natural)  # the default
    velocity, position = law.units
    yield "Kv", _gain(law.K_v), f"velocity gain [{velocity}]"
    yield "Kp", _gain(law.K_P), f"position gain [{position}]"
    yield "alpha", _gain(law.alpha), "e = velocity error + alpha position error [1/s]"
    yield "gamma_d", _gain(natural.gamma), "rate of the inertial parameters"
    rate_k = controller.adaptation_k.gain(controller.kinematics.initial)
    yield "gamma_k", _gain(rate_k), "rate of the tool"
    yield "R_k", _gain(law.R_k), "weight of the tool's prediction error"
    yield "lambda", _gain(law.lambda_), "velocity filter [1/s]"
    if law.needs_acceleration:
        yield "lambda_a", _gain(law.lambda_a), "acceleration filter [s]"


def _gain(gain: float | np.ndarray) -> str:
    """Return a gain as written: a number, or the diagonal of a matrix whose entries differ."""
    values = [
        three_digits(value) for value in (np.diag(gain) if isinstance(gain, np.ndarray) else [gain])
    ]
    return str(values[0]) if len(set(values)) == 1 else str(values)


def three_digits(number: float) -> float:
    """Return a number rounded to three significant digits."""
    return float(f"{number:.3g}")
