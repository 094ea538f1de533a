"""The gains that a controller was given by default, as a scenario would state them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..adaptation.natural import Natural
from ..controller.controller import Controller
from ..tuning.linearised_loop import gain_matrix


def default_gains(controller: Controller) -> Iterable[tuple[str, str, str]]:
    """Return key, value as written and meaning with unit of each gain that was chosen."""
    law, natural = controller.law, controller.adaptation_d
    assert isinstance(natural, Natural)  # the default
    rate_k = gain_matrix(controller.adaptation_k, controller.kinematics.initial)
    kinds = (
        ("N s/m, for rotations N m s/rad", "N/m, for rotations N m/rad")
        if law.energy_based
        else ("1/s", "1/s^2")
    )
    yield "Kv", _gain(law.gains.K_v), f"velocity gain [{kinds[0]}]"
    yield "Kp", _gain(law.gains.K_P), f"position gain [{kinds[1]}]"
    yield "alpha", _gain(law.gains.alpha), "e = velocity error + alpha position error [1/s]"
    yield "gamma_d", _gain(natural.gamma), "rate of the inertial parameters"
    yield "gamma_k", _gain(rate_k), "rate of the tool"
    yield "R_k", _gain(law.gains.R_k), "weight of the tool's prediction error"
    yield "lambda", _gain(controller.velocity_filter.bandwidth), "velocity filter [1/s]"
    if not law.energy_based:
        yield (
            "lambda_a",
            _gain(1.0 / controller.acceleration_filter.bandwidth),
            "acceleration filter [s]",
        )


def _gain(gain: float | np.ndarray) -> str:
    """Return a gain as written: a number, or the diagonal of a matrix whose entries differ."""
    values = [
        three_digits(value) for value in (np.diag(gain) if isinstance(gain, np.ndarray) else [gain])
    ]
    return str(values[0]) if len(set(values)) == 1 else str(values)


def three_digits(number: float) -> float:
    """Return a number rounded to three significant digits."""
    return float(f"{number:.3g}")
