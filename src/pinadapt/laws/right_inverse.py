"""A right inverse of the believed Jacobian, and the null space it leaves."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgesv, dposv

from ..exceptions import DivergedError


class RightInverse:
    """J^+ = J^T (J J^T)^-1 of a Jacobian J (m, n) of full rank, the inverse itself where m = n.

    Null-space motion psi enters as J^+ u + (I - J^+ J) psi, which any right inverse allows without touching the task:
    J times it is u.

    Attributes:
        square: m = n, so that there is no null space.
    """

    def __init__(self, J: np.ndarray) -> None:
        """Take the Jacobian."""
        self._J = J
        self.square = J.shape[0] == J.shape[1]
        self._gram = J if self.square else J.dot(J.T)

    def gram_solve(self, u: np.ndarray) -> np.ndarray:
        """Return (J J^T)^-1 u (m) of a J that is not square.

        Raises:
            DivergedError: J lost rank.
        """
        _, solution, info = dposv(self._gram, u)
        _check(info)
        return solution

    def solve(self, u: np.ndarray, psi: np.ndarray | None) -> np.ndarray:
        """Return J^+ u + (I - J^+ J) psi (n), u (m) and psi (n), which is None for a square J.

        Raises:
            DivergedError: J is singular.
        """
        if psi is None:
            _, _, solution, info = dgesv(self._J, u)
            _check(info)
            return solution
        return psi + self.gram_solve(u - self._J.dot(psi)).dot(self._J)

    def null(self, z: np.ndarray) -> np.ndarray:
        """Return (I - J^+ J) z (n), the orthogonal projection onto the null space."""
        return np.zeros_like(z) if self.square else z - self.gram_solve(self._J.dot(z)).dot(self._J)


def _check(info: int) -> None:
    if info != 0:
        raise DivergedError(
            "the believed Jacobian lost rank: the arm is at a singularity of the estimated kinematics. "
            "Keep the path away from the workspace's edge, or start nearer to the true kinematics."
        )
