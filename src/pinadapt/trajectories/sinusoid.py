"""One sinusoid a coordinate, each of a period of its own."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory

FROM_REST = -math.pi / 2.0


class Sinusoid(Trajectory):
    """x_d,i = center_i + amplitude_i sin(2 pi t / period_i + phase_i).

    With the default phase it starts at rest at center - amplitude. Meant for joint references, and
    good for any coordinates.
    """

    def __init__(
        self,
        center: ArrayLike,
        amplitude: ArrayLike,
        period: ArrayLike,
        phase: ArrayLike = FROM_REST,
    ) -> None:
        """Take centres, amplitudes, periods and phases, each (m) or one number for all.

        Args:
            center: [rad or m].
            amplitude: [rad or m], of either sign.
            period: [s].
            phase: [rad].

        Raises:
            InputError: different sizes, numbers that are not finite, or periods not positive.
        """
        given = {"center": center, "amplitude": amplitude, "period": period, "phase": phase}
        parts = {name: vector(part, None, f"reference.{name}") for name, part in given.items()}
        size = max(part.size for part in parts.values())
        for name, part in parts.items():
            whole = float(part[0]) if part.size == 1 else part
            parts[name] = vector(whole, size, f"reference.{name}")
        for each in parts["period"]:
            positive(each, "reference.period", error=InputError)
        self.center, self.amplitude = parts["center"], parts["amplitude"]
        self._w = 2.0 * math.pi / parts["period"]
        self._phase = parts["phase"]

    @property
    def extent(self) -> float:
        """Half the diagonal of the box that the amplitudes span [m or rad]."""
        return float(np.linalg.norm(self.amplitude))

    def shifted(self, by: np.ndarray) -> Sinusoid:
        """Return the same motion moved by (m) [rad or m]."""
        moved = copy(self)
        moved.center = self.center + by
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        w, angle = self._w, self._w * t + self._phase
        s, c = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        return Desired(self.center + s, w * c, -w * w * s)
