"""A circle at constant speed."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory

PLANES = ("xy", "yz", "xz")


def plane_axes(plane: str, size: int) -> np.ndarray:
    """Return the two unit vectors (2, m) of a plane named by its world axes.

    Two coordinates have one plane, called "xy".

    Raises:
        InputError: an unknown plane, or one that the task does not span.
    """
    if size not in (2, 3):
        raise InputError(
            f"a circle needs 2 or 3 coordinates, got {size}.", where="reference.center"
        )
    if not isinstance(plane, str) or plane not in PLANES or (size == 2 and plane != "xy"):
        allowed = ["xy"] if size == 2 else list(PLANES)
        raise InputError(f"must be one of {allowed}, got {plane!r}.", where="reference.plane")
    return np.eye(size)[["xyz".index(axis) for axis in plane]]


class Circle(Trajectory):
    """x_d = center + radius (cos(w t + phase) u_1 + sin(w t + phase) u_2), w = 2 pi / period.

    Attributes:
        center: (m) [m].
        radius: [m].
        period: of a turn [s].
        plane: the two axes u_1, u_2.
        phase: angle at time 0 [rad].
    """

    def __init__(
        self, center: ArrayLike, radius: float, period: float, plane: str = "xy", phase: float = 0.0
    ) -> None:
        """Take centre (m) [m], radius [m], period [s], plane ("xy", "yz", "xz") and phase [rad].

        Raises:
            InputError: sizes, signs or names that cannot be.
        """
        self.center = vector(center, None, "reference.center")
        size = self.center.size
        self.radius = positive(radius, "reference.radius")
        self.period = positive(period, "reference.period")
        self.phase = float(vector(phase, 1, "reference.phase")[0])
        self.plane = plane
        u1, u2 = self.radius * plane_axes(plane, size)
        w = 2 * math.pi / self.period
        rest = np.zeros(size)
        self._w = w
        # (3, 3 m): what is constant and what goes with the angle's cosine and sine, of position,
        # velocity and acceleration side by side.
        self._parts = np.block(
            [
                [self.center, rest, rest],
                [u1, w * u2, -w * w * u1],
                [u2, -w * u1, -w * w * u2],
            ]
        )

    @property
    def extent(self) -> float:
        """The radius [m]."""
        return self.radius

    def shifted(self, by: np.ndarray) -> Circle:
        """Return the circle moved by (m) [m]."""
        moved = copy(self)
        moved.center = self.center + by
        moved._parts = self._parts.copy()
        moved._parts[0, : moved.center.size] = moved.center
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        angle = self._w * t + self.phase
        m = self.center.size
        motion = np.array((1.0, math.cos(angle), math.sin(angle))).dot(self._parts)
        return Desired(motion[:m], motion[m : 2 * m], motion[2 * m :])
