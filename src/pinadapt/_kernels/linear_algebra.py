"""Small symmetric systems: the Gram matrix of a Jacobian, a mass matrix."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled

_LOST_RANK = 1e14  # (|J|_F / s)^2; the Gram matrix cannot tell more from rounding


@compiled("Tuple((f8, f8, b1))(f8[:,:], f8, f8[:,::1])", allocates=True)
def invert_gram(J: np.ndarray, threshold: float, inverse: np.ndarray) -> tuple[float, float, bool]:
    """Write (J J^T + mu^2 I)^-1 (m, m); return s, mu^2 and whether the rank is lost.

    J J^T + mu^2 I = L L^T by Cholesky, its inverse is (L^-1)^T L^-1, and undamped s^-2 is the sum
    of squares in L^-1.
    """
    m, n = J.shape
    L, L_inverse = inverse, np.empty((m, m))  # L stands where the inverse is written in the end
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


@compiled("b1(f8[:,:], f8[:,::1], f8[:])", fills=2)
def solve_definite(M: np.ndarray, L: np.ndarray, x: np.ndarray) -> bool:
    """Write M^-1 x over x (n) by Cholesky, M = L L^T; False if M is not positive definite.

    Of M and L (n, n) only the lower triangles are read and written, and on the diagonal of L stand
    the inverses of its entries.
    """
    n = len(x)
    for i in range(n):
        for j in range(i + 1):
            y = M[i, j]
            for t in range(j):
                y -= L[i, t] * L[j, t]
            if i == j and not y > 0.0:
                return False
            L[i, j] = 1.0 / math.sqrt(y) if i == j else y * L[j, j]
        for t in range(i):
            x[i] -= L[i, t] * x[t]
        x[i] *= L[i, i]
    for i in range(n - 1, -1, -1):
        for t in range(i + 1, n):
            x[i] -= L[t, i] * x[t]
        x[i] *= L[i, i]
    return True


@compiled(
    "void(f8[:,:], f8[:,:], f8[:], f8[:], f8[:], f8[:], f8[:,:], f8, f8[:], f8[:], f8[:], f8[:])",
    fills=4,
)
def right_inverse_and_rate(
    J: np.ndarray,
    gram_inverse: np.ndarray,
    u: np.ndarray,
    psi: np.ndarray,
    ud: np.ndarray,
    psid: np.ndarray,
    Jdot: np.ndarray,
    damping_rate: float,
    missed: np.ndarray,
    y: np.ndarray,
    x: np.ndarray,
    rate: np.ndarray,
) -> None:
    """Write x = psi + J^T y (n), y = G (u - J psi) (m), and its derivative (n).

    It is psid + Jdot^T y + J^T G (ud - Jdot x - damping_rate y - J (psid + Jdot^T y)). In between,
    missed (m) and y hold what psi misses, of the task's velocity and then of its acceleration.
    """
    m, n = J.shape

    def add_solution(target: np.ndarray, base: np.ndarray) -> None:
        """Add J^T y, y = G (target - J base), to the base (n)."""
        for i in range(m):
            missed[i] = target[i]
            for t in range(n):
                missed[i] -= J[i, t] * base[t]
        for i in range(m):
            y[i] = 0.0
            for j in range(m):
                y[i] += gram_inverse[i, j] * missed[j]
        for i in range(m):
            for t in range(n):
                base[t] += J[i, t] * y[i]

    for t in range(n):
        x[t], rate[t] = psi[t], psid[t]
    add_solution(u, x)
    for i in range(m):
        missed[i] = ud[i] - damping_rate * y[i]
        for t in range(n):
            missed[i] -= Jdot[i, t] * x[t]
            rate[t] += Jdot[i, t] * y[i]
    add_solution(missed, rate)


@compiled("f8(f8[:], f8[:])", fills=0)
def largest_share(x: np.ndarray, limits: np.ndarray) -> float:
    """Return the norm of x / limits with the eighth power, slightly above its largest entry.

    Zero where the power is not finite.
    """
    total = 0.0
    for i in range(len(x)):
        total += (x[i] / limits[i]) ** 8
    return total**0.125 if total < math.inf else 0.0
