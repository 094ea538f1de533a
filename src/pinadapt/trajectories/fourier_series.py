"""A finite Fourier series a coordinate, all of one period."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory

_EXTENT_SAMPLES = 40  # of each period of the fastest harmonic


class FourierSeries(Trajectory):
    """x_d,i = center_i + sum_k (cosine_ik cos(k w t) + sine_ik sin(k w t)), w = 2 pi / period.

    The motion repeats itself, and holds no frequency above K / period. It begins at rest where
    sum k sine_ik = 0, and without acceleration where sum k^2 cosine_ik = 0. After J. Swevers,
    C. Ganseman, D. Tukel, J. De Schutter, H. Van Brussel, *Optimal robot excitation and
    identification*, IEEE Trans. Robotics and Automation 13 (1997). See ``excite``.

    Attributes:
        center: (m) mean [rad or m].
        cosine, sine: (m, K) coefficients [rad or m], the slowest first.
        period: [s].
    """

    def __init__(
        self, center: ArrayLike, cosine: ArrayLike, sine: ArrayLike, period: float
    ) -> None:
        """Take means (m), coefficients (m, K) [rad or m], and the period [s].

        Raises:
            InputError: sizes that differ, numbers that are not finite, or a period not positive.
        """
        self.cosine = _table(cosine, "reference.cosine")
        self.sine = _table(sine, "reference.sine")
        if self.cosine.shape != self.sine.shape:
            raise InputError(
                f"expected as many as of cosines, {self.cosine.shape}, got {self.sine.shape}.",
                where="reference.sine",
            )
        self.center = numbers(center, "reference.center")
        if self.center.shape != (len(self.cosine),):
            raise InputError(
                f"expected {len(self.cosine)} numbers, one a row of coefficients, got shape "
                f"{self.center.shape}.",
                where="reference.center",
            )
        self.period = positive(period, "reference.period")
        self._w = 2.0 * math.pi / self.period * np.arange(1.0, self.cosine.shape[1] + 1.0)
        # (2 K, 3 m): what cosines and sines of all angles add to position, velocity, acceleration
        w = self._w[:, None]
        A, B = self.cosine.T, self.sine.T
        self._parts = np.block([[A, w * B, -w * w * A], [B, -w * A, -w * w * B]])

    @property
    def harmonics(self) -> int:
        """Number K of harmonics."""
        return len(self._w)

    @property
    def extent(self) -> float:
        """Half the diagonal of the box around the motion [m or rad]."""
        count = _EXTENT_SAMPLES * self.harmonics
        path = self.positions(np.linspace(0.0, self.period, count, endpoint=False))
        return float(0.5 * np.linalg.norm(np.ptp(path, axis=0)))

    def shifted(self, by: np.ndarray) -> FourierSeries:
        """Return the same motion moved by (m) [rad or m]."""
        moved = copy(self)
        moved.center = self.center + by
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        angles = self._w * t
        x, xd, xdd = (
            np.concatenate([np.cos(angles), np.sin(angles)]).dot(self._parts).reshape(3, -1)
        )
        return Desired(self.center + x, xd, xdd)


def _table(value: ArrayLike, name: str) -> np.ndarray:
    """Return coefficients (m, K), a row for each coordinate.

    Raises:
        InputError: another shape, or none.
    """
    table = numbers(value, name)
    if table.ndim != 2 or not table.size:
        raise InputError(
            f"expected a list of coefficients for each coordinate, got shape {table.shape}.",
            where=name,
        )
    return table
