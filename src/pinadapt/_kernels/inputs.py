"""What is looked at in all that comes in."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("b1(f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], i8, i8, i8, i8)", fills=0)
def fit(
    q: np.ndarray,
    v: np.ndarray,
    x: np.ndarray,
    x_d: np.ndarray,
    xd_d: np.ndarray,
    xdd_d: np.ndarray,
    nq: int,
    n: int,
    coordinates: int,
    m: int,
) -> bool:
    """Tell whether q is (nq), v (n), x and x_d (coordinates), and xd_d and xdd_d (m)."""
    measured = len(q) == nq and len(v) == n and len(x) == coordinates
    return measured and len(x_d) == coordinates and len(xd_d) == m and len(xdd_d) == m
