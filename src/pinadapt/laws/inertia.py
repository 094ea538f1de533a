"""Solving with an estimated mass matrix."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgesv

from ..exceptions import DivergedError


def solve_inertia(M: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return M^-1 w (n) for an estimate M (n, n) that need not be positive definite.

    Raises:
        DivergedError: M is singular.
    """
    _, _, solution, info = dgesv(M.T, w)  # M is symmetric; its transpose is in the order LAPACK wants
    if info != 0:
        raise DivergedError(
            "the estimated mass matrix became singular. Natural adaptation keeps it positive definite; "
            "the improved and the passivity-based law never invert it."
        )
    return solution
