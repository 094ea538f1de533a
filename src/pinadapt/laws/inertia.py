"""Solving with an estimated mass matrix, and the watch on it."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled
from ..exceptions import DivergedError


def solve_inertia(M: np.ndarray, w: np.ndarray, watch: bool) -> np.ndarray:
    """Return M^-1 w (n) for an estimate M (n, n), symmetric.

    Args: M: the estimated mass matrix. w: (n). watch: refuse an M that is not positive definite,
        which no mass matrix is; else only a singular one.

    Raises:
        DivergedError: M is refused.
    """
    if watch:
        solution = np.empty(w.size)
        solved = _solve_definite(M, w, solution)
    else:
        from scipy.linalg.lapack import dgesv  # here, because scipy is slow to import

        _, _, solution, info = dgesv(M.T, w)  # the transpose is in the order LAPACK wants
        solved = info == 0
    if not solved:
        raise DivergedError(
            f"the estimated mass matrix {'is no longer positive definite' if watch else 'became singular'}, and this law "
            "inverts it. Natural and projected adaptation keep it positive definite; with plain gradient adaptation try a "
            "smaller gamma_d, or the passivity-based law 'adaptive-jacobian', which inverts no mass matrix."
        )
    return solution


@compiled("b1(f8[:,:], f8[:], f8[:])")
def _solve_definite(M: np.ndarray, w: np.ndarray, solution: np.ndarray) -> bool:
    """Write M^-1 w (n) by the Cholesky factor M = L L^T (from the lower triangle); False if M is not positive definite."""
    n = len(w)
    L = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            x = M[i, j]
            for t in range(j):
                x -= L[i, t] * L[j, t]
            if i == j and not x > 0.0:
                return False
            L[i, j] = math.sqrt(x) if i == j else x / L[j, j]
    for i in range(n):  # L y = w
        y = w[i]
        for t in range(i):
            y -= L[i, t] * solution[t]
        solution[i] = y / L[i, i]
    for i in range(n - 1, -1, -1):  # L^T x = y
        x = solution[i]
        for t in range(i + 1, n):
            x -= L[t, i] * solution[t]
        solution[i] = x / L[i, i]
    return True
