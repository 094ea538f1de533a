"""The weight R of a prediction error, as users write it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix, numbers
from ..exceptions import GainError


def checked_weight(weight: ArrayLike, where: str = "weight") -> np.ndarray:
    """Return a number, n numbers or a matrix (n, n) as an array, checked to be positive definite.

    Raises:
        GainError: it is not.
    """
    given = numbers(weight, where, error=GainError)
    definite_matrix(given, len(np.atleast_1d(given)), where)
    return given


def weight_of(checked: np.ndarray, n: int) -> np.ndarray:
    """Return R (n, n) from what ``checked_weight`` returned."""
    return checked if checked.ndim == 2 else np.diag(np.broadcast_to(checked, n))
