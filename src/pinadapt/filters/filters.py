"""The memory of a law besides its estimates: filters that measurements drive."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from ..signals import Signals


class Filters(ABC):
    """Filters of one law. Their state is a named tuple of arrays, explicit like all memory.

    Sampled, ``step`` takes the state from one sample to the next; as part of one differential
    equation, ``rate`` is its derivative.
    """

    @abstractmethod
    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> Any:
        """Return the state at the first sample."""

    @abstractmethod
    def observe(self, state: Any, measurement: Measurement, kinematics: TaskKinematics) -> Any:
        """Return what the law sees of the filters at a sample, ``Signals.filtered``."""

    @abstractmethod
    def step(self, state: Any, s: Signals, dt: float) -> Any:
        """Return the state after dt [s] with the signals held."""

    @abstractmethod
    def rate(self, state: Any, s: Signals) -> Any:
        """Return the time derivative of the state."""

    def acceleration(self, filtered: Any) -> np.ndarray | None:
        """Return the joint acceleration (n) that the filters tell, or None."""
        return None


class NoState(NamedTuple):
    """No memory."""


class NoFilters(Filters):
    """The filters of a law that needs none."""

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> NoState:
        """Return nothing to remember."""
        return NoState()

    def observe(
        self, state: NoState, measurement: Measurement, kinematics: TaskKinematics
    ) -> NoState:
        """Return nothing."""
        return state

    def step(self, state: NoState, s: Signals, dt: float) -> NoState:
        """Return nothing to remember."""
        return state

    def rate(self, state: NoState, s: Signals) -> NoState:
        """Return nothing."""
        return state
