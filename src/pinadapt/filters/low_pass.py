"""The first-order filter behind W_k, y and the filtered acceleration."""

from __future__ import annotations

import math

import numpy as np

from .._checks import positive


class LowPass:
    """lambda / (lambda + p) with state s: ds/dt = lambda (u - s).

    Its ``rate`` is the filtered derivative of the input, p lambda / (lambda + p) u: no sensor for
    the derivative is needed.

    Attributes:
        bandwidth: lambda [1/s].
    """

    def __init__(self, bandwidth: float, name: str = "lambda") -> None:
        """Take the bandwidth [1/s].

        Raises:
            GainError: not positive.
        """
        self.bandwidth = positive(bandwidth, name)

    def rate(self, state: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return ds/dt for input u, of the state's shape."""
        rate: np.ndarray = u - state
        rate *= self.bandwidth
        return rate

    def advance(self, state: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
        """Return the state after dt [s] with the input held: exact for any dt."""
        return state - math.expm1(-self.bandwidth * dt) * (u - state)
