"""A right inverse of the believed Jacobian, damped near singularities, and its null space."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled
from ..exceptions import DivergedError

_LOST_RANK = 1e14  # (|J|_F / s)^2; the Gram matrix cannot tell more from rounding


class RightInverse:
    """J^+ = J^T (J J^T + mu^2 I)^-1 of J (m, n), m <= n; mu = 0 where J is well conditioned.

    Null-space motion psi enters as J^+ u + (I - J^+ J) psi. Undamped, J times it is u: the task
    does not feel psi. Damped, J times it is u - mu^2 (J J^T + mu^2 I)^-1 (u - J psi): the task is
    missed by at most the share mu^2 / (s_min^2 + mu^2) of u - J psi, and (17) of Wang and Xie holds
    up to that.

    Damping begins where s = tr((J J^T)^-1)^(-1/2) falls below a threshold s_0. As s^-2 is the sum
    of all sigma_i^-2, s is at most the smallest singular value, and at least that over sqrt(m); the
    solution needs (J J^T)^-1 anyway. The form of mu is that of damped least squares (Y. Nakamura,
    H. Hanafusa, ASME J. Dyn. Syst. Meas. Control 108 (1986) 163-171; S. Chiaverini, IEEE T. Robot.
    Autom. 13 (1997) 398-410), mu^2 = mu_max^2 (1 - (s / s_0)^2), with mu_max^2 = s_0^2 / 2, the
    least for which |J^+| <= 1 / s_0 always.

    Attributes:
        J: the Jacobian (m, n).
        gram_inverse: (J J^T + mu^2 I)^-1 (m, m).
        damping: mu^2.
        smallest: s.
        unique: whether J^+ is the inverse itself, so that there is no null space: J square and not
            damped.
    """

    def __init__(self, J: np.ndarray, threshold: float = 0.0) -> None:
        """Take the Jacobian (m, n) and s_0, zero for no damping.

        Raises:
            DivergedError: J lost rank and is not damped, or is not finite.
        """
        m, n = J.shape
        self.J, self.gram_inverse = J, np.empty((m, m))
        self.smallest, self.damping, lost = _invert_gram(J, threshold, self.gram_inverse)
        if lost:
            raise DivergedError(
                "the believed Jacobian lost rank: the arm is at a singularity of the estimated "
                "kinematics. Keep the path away from the workspace's edge, start nearer to the "
                "true kinematics, or damp the inverse "
                "(damping = 0.2)."
            )
        self.unique = m == n and not self.damping

    def solve(self, u: np.ndarray, psi: np.ndarray | None) -> np.ndarray:
        """Return J^+ u + (I - J^+ J) psi (n), u (m), psi (n) or None where J^+ is unique."""
        if psi is None:
            return self.gram_inverse.dot(u).dot(self.J)
        return psi + self.gram_inverse.dot(u - self.J.dot(psi)).dot(self.J)

    def solve_rate(
        self,
        u: np.ndarray,
        psi: np.ndarray | None,
        ud: np.ndarray,
        psid: np.ndarray,
        Jdot: np.ndarray,
    ) -> np.ndarray:
        """Return d/dt (n) of ``solve(u, psi)`` while u, psi and J move at ud, psid and Jdot.

        With y = (J J^T + mu^2 I)^-1 (u - J psi), which makes the solution r = psi + J^T y, it is
        J^+ (ud - Jdot r - y d(mu^2)/dt) + (I - J^+ J) (psid + Jdot^T y).
        """
        ud = ud - Jdot.dot(self.solve(u, psi))
        if psi is None:
            return self.solve(ud, None)
        y = self.gram_inverse.dot(u - self.J.dot(psi))
        if self.damping:
            ud -= self._damping_rate(Jdot) * y
        return self.solve(ud, psid + y.dot(Jdot))

    def null(self, z: np.ndarray) -> np.ndarray:
        """Return (I - J^+ J) z (n); undamped, the orthogonal projection onto the null space."""
        return (
            np.zeros_like(z)
            if self.unique
            else z - self.gram_inverse.dot(self.J.dot(z)).dot(self.J)
        )

    def _damping_rate(self, Jdot: np.ndarray) -> float:
        """Return d(mu^2)/dt = -d(s^2)/dt / 2 = -sum_i (s / sigma_i)^4 d(sigma_i^2)/dt / 2."""
        U, sigma, _ = np.linalg.svd(self.J, full_matrices=False)
        sigma = np.maximum(sigma, np.finfo(float).eps * sigma[0])
        halves = np.diag(U.T @ Jdot @ self.J.T @ U)  # d(sigma_i^2)/dt / 2
        ratios = 1.0 / (sigma * sigma * np.sum(1.0 / (sigma * sigma)))  # (s / sigma_i)^2
        return float(-halves.dot(ratios * ratios))


@compiled("Tuple((f8, f8, b1))(f8[:,:], f8, f8[:,::1])")
def _invert_gram(J: np.ndarray, threshold: float, inverse: np.ndarray) -> tuple[float, float, bool]:
    """Write (J J^T + mu^2 I)^-1 (m, m); return s, mu^2 and whether the rank is lost.

    J J^T + mu^2 I = L L^T by Cholesky, its inverse is (L^-1)^T L^-1, and undamped s^-2 is the sum
    of squares in L^-1.
    """
    m, n = J.shape
    L, L_inverse = np.empty((m, m)), np.zeros((m, m))
    s, mu_2, lost = 0.0, 0.0, False
    for damped in (False, True):
        squares, size, lost = 0.0, 0.0, False  # |J|_F^2 and |L^-1|_F^2
        for i in range(m):
            for j in range(i + 1):
                x = mu_2 if i == j else 0.0
                for t in range(n):
                    x += J[i, t] * J[j, t]
                squares += x if i == j else 0.0
                for t in range(j):
                    x -= L[i, t] * L[j, t]
                if i == j:
                    lost |= not x > 0.0
                    L[i, i] = math.sqrt(x) if x > 0.0 else math.inf
                else:
                    L[i, j] = x / L[j, j]
            for j in range(i + 1):
                x = 1.0 if i == j else 0.0
                for t in range(j, i):
                    x -= L[i, t] * L_inverse[t, j]
                L_inverse[i, j] = x / L[i, i]
                size += L_inverse[i, j] * L_inverse[i, j]
        if not damped:
            s = 0.0 if lost else 1.0 / math.sqrt(size)
            if not s < threshold:
                lost |= threshold == 0.0 and not size * squares < _LOST_RANK
                break
            mu_2 = 0.5 * (threshold * threshold - s * s)
    for i in range(m):
        for j in range(i + 1):
            x = 0.0
            for t in range(i, m):
                x += L_inverse[t, i] * L_inverse[t, j]
            inverse[i, j] = inverse[j, i] = x
    return s, mu_2, lost
