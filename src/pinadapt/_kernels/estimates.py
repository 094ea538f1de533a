"""Steps of the estimates."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled(
    "void(f8[:,:], f8[:,:], f8[:], f8[:,:], f8[:], f8, f8[:], f8, f8[:,:], f8, f8[:], f8[:,:])",
    fills=2,
    allocates=True,
)
def fit(
    P: np.ndarray,
    W: np.ndarray,
    r: np.ndarray,
    R_0: np.ndarray,
    g: np.ndarray,
    rate: float,
    floor: np.ndarray,
    dt: float,
    prior: np.ndarray,
    kept: float,
    slope: np.ndarray,
    gain: np.ndarray,
) -> None:
    """Write -P_1 (g + W^T (R - R_0) r) (p) and (kept P_1^-1 + (1 - kept) prior)^-1 (p, p).

    P_1^-1 = P^-1 + dt W^T R W with R = rate (W P W^T + diag(floor))^-1 (m, m), or R_0 for a rate of
    zero. The floor has m entries, or one for all rows. All square matrices are symmetric; P and
    prior are positive definite.
    """

    def invert(A: np.ndarray) -> None:
        """Write A^-1 over A (n, n), symmetric and positive definite, by n sweeps."""
        n = len(A)
        for i in range(n):
            for j in range(i):
                A[j, i] = A[i, j]
        for k in range(n):
            pivot = 1.0 / A[k, k]
            for i in range(n):
                x = A[i, k] * pivot
                for j in range(n if i != k else 0):
                    A[i, j] -= x * A[k, j]
                A[i, k] = x
            for i in range(n):
                A[k, i] = A[i, k]
            A[k, k] = -pivot
        for i in range(n):
            for j in range(n):
                A[i, j] = -A[i, j]

    m, p = W.shape
    work = np.empty((2, max(m, p) + 1, max(m, p)))
    R, information, gradient = work[0, :m, :m], work[1, :p, :p], work[0, m, :p]
    for k in range(p):
        gradient[k] = g[k]
        for t in range(p):
            information[k, t] = P[k, t]
    for i in range(m):
        for j in range(m):
            R[i, j] = R_0[i, j]
    if rate > 0.0:
        for i in range(m):
            for k in range(p):
                slope[k] = 0.0  # P W^T, column by column
                for t in range(p):
                    slope[k] += P[k, t] * W[i, t]
            for j in range(m):
                R[i, j] = floor[i % len(floor)] if i == j else 0.0
                for k in range(p):
                    R[i, j] += W[j, k] * slope[k]
        invert(R)
        for i in range(m):
            x = 0.0
            for j in range(m):
                R[i, j] *= rate
                x += (R[i, j] - R_0[i, j]) * r[j]
            for k in range(p):
                gradient[k] += W[i, k] * x
    invert(information)
    for i in range(m):
        for k in range(p):
            x = 0.0
            for j in range(m):
                x += dt * R[i, j] * W[j, k]
            for t in range(p):
                information[t, k] += W[i, t] * x
    for k in range(p):
        for t in range(p):
            gain[k, t] = information[k, t]
    invert(gain)
    for k in range(p):
        slope[k] = 0.0
        for t in range(p):
            slope[k] -= gain[k, t] * gradient[t]
    for k in range(p):
        for t in range(p):
            gain[k, t] = kept * information[k, t] + (1.0 - kept) * prior[k, t]
    invert(gain)


@compiled(
    "void(f8[:], f8[:], i8, i8, i8[:,:], f8[:], i8[:,:], f8[:], f8, f8, f8[:])",
    allocates=True,
)
def follow_geodesic(
    a: np.ndarray,
    g: np.ndarray,
    p: int,
    n: int,
    places: np.ndarray,
    F: np.ndarray,
    dual_places: np.ndarray,
    dual: np.ndarray,
    h: float,
    most: float,
    after: np.ndarray,
) -> None:
    """Write the parameters (k p) of E P E^T, E = 1 - Z + Z^2 / 2, Z = h P L / 2.

    Of each block of p parameters P (n, n) is the sum of a_i F_i, and L that of g_i dual_i. F and
    dual are the entries that are not zero, at the places (i, row, column). Where h
    sqrt(tr(P L P L)), summed over the blocks, is above ``most``, h is reduced to that.
    """
    k = len(a) // p
    P, A, L = np.empty((k, n, n)), np.zeros((k, n, n)), np.empty((n, n))
    E, B, square = np.empty((n, n)), np.empty((n, n)), 0.0
    for b in range(k):
        for r in range(n):
            for s in range(n):
                P[b, r, s] = L[r, s] = 0.0
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
    z = 0.5 * h * (most / length if length > most else 1.0)
    for b in range(k):
        for r in range(n):
            for s in range(n):
                x = 0.0
                for t in range(n):
                    x += A[b, r, t] * A[b, t, s]
                E[r, s] = (1.0 if r == s else 0.0) - z * A[b, r, s] + 0.5 * z * z * x
        for r in range(n):
            for s in range(n):
                B[r, s] = 0.0
                for t in range(n):
                    B[r, s] += E[r, t] * P[b, t, s]
        for i in range(p):
            after[b * p + i] = a[b * p + i]
        for r in range(n):
            for s in range(n):
                L[r, s] = -P[b, r, s]
                for t in range(n):
                    L[r, s] += B[r, t] * E[s, t]
        for e in range(len(dual)):
            after[b * p + dual_places[e, 0]] += dual[e] * L[dual_places[e, 1], dual_places[e, 2]]
