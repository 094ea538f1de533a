"""A circle at constant speed."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import positive, vector
from .._compiled import compiled
from ..exceptions import InputError
from ..records import Desired, named
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
        self._axes = self.radius * plane_axes(plane, size)
        self._w = 2 * math.pi / self.period

    @property
    def extent(self) -> float:
        """The radius [m]."""
        return self.radius

    def shifted(self, by: np.ndarray) -> Circle:
        """Return the circle moved by (m) [m]."""
        moved = copy(self)
        moved.center = self.center + by
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        m, w = self.center.size, self._w
        motion = empty(m), empty(m), empty(m)
        _turn(self.center, self._axes, w, w * t + self.phase, *motion)
        return named(Desired, motion)


@compiled("void(f8[:], f8[:,:], f8, f8, f8[:], f8[:], f8[:])", fills=3)
def _turn(
    center: np.ndarray,
    axes: np.ndarray,
    w: float,
    angle: float,
    x_d: np.ndarray,
    xd_d: np.ndarray,
    xdd_d: np.ndarray,
) -> None:
    """Write centre + axes^T (cos angle, sin angle) (m) and its derivatives at d(angle)/dt = w."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(len(center)):
        out = c * axes[0, i] + s * axes[1, i]
        x_d[i] = center[i] + out
        xd_d[i] = w * (c * axes[1, i] - s * axes[0, i])
        xdd_d[i] = -w * w * out
