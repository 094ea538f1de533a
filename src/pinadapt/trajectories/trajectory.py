"""Desired task trajectories: position with its first two derivatives at any time."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from .._checks import vector
from ..records import Desired


class Trajectory(ABC):
    """A twice differentiable path of m task coordinates in time."""

    @abstractmethod
    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""

    @abstractmethod
    def shifted(self, by: np.ndarray) -> Trajectory:
        """Return the same motion moved by (m) [m]."""

    @property
    def extent(self) -> float | None:
        """Radius of a circle, half the diagonal of another path [m or rad], zero for a point.

        None where a motion does not say.
        """
        return None

    @property
    def settles(self) -> float | None:
        """Time from which it rests [s]; None where it never does, or does not say."""
        return None

    def starting_at(self, start: np.ndarray) -> Trajectory:
        """Return the same motion moved so that it is at ``start`` (m) [m] at time 0."""
        first = self.at(0.0).x_d
        return self.shifted(vector(start, first.size, "start") - first)

    def positions(self, times: np.ndarray) -> np.ndarray:
        """Return the positions (N, m) [m] at times (N) [s]."""
        return np.stack([self.at(float(t)).x_d for t in times])
