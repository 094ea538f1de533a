"""Steps of the estimates."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled("void(f8[:,:], f8[:,:], f8[:], f8[:,:], f8[:], f8, f8[:], f8[:])", allocates=True)
def fit_rate(
    P: np.ndarray,
    W: np.ndarray,
    r: np.ndarray,
    R_0: np.ndarray,
    g: np.ndarray,
    rate: float,
    floor: np.ndarray,
    slope: np.ndarray,
) -> None:
    """Write -P (g + W^T (R - R_0) r) (p), R as in ``fit``."""
    m, p = W.shape
    work, L = np.empty((3, max(m, p))), np.empty((m, m))
    gradient, x, P_w = work[0], work[1], work[2]
    for k in range(p):
        gradient[k] = g[k]
    for i in range(m if rate > 0.0 else 0):  # W P W^T + diag(floor) = L L^T, L x = r
        for k in range(p):
            P_w[k] = 0.0
            for t in range(p):
                P_w[k] += P[k, t] * W[i, t]
        for j in range(i + 1):
            y = floor[i % len(floor)] if i == j else 0.0
            for k in range(p):
                y += W[j, k] * P_w[k]
            for t in range(j):
                y -= L[i, t] * L[j, t]
            L[i, j] = math.sqrt(y) if i == j else y / L[j, j]
        x[i] = r[i]
        for t in range(i):
            x[i] -= L[i, t] * x[t]
        x[i] /= L[i, i]
    for i in range(m - 1 if rate > 0.0 else -1, -1, -1):  # rate L^-T x = R r
        for t in range(i + 1, m):
            x[i] -= L[t, i] * x[t]
        x[i] /= L[i, i]
        y = rate * x[i]
        for j in range(m):
            y -= R_0[i, j] * r[j]
        for k in range(p):
            gradient[k] += W[i, k] * y
    for i in range(p):
        slope[i] = 0.0
        for j in range(p):
            slope[i] -= P[i, j] * gradient[j]


@compiled(
    "void(f8[:], f8[:,:], f8[:,:], f8[:], f8[:,:], f8[:], f8, f8[:], f8, f8[:,:], f8, f8[:], "
    "f8[:,:])",
    fills=2,
    allocates=True,
)
def fit(
    a: np.ndarray,
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
    after: np.ndarray,
    gain: np.ndarray,
) -> None:
    """Write a - dt P_1 (g + W^T (R - R_0) r) (p) and (kept P_1^-1 + (1 - kept) prior)^-1 (p, p).

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
                after[k] = 0.0  # P W^T, column by column
                for t in range(p):
                    after[k] += P[k, t] * W[i, t]
            for j in range(m):
                R[i, j] = floor[i % len(floor)] if i == j else 0.0
                for k in range(p):
                    R[i, j] += W[j, k] * after[k]
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
        after[k] = a[k]
        for t in range(p):
            after[k] -= dt * gain[k, t] * gradient[t]
    for k in range(p):
        for t in range(p):
            gain[k, t] = kept * information[k, t] + (1.0 - kept) * prior[k, t]
    invert(gain)


@compiled("void(f8[:], f8[:], f8, f8, f8[:])", allocates=True)
def follow_geodesic_of_bodies(
    a: np.ndarray, g: np.ndarray, h: float, most: float, after: np.ndarray
) -> None:
    """Write P+ = exp(-h P L) P of every body's pseudo-inertia (10 k), as ``follow_geodesic``.

    P = [[tr(I)/2 1 - I, mc], [mc^T, m]] and L = [[tr(G) 1 - G, g_mc/2], [g_mc^T/2, g_m]], G the
    matrix of g_I with its entries off the diagonal halved, for which tr(L P(da)) = g . da.
    """
    bodies, square = len(a) // 10, 0.0
    L, E, work = np.empty((4, 4)), np.empty((4, 4)), np.empty((2, bodies, 4, 4))
    P, A = work[0], work[1]  # P and P L
    for b in range(bodies):
        i = 10 * b
        xx, yy, zz = a[i + 4], a[i + 6], a[i + 9]
        half = 0.5 * (xx + yy + zz)
        P[b, 0, 0], P[b, 1, 1], P[b, 2, 2] = half - xx, half - yy, half - zz
        P[b, 1, 0], P[b, 2, 0], P[b, 2, 1] = -a[i + 5], -a[i + 7], -a[i + 8]
        P[b, 3, 0], P[b, 3, 1], P[b, 3, 2] = a[i + 1], a[i + 2], a[i + 3]
        P[b, 3, 3] = a[i]
        xx, yy, zz = g[i + 4], g[i + 6], g[i + 9]
        L[0, 0], L[1, 1], L[2, 2] = yy + zz, xx + zz, xx + yy
        L[1, 0], L[2, 0], L[2, 1] = -0.5 * g[i + 5], -0.5 * g[i + 7], -0.5 * g[i + 8]
        L[3, 0], L[3, 1], L[3, 2] = 0.5 * g[i + 1], 0.5 * g[i + 2], 0.5 * g[i + 3]
        L[3, 3] = g[i]
        for r in range(4):
            for s in range(r):
                P[b, s, r], L[s, r] = P[b, r, s], L[r, s]
        for r in range(4):
            for s in range(4):
                x = 0.0
                for t in range(4):
                    x += P[b, r, t] * L[t, s]
                A[b, r, s] = x
        for r in range(4):
            for s in range(4):
                square += A[b, r, s] * A[b, s, r]  # tr(P L P L)
    length = h * math.sqrt(abs(square))
    z = 0.5 * h * (most / length if length > most else 1.0)
    for b in range(bodies):
        for r in range(4):
            for s in range(4):
                x = 0.0
                for t in range(4):
                    x += A[b, r, t] * A[b, t, s]
                E[r, s] = (1.0 if r == s else 0.0) - z * A[b, r, s] + 0.5 * z * z * x
        for r in range(4):
            for s in range(4):
                x = 0.0
                for t in range(4):
                    x += E[r, t] * P[b, t, s]
                L[r, s] = x
        for r in range(4):
            for s in range(r + 1):
                x = 0.0
                for t in range(4):
                    x += L[r, t] * E[s, t]
                P[b, r, s] = P[b, s, r] = x
        i = 10 * b
        xx, yy, zz = P[b, 0, 0], P[b, 1, 1], P[b, 2, 2]
        after[i] = P[b, 3, 3]
        after[i + 1], after[i + 2], after[i + 3] = P[b, 3, 0], P[b, 3, 1], P[b, 3, 2]
        after[i + 4], after[i + 6], after[i + 9] = yy + zz, xx + zz, xx + yy
        after[i + 5], after[i + 7], after[i + 8] = -P[b, 1, 0], -P[b, 2, 0], -P[b, 2, 1]


@compiled("void(f8[:], f8[:], f8[:,::1], f8[:,::1])", allocates=True)
def gain_of_bodies_times(
    a: np.ndarray, gamma: np.ndarray, X: np.ndarray, product: np.ndarray
) -> None:
    """Write Gamma X (10 k, l): gamma_b P L P of every body, as ``follow_geodesic_of_bodies``."""
    work, g, Gamma = np.empty((3, 4, 4)), np.empty(10), np.empty((10, 10))
    P, L, A = work[0], work[1], work[2]
    for b in range(len(gamma)):
        i = 10 * b
        half = 0.5 * (a[i + 4] + a[i + 6] + a[i + 9])
        P[0, 0], P[1, 1], P[2, 2] = half - a[i + 4], half - a[i + 6], half - a[i + 9]
        P[1, 0], P[2, 0], P[2, 1] = -a[i + 5], -a[i + 7], -a[i + 8]
        P[3, 0], P[3, 1], P[3, 2], P[3, 3] = a[i + 1], a[i + 2], a[i + 3], a[i]
        for r in range(4):
            for s in range(r):
                P[s, r] = P[r, s]
        for k in range(10):  # column k of Gamma_b
            for r in range(10):
                g[r] = 0.0
            g[k] = 1.0
            L[0, 0], L[1, 1], L[2, 2] = g[6] + g[9], g[4] + g[9], g[4] + g[6]
            L[1, 0], L[2, 0], L[2, 1] = -0.5 * g[5], -0.5 * g[7], -0.5 * g[8]
            L[3, 0], L[3, 1], L[3, 2], L[3, 3] = 0.5 * g[1], 0.5 * g[2], 0.5 * g[3], g[0]
            for r in range(4):
                for s in range(r):
                    L[s, r] = L[r, s]
            for r in range(4):
                for s in range(4):
                    A[r, s] = 0.0
                    for t in range(4):
                        A[r, s] += P[r, t] * L[t, s]
            for r in range(4):
                for s in range(r + 1):
                    x = 0.0
                    for t in range(4):
                        x += A[r, t] * P[t, s]
                    L[r, s] = gamma[b] * x
            xx, yy, zz = L[0, 0], L[1, 1], L[2, 2]
            Gamma[4, k], Gamma[6, k], Gamma[9, k] = yy + zz, xx + zz, xx + yy
            Gamma[5, k], Gamma[7, k], Gamma[8, k] = -L[1, 0], -L[2, 0], -L[2, 1]
            Gamma[1, k], Gamma[2, k], Gamma[3, k], Gamma[0, k] = L[3, 0], L[3, 1], L[3, 2], L[3, 3]
        for r in range(10):
            for j in range(X.shape[1]):
                product[i + r, j] = 0.0
            for k in range(10):
                factor = Gamma[r, k]
                for j in range(X.shape[1]):
                    product[i + r, j] += factor * X[i + k, j]
