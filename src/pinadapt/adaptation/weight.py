"""The weight R of a prediction error, as users write it or as makes the error decay at a rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix, numbers, positive
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


class DecayWeight:
    """R = rate (W Gamma W^T + diag(floor))^-1, with which dr/dt = -rate r + (what W changes).

    Every row of the error decays at the same rate and in no units; the floor keeps rows that hardly
    move from being heard, and where the gain Gamma falls it becomes the constant weight of noise.

    Attributes:
        rate: [1/s].
        floor: one positive number, or one a row, in units of W Gamma W^T.
    """

    def __init__(self, rate: float, floor: ArrayLike) -> None:
        """Take rate and floor.

        Raises:
            GainError: one of them is not positive.
        """
        self.rate = positive(rate, "prediction_rate")
        self.floor = numbers(floor, "floor", error=GainError)
        if not (self.floor > 0.0).all():
            raise GainError("must be positive: at rest nothing else bounds R.", where="floor")

    def at(self, S: np.ndarray) -> np.ndarray:
        """Return R (n, n) where W Gamma W^T is S (n, n)."""
        S = S.copy()
        S.flat[:: len(S) + 1] += self.floor
        R = self.rate * np.linalg.inv(S)
        return np.asarray(0.5 * (R + R.T))
