"""Rest-to-rest motion through points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory


class Waypoints(Trajectory):
    """Minimum-jerk segments from point to point, at rest in each; the last point is held.

    T. Flash, N. Hogan, *The coordination of arm movements*, J. Neuroscience 1985: s(u) = 10 u^3 -
    15 u^4 + 6 u^5.
    """

    def __init__(self, points: ArrayLike | list[np.ndarray], segment: float) -> None:
        """Take the points (k, m) [m], k >= 2, and the time [s] of one segment.

        Raises:
            InputError: fewer than two points, ragged or non-finite ones, or a time that is not
                positive.
        """
        self.points = numbers(points, "reference.points")
        if self.points.ndim != 2 or len(self.points) < 2:
            raise InputError(
                "expected at least two points of the same number of coordinates.",
                where="reference.points",
            )
        self.segment = positive(segment, "reference.segment")

    @property
    def extent(self) -> float:
        """Half the diagonal of the box around the points [m or rad]."""
        return float(0.5 * np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def settles(self) -> float:
        """When it comes to the last point [s]."""
        return self.segment * (len(self.points) - 1)

    def shifted(self, by: np.ndarray) -> Waypoints:
        """Return the same motion moved by (m) [m]."""
        return Waypoints(self.points + by, self.segment)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        last = len(self.points) - 2
        k = int(min(max(t // self.segment, 0), last))
        u, T = min(max(t / self.segment - k, 0.0), 1.0), self.segment
        start, move = self.points[k], self.points[k + 1] - self.points[k]
        s = u**3 * (10 - 15 * u + 6 * u * u)
        sd = 30 * u * u * (1 - u) ** 2 / T
        sdd = 60 * u * (1 - u) * (1 - 2 * u) / T**2
        return Desired(start + s * move, sd * move, sdd * move)
