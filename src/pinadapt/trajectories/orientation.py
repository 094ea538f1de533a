"""Desired orientations: how the tool turns, whatever its position does."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError
from ..tasks.rotation import matrix, rotation_between, turned

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def unit_quaternion(value: ArrayLike, name: str) -> np.ndarray:
    """Return a quaternion xyzw (4), made exactly of unit length.

    Raises:
        InputError: not four finite numbers, or a length that differs from 1 by more than 1 %.
    """
    q = vector(value, 4, name, names=("x", "y", "z", "w"))
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > 0.01:
        raise InputError(
            f"a quaternion xyzw of length 1 is expected, got length {length:.4g}.", where=name
        )
    return q / length


class Orientation(ABC):
    """A twice differentiable rotation R_d(t)."""

    @abstractmethod
    def at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return quaternion xyzw (4), angular velocity (3) [rad/s] and acceleration (3) [rad/s^2].

        All at time t [s], in world axes.
        """

    @abstractmethod
    def turned(self, by: np.ndarray) -> Orientation:
        """Return the same motion turned by the rotation vector (3) [rad], world axes."""

    @property
    def settles(self) -> float | None:
        """Time from which it rests [s]; None where it never does, or does not say."""
        return None

    def starting_at(self, start: np.ndarray) -> Orientation:
        """Return the same motion turned so that it is at the quaternion ``start`` (4) at time 0."""
        return self.turned(
            np.array(rotation_between(np.asarray(start).tolist(), self.at(0.0)[0].tolist()))
        )


class FixedOrientation(Orientation):
    """One orientation, held."""

    def __init__(self, quaternion: ArrayLike = UPRIGHT) -> None:
        """Take the unit quaternion xyzw (4).

        Raises:
            InputError: no unit quaternion.
        """
        self.quaternion = unit_quaternion(quaternion, "reference.orientation.quaternion")
        self._rest = np.zeros(3)

    @property
    def settles(self) -> float:
        """Zero: it rests."""
        return 0.0

    def turned(self, by: np.ndarray) -> FixedOrientation:
        """Return the orientation turned by the rotation vector (3) [rad], world axes."""
        return FixedOrientation(turned(self.quaternion, by))

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the quaternion, at rest."""
        return self.quaternion, self._rest, self._rest


class Swing(Orientation):
    """R_d = R_0 exp(axis amplitude sin(w t + phase)), w = 2 pi / period, axis fixed in the tool."""

    def __init__(
        self,
        axis: ArrayLike,
        amplitude: float,
        period: float,
        phase: float = 0.0,
        quaternion: ArrayLike = UPRIGHT,
    ) -> None:
        """Take axis (3), amplitude and phase [rad], period [s], and R_0 (4) xyzw.

        The axis is in the tool's axes, of any length.

        Raises:
            InputError: sizes or signs that cannot be, an axis of length zero, or no unit
                quaternion.
        """
        direction = vector(axis, 3, "reference.orientation.axis")
        length = float(np.linalg.norm(direction))
        if length < 1e-12:
            raise InputError(
                "an axis needs a direction, got zeros.", where="reference.orientation.axis"
            )
        self.axis = direction / length
        self.amplitude = positive(amplitude, "reference.orientation.amplitude", zero=True)
        self.period = positive(period, "reference.orientation.period")
        self.phase = float(vector(phase, 1, "reference.orientation.phase")[0])
        self.quaternion = unit_quaternion(quaternion, "reference.orientation.quaternion")

    def turned(self, by: np.ndarray) -> Swing:
        """Return the same motion turned by the rotation vector (3) [rad], world axes."""
        other = copy(self)
        other.quaternion = turned(self.quaternion, by)
        return other

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return quaternion (4), angular velocity (3) and acceleration (3) at time t [s]."""
        w = 2 * math.pi / self.period
        angle = w * t + self.phase
        s, c = self.amplitude * math.sin(angle), self.amplitude * math.cos(angle)
        axis = matrix(self.quaternion) @ self.axis  # at rest in the world
        return turned(self.quaternion, s * axis), w * c * axis, -w * w * s * axis
