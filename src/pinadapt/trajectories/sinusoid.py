"""One sinusoid a coordinate, each at a frequency of its own."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from ..records import Desired
from .trajectory import Trajectory


class Sinusoid(Trajectory):
    """x_d,i = start_i + amplitude_i (1 - cos(omega_i t)), or start_i + amplitude_i sin(omega_i t).

    The first starts at rest, the second at speed; both are at ``start`` at time 0. Meant for
    joint references, and good for any coordinates.
    """

    def __init__(
        self,
        start: ArrayLike,
        amplitude: ArrayLike,
        omega: ArrayLike,
        *,
        from_rest: bool = True,
    ) -> None:
        """Take start, amplitudes [rad or m], angular frequencies [rad/s], each (m) or one number.

        Args:
            start: x_d at time 0.
            amplitude: of either sign. From rest the motion spans twice as much, to one side.
            omega: of either sign.
            from_rest: whether the motion is the one with the cosine.

        Raises:
            InputError: different sizes, or numbers that are not finite.
        """
        size = max(np.size(start), np.size(amplitude), np.size(omega))
        self.start = vector(start, size, "reference.start")
        self.amplitude = vector(amplitude, size, "reference.amplitude")
        self.omega = vector(omega, size, "reference.omega")
        self.from_rest = from_rest

    def shifted(self, by: np.ndarray) -> Sinusoid:
        """Return the same motion moved by (m) [rad or m]."""
        moved = copy(self)
        moved.start = self.start + by
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        w, angle = self.omega, self.omega * t
        s, c = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        if self.from_rest:
            return Desired(self.start + self.amplitude - c, w * s, w * w * c)
        return Desired(self.start + s, w * c, -w * w * s)
