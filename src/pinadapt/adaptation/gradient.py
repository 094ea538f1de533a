"""Gradient adaptation with a constant gain."""

from __future__ import annotations

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import MOST_PARAMETERS, definite_matrix, whole
from .._kernels import estimates as kernels
from .adaptation import Adaptation, Drive, Estimate


class Gradient(Adaptation):
    """da/dt = -Gamma g, as in Wang and Xie (2009), equations (18) and (19).

    The adaptation's part of V is (a - a_true)^T Gamma^-1 (a - a_true) / 2.

    Attributes:
        Gamma: (p, p) constant, symmetric, positive definite.
    """

    name = "gradient"

    def __init__(self, Gamma: ArrayLike, size: int, name: str = "Gamma") -> None:
        """Choose Gamma: a number, p numbers or a matrix (p, p), for p = ``size`` parameters.

        Raises:
            GainError: Gamma is not positive definite, or of another size.
        """
        size = whole(size, "size", 0, most=MOST_PARAMETERS)
        self.Gamma = np.ascontiguousarray(definite_matrix(Gamma, size, name))
        self._descent = -self.Gamma

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return -Gamma g (p)."""
        return Estimate(self._descent.dot(drive.gradient))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        value = estimate.value
        after = empty(value.size)
        kernels.advance(value, self._descent.dot(drive.gradient), dt, after)
        return Estimate(after)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float:
        """Return half the squared Gamma^-1 norm of the parameter error."""
        error = estimate.value - truth
        return 0.5 * error @ np.linalg.solve(self.Gamma, error)

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l)."""
        return self.Gamma.dot(X)
