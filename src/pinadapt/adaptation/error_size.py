"""How large an error is, against a size that its user knows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers
from ..exceptions import GainError


def checked_size(size: ArrayLike, where: str) -> np.ndarray:
    """Return a number or k of them as an array.

    Raises:
        GainError: one of them is not positive.
    """
    given = numbers(size, where, error=GainError)
    if given.ndim > 1 or not (given > 0.0).all():
        raise GainError("expected a positive number, or one for each error.", where=where)
    return given


def error_size(e: np.ndarray, size: np.ndarray) -> float:
    """Return the root mean square of e (k) over its size, a number or (k); zero of none."""
    ratio = e / size
    return math.sqrt(float(ratio.dot(ratio)) / ratio.size) if ratio.size else 0.0
