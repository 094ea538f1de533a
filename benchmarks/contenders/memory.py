"""The memory of a contender: integrals, with initial values and rates from its law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pinadapt as pa
from pinadapt.models import SensedState


@dataclass(frozen=True, eq=False)
class Memory(pa.filters.Filters):
    """Named tuples of arrays, integrated by Euler's rule.

    Attributes:
        start: returns the memory at the first sample.
        rates: returns its rates from the signals, of the same type.
    """

    start: Callable[[SensedState], Any]
    rates: Callable[[pa.laws.Signals], Any]

    def init(self, sensed: SensedState, kinematics: pa.models.TaskKinematics) -> Any:
        """Return the memory at the first sample."""
        return self.start(sensed)

    def observe(self, state: Any, sensed: SensedState, kinematics: pa.models.TaskKinematics) -> Any:
        """Return the memory itself."""
        return state

    def step(self, state: Any, s: pa.laws.Signals, dt: float) -> Any:
        """Return the memory after dt [s]."""
        rates = self.rates(s)
        return type(state)(*(part + dt * rate for part, rate in zip(state, rates, strict=True)))

    def rate(self, state: Any, s: pa.laws.Signals) -> Any:
        """Return the rates."""
        return self.rates(s)
