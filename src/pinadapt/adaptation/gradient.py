"""Gradient adaptation with a constant gain matrix, as published by Wang and Xie."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix
from .adaptation import Adaptation


class Gradient(Adaptation):
    """da/dt = -Gamma g, with V's part (a - a_true)^T Gamma^-1 (a - a_true) / 2.

    Attributes:
        Gamma: (p, p) constant, symmetric, positive definite.
    """

    name = "gradient"

    def __init__(self, Gamma: ArrayLike, size: int, name: str = "Gamma") -> None:
        """Take a scalar, p numbers or a matrix, for p = ``size`` parameters.

        Raises:
            GainError: not positive definite, or of another size.
        """
        self.Gamma = definite_matrix(Gamma, size, name)
        self._information = np.linalg.inv(self.Gamma)
        diagonal = np.diag(self.Gamma)
        self._minus_diagonal = -diagonal if (self.Gamma == np.diag(diagonal)).all() else None

    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return -Gamma g (p)."""
        return -self.Gamma.dot(g) if self._minus_diagonal is None else self._minus_diagonal * g

    def distance(self, a: np.ndarray, a_true: np.ndarray) -> float:
        """Return half the squared Gamma^-1 norm of the parameter error."""
        error = a - a_true
        return float(0.5 * error @ self._information @ error)
