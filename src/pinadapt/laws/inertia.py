"""Solving with an estimated mass matrix, and the watch on it."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgesv, dposv

from ..exceptions import DivergedError


def solve_inertia(M: np.ndarray, w: np.ndarray, watch: bool) -> np.ndarray:
    """Return M^-1 w (n) for an estimate M (n, n), symmetric.

    Args:
        M: the estimated mass matrix.
        w: (n).
        watch: refuse an M that is not positive definite, which no mass matrix is; else only a singular one.

    Raises:
        DivergedError: M is refused.
    """
    if watch:  # the transpose is in the order LAPACK wants
        _, solution, info = dposv(M.T, w)
    else:
        _, _, solution, info = dgesv(M.T, w)
    if info != 0:
        raise DivergedError(
            f"the estimated mass matrix {'is no longer positive definite' if watch else 'became singular'}, and this law "
            "inverts it. Natural and projected adaptation keep it positive definite; with plain gradient adaptation try a "
            "smaller gamma_d, or the passivity-based law 'adaptive-jacobian', which inverts no mass matrix."
        )
    return solution
