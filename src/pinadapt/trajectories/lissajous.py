"""A Lissajous figure: one sine a coordinate."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..records import Desired
from .trajectory import Trajectory


class Lissajous(Trajectory):
    """x_d,i = center_i + amplitude_i sin(2 pi n_i t / period + phase_i)."""

    def __init__(
        self,
        center: ArrayLike,
        amplitude: ArrayLike,
        cycles: ArrayLike,
        period: float,
        phase: ArrayLike = 0.0,
    ) -> None:
        """Take centre, amplitudes [m], cycles a period n, phases [rad], (m) each, and period [s].

        Raises:
            InputError: sizes or signs that cannot be.
        """
        self.center = vector(center, None, "reference.center")
        size = self.center.size
        self.amplitude = vector(amplitude, size, "reference.amplitude")
        self._w = (
            2
            * np.pi
            * vector(cycles, size, "reference.cycles")
            / positive(period, "reference.period")
        )
        self._phase = vector(phase, size, "reference.phase")

    @property
    def extent(self) -> float:
        """Half the diagonal of the box that the amplitudes span [m or rad]."""
        return float(np.linalg.norm(self.amplitude))

    def shifted(self, by: np.ndarray) -> Lissajous:
        """Return the figure moved by (m) [m]."""
        moved = copy(self)
        moved.center = self.center + by
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        angle = self._w * t + self._phase
        s, c = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        return Desired(self.center + s, self._w * c, -self._w * self._w * s)
