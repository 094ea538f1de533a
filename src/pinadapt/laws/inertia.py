"""Solving with an estimated mass matrix, and the watch on it."""

from __future__ import annotations

import numpy as np
from numpy import empty

from .._kernels import linear_algebra as kernels
from ..exceptions import DivergedError


def solve_inertia(M: np.ndarray, J: np.ndarray, e: np.ndarray, watch: bool) -> np.ndarray:
    """Return M^-1 J^T e (n) for an estimate M (n, n), symmetric.

    Args:
        M: the estimated mass matrix.
        J: (m, n).
        e: (m).
        watch: refuse an M that is not positive definite, which no mass matrix is; else only a
            singular one.

    Raises:
        DivergedError: M is refused.
    """
    if watch:
        solution = empty(len(M))
        solved = kernels.solve_definite(M, J, e, solution)
    else:
        from scipy.linalg.lapack import dgesv  # slow to import, and seldom needed

        _, _, solution, info = dgesv(M.T, e.dot(J))  # the transpose is in the order LAPACK wants
        solved = info == 0
    if not solved:
        became = "is no longer positive definite" if watch else "became singular"
        raise DivergedError(
            f"the estimated mass matrix {became}, and this law inverts it. Natural and projected "
            "adaptation keep it positive definite; with plain gradient adaptation try a smaller "
            "gamma_d, or the law 'separation' or 'adaptive-jacobian', which invert no mass matrix."
        )
    return solution
