"""Small symmetric systems: the Gram matrix of a Jacobian, a mass matrix."""

from __future__ import annotations

import math

from .._compiled import Matrix, PackedMatrix, Vector, compiled

# (|J|_F / s)^2; the Gram matrix cannot tell more from rounding; half, twice: all runs the same
_LOST_RANK = 1e14


@compiled(fills=2)
def invert_gram(
    J: Matrix,
    threshold: float,
    levels: Vector,
    damping: Vector,
    inverse: PackedMatrix,
) -> tuple[float, bool]:
    """Write mu^2 of the rows (m) and (J J^T + diag mu^2)^-1 (m, m); return s, and if rank is lost.

    By Gauss-Jordan elimination, whose pivots are positive for a positive definite matrix. Undamped
    s^-2 is the trace of the inverse. Where s is too small, that of each level (m, from 0) follows
    in turn from the inverse of its own rows and those of the levels before, and its mu^2 from s.
    """
    m, n = J.shape
    A, s, mu_2, lost, last = inverse, 0.0, 0.0, False, 0.0
    for i in range(m):
        damping[i], last = 0.0, max(last, levels[i])
    level = -1.0  # all rows without damping; at the end all rows with it
    while level <= last + 1.0:
        squares, size, lost, whole = 0.0, 0.0, False, level < 0.0 or level > last
        for i in range(m):
            for j in range(m):
                A[i, j] = damping[i] if i == j else 0.0
                if whole or max(levels[i], levels[j]) <= level:
                    for t in range(n):
                        A[i, j] += J[i, t] * J[j, t]
                elif i == j:
                    A[i, i] = 1.0
            squares += A[i, i]
        for k in range(m):
            pivot, A[k, k] = A[k, k], 1.0
            lost |= not pivot > 0.0
            for j in range(m):
                A[k, j] /= pivot
            for i in range(m):
                if i != k:
                    factor, A[i, k] = A[i, k], 0.0
                    for j in range(m):
                        A[i, j] -= factor * A[k, j]
        for i in range(m):
            if whole or levels[i] == level:
                size += A[i, i]
        own = 0.0 if lost else 1.0 / math.sqrt(size)
        if level < 0.0:
            s = own
            if not s < threshold:
                lost |= threshold == 0.0 and not size * squares < _LOST_RANK
                break
        elif level <= last and own < threshold:
            mu_2 += 0.5 * (threshold * threshold - own * own)
        for i in range(m):
            if levels[i] == level:
                damping[i] = mu_2
        level += 1.0
    return s, lost


@compiled(fills=2)
def solve_definite(A: Matrix, x: Vector) -> bool:
    """Write A^-1 x over x (n), and what elimination leaves over the upper triangle of A (n, n).

    Return False if A is not positive definite.
    """
    n = len(x)
    for k in range(n):
        if not A[k, k] > 0.0:
            return False
        for i in range(k + 1, n):
            factor = A[k, i] / A[k, k]
            x[i] -= factor * x[k]
            for j in range(i, n):
                A[i, j] -= factor * A[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= A[k, j] * x[j]
        x[k] /= A[k, k]
    return True


@compiled(fills=4)
def right_inverse_and_rate(
    J: Matrix,
    gram_inverse: Matrix,
    u: Vector,
    psi: Vector,
    ud: Vector,
    psid: Vector,
    Jdot: Matrix,
    damping_rate: Vector,
    missed: Vector,
    y: Vector,
    x: Vector,
    rate: Vector,
) -> None:
    """Write x = psi + J^T y (n), y = G (u - J psi) (m), and its derivative (n).

    It is psid + Jdot^T y + J^T G (ud - Jdot x - damping_rate y - J (psid + Jdot^T y)). In between,
    missed (m) and y hold what psi misses, of the task's velocity and then of its acceleration.
    """
    m, n = J.shape

    def add_solution(target: Vector, base: Vector) -> None:
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
        missed[i] = ud[i] - damping_rate[i] * y[i]
        for t in range(n):
            missed[i] -= Jdot[i, t] * x[t]
            rate[t] += Jdot[i, t] * y[i]
    add_solution(missed, rate)


@compiled(fills=0)
def largest_share(x: Vector, limits: Vector) -> float:
    """Return the norm of x / limits with the eighth power, slightly above its largest entry.

    Zero where the power is not finite.
    """
    total = 0.0
    for i in range(len(x)):
        total += (x[i] / limits[i]) ** 8
    return total**0.125 if total < math.inf else 0.0
