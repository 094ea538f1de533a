"""What tells a measurement that cannot be, and an arm that rests."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("i8(f8[:], f8[:])", fills=0)
def first_beyond(values: np.ndarray, bounds: np.ndarray) -> int:
    """Return the first index at which |values| > bounds, or -1; NaN is not beyond."""
    for i in range(len(values)):
        if abs(values[i]) > bounds[i]:
            return i
    return -1


@compiled("f8(f8[:], f8[:], i8)", fills=0)
def distance(x: np.ndarray, y: np.ndarray, size: int) -> float:
    """Return the distance of the first ``size`` numbers of x and y."""
    square = 0.0
    for i in range(size):
        square += (x[i] - y[i]) ** 2
    return np.sqrt(square)


@compiled("b1(f8[:], f8[:], f8[:], f8[:], f8, f8)", fills=0)
def rests(
    xd_d: np.ndarray,
    xdd_d: np.ndarray,
    v: np.ndarray,
    dx: np.ndarray,
    slowest: float,
    nearest: float,
) -> bool:
    """Tell whether nothing is asked to move, |v| < slowest in every joint and |dx| < nearest."""
    resting = True
    for i in range(len(xd_d)):
        resting &= xd_d[i] == 0.0 and xdd_d[i] == 0.0 and abs(dx[i]) < nearest
    for i in range(len(v)):
        resting &= abs(v[i]) < slowest
    return resting
