"""Steps of the estimates."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import IndexTable, Matrix, PackedVector, Vector, compiled


@compiled(fills=2, allocates=True)
def fit(
    information: Matrix,
    W: Matrix,
    r: Vector,
    R_0: Matrix,
    g: Vector,
    rate: float,
    floor: Vector,
    dt: float,
    kept: float,
    restored: float,
    prior: Matrix,
    slope: Vector,
    after: Matrix,
) -> None:
    """Write -P_1 (g + W^T (R - R_0) r) (p) and kept P_1^-1 + restored prior (p, p).

    P_1^-1 = information + dt W^T R W with R = rate (W P W^T + diag(floor))^-1 (m, m), or R_0 for a
    rate of zero. The floor has m entries, or one for all rows. All square matrices are symmetric
    and positive definite, P^-1 is the information.
    """

    def solve(A: Matrix, X: Matrix) -> None:
        """Write A^-1 x over each row x of X, and what elimination leaves over A."""
        n = len(A)
        for k in range(n):
            for i in range(k + 1, n):
                factor = A[k, i] / A[k, k]
                for j in range(i, n):
                    A[i, j] -= factor * A[k, j]
                for row in range(len(X)):
                    X[row, i] -= factor * X[row, k]
        for row in range(len(X)):
            for k in range(n - 1, -1, -1):
                for j in range(k + 1, n):
                    X[row, k] -= A[k, j] * X[row, j]
                X[row, k] /= A[k, k]

    m, p = W.shape
    R, P_W, S, total, gradient = (
        R_0.copy(),
        W.copy(),
        np.zeros((m, m)),
        information.copy(),
        g.copy(),
    )
    if rate > 0.0:
        solve(information.copy(), P_W)
        for i in range(m):
            S[i, i] = floor[i % len(floor)]
            for j in range(m):
                R[i, j] = rate if i == j else 0.0
                for k in range(p):
                    S[i, j] += W[i, k] * P_W[j, k]
        solve(S, R)
        for i in range(m):
            x = 0.0
            for j in range(m):
                x += (R[i, j] - R_0[i, j]) * r[j]
            for k in range(p):
                gradient[k] += W[i, k] * x
    for i in range(m):
        for k in range(p):
            x = 0.0
            for j in range(m):
                x += dt * R[i, j] * W[j, k]
            for t in range(p):
                total[k, t] += x * W[i, t]
    for k in range(p):
        for t in range(p):
            after[k, t] = kept * total[k, t] + restored * prior[k, t]
    solve(total, gradient.reshape(1, p))
    for k in range(p):
        slope[k] = -gradient[k]


@compiled(allocates=True)
def follow_geodesic(
    a: Vector,
    g: Vector,
    p: int,
    n: int,
    places: IndexTable,
    F: PackedVector,
    dual_places: IndexTable,
    dual: PackedVector,
    h: float,
    most: float,
    after: Vector,
) -> None:
    """Write the parameters (k p) of exp(-h P L) P by its series up to (h P L)^4, by Horner.

    Of each block of p parameters P (n, n) is the sum of a_i F_i, and L that of g_i dual_i. F and
    dual are the entries that are not zero, at the places (i, row, column). Where h
    sqrt(tr(P L P L)), summed over the blocks, is above ``most``, h is reduced to that.
    """
    k = len(a) // p
    square = 0.0
    P = np.zeros((k, n, n))
    A = np.zeros((k, n, n))
    both = np.empty((2, n, n))
    for b in range(k):
        L = np.zeros((n, n))
        for e in range(len(F)):
            P[b, places[e, 1], places[e, 2]] += a[b * p + places[e, 0]] * F[e]
        for e in range(len(dual)):
            L[dual_places[e, 1], dual_places[e, 2]] += g[b * p + dual_places[e, 0]] * dual[e]
        for r in range(n):
            for s in range(n):
                for t in range(n):
                    A[b, r, s] += P[b, r, t] * L[t, s]
        for r in range(n):
            for s in range(n):
                square += A[b, r, s] * A[b, s, r]
    length = h * math.sqrt(abs(square))
    h *= most / length if length > most else 1.0
    for i in range(len(a)):
        after[i] = a[i]
    for b in range(k):
        X = P[b]
        for order in range(4, 0, -1):  # P - h A / order X
            Y = both[order % 2]
            share = h / order
            for r in range(n):
                for s in range(n):
                    x = 0.0
                    for t in range(n):
                        x += A[b, r, t] * X[t, s]
                    Y[r, s] = P[b, r, s] - share * x
            X = Y
        for e in range(len(dual)):
            r = dual_places[e, 1]
            s = dual_places[e, 2]
            after[b * p + dual_places[e, 0]] += dual[e] * (X[r, s] - P[b, r, s])


@compiled()
def exponentiate(a: Vector, g: Vector, scale: Vector, h: float, most: float, after: Vector) -> None:
    """Write a exp(-h scale g) (p), exponents cut to ``most``."""
    for i in range(len(a)):
        after[i] = a[i] * math.exp(min(max(-h * scale[i] * g[i], -most), most))


@compiled()
def advance(a: Vector, rate: Vector, dt: float, after: Vector) -> None:
    """Write a + dt rate (p)."""
    for i in range(len(a)):
        after[i] = a[i] + dt * rate[i]


@compiled(fills=0)
def inside(a: Vector, low: Vector, high: Vector) -> bool:
    """Return whether low < a < high in every entry."""
    within = True
    for i in range(len(a)):
        within &= low[i] < a[i] < high[i]
    return within
