"""What is looked at in all that comes in."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled(
    "b1(f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], i8[:])",
    fills=0,
)
def fit(
    a_d: np.ndarray,
    a_0: np.ndarray,
    a_k: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    x: np.ndarray,
    x_d: np.ndarray,
    xd_d: np.ndarray,
    xdd_d: np.ndarray,
    sizes: np.ndarray,
) -> bool:
    """Tell whether sizes are those of a_d and a_0, a_k, q, v, x and x_d, xd_d and xdd_d."""
    estimates = len(a_d) == sizes[0] and len(a_0) == sizes[0] and len(a_k) == sizes[1]
    measured = len(q) == sizes[2] and len(v) == sizes[3] and len(x) == sizes[4]
    desired = len(x_d) == sizes[4] and len(xd_d) == sizes[5] and len(xdd_d) == sizes[5]
    return estimates and measured and desired
