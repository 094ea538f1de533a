"""The Fourier series that begin and end at rest, and without acceleration, as a linear space."""

from __future__ import annotations

import numpy as np

from ..trajectories.fourier_series import FourierSeries


class RestToRest:
    """Motions x(t) = x_0 + Phi(t) theta, whose velocity and acceleration vanish at t = 0.

    Phi stacks cosines and sines of K harmonics; of their 2 K coefficients the two conditions leave
    2 K - 2 a coordinate, theta, which count by the speed that they make.

    Attributes:
        size: 2 K - 2.
        period: [s].
        times: (N) instants of a period [s] at which it is looked at.
    """

    def __init__(self, harmonics: int, period: float, samples: int) -> None:
        """Take K of at least 2, the period [s], and the number N of instants."""
        k = np.arange(1.0, harmonics + 1.0)
        conditions = np.zeros((2, 2 * harmonics))
        conditions[0, :harmonics], conditions[1, harmonics:] = k, np.ones(harmonics)
        slower = np.tile(1.0 / k, 2)  # coefficients of the same speed
        self._free = slower[:, None] * np.linalg.svd(conditions)[2][2:].T
        self._harmonics, self.period = harmonics, period
        self.size = self._free.shape[1]
        self.times = np.linspace(0.0, period, samples, endpoint=False)
        w = 2.0 * np.pi / period * k
        c, s = np.cos(np.outer(self.times, w)), np.sin(np.outer(self.times, w))
        self._way = np.hstack([c - 1.0, s]) @ self._free
        self._velocity = np.hstack([-w * s, w * c]) @ self._free
        self._acceleration = np.hstack([-w * w * c, -w * w * s]) @ self._free

    def motion(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the way from the start, velocity and acceleration (N, n) of theta (n, size)."""
        return self._way @ theta.T, self._velocity @ theta.T, self._acceleration @ theta.T

    def gathered(self, slopes: np.ndarray) -> np.ndarray:
        """Return the derivative (n, size) by theta of what has those (3, n, N) by the states."""
        parts = self._way, self._velocity, self._acceleration
        return sum(slope @ part for slope, part in zip(slopes, parts, strict=True))

    def series(self, start: np.ndarray, theta: np.ndarray) -> FourierSeries:
        """Return the motion of theta (n, size) from a start (n)."""
        cosine, sine = np.split(theta @ self._free.T, [self._harmonics], axis=1)
        return FourierSeries(start - cosine.sum(axis=1), cosine, sine, self.period)
