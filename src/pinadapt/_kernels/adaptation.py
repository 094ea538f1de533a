"""Steps of the estimates."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled

LARGEST_STEP = 0.02
_ONE_TERM = 0.003


@compiled("void(f8[:], f8[:], f8[:,:], f8, f8[:])")
def descend(a: np.ndarray, g: np.ndarray, Gamma: np.ndarray, dt: float, after: np.ndarray) -> None:
    """Write a - dt Gamma g (p)."""
    for i in range(len(a)):
        rate = 0.0
        for j in range(len(g)):
            rate -= Gamma[i, j] * g[j]
        after[i] = a[i] + dt * rate


@compiled("b1(f8[:], f8[:], f8[:])", fills=0)
def inside(a: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Tell whether low < a < high in every entry."""
    for i in range(len(a)):
        if not low[i] < a[i] < high[i]:
            return False
    return True


@compiled("void(f8[:], f8[:], f8, f8[:,:], i8[:,::1], f8[::1], f8[::1], f8[:])")
def follow_geodesic(
    a: np.ndarray,
    g: np.ndarray,
    h: float,
    F_0: np.ndarray,
    entries: np.ndarray,
    F: np.ndarray,
    D: np.ndarray,
    after: np.ndarray,
) -> None:
    """Write P+ = exp(-h P L) P of every block of a complete cone as the parameters ``after`` (k p), h = gamma dt.

    It goes so short a way that one or two terms of the series are right to 5e-6 of P and stay
    positive definite; tr(L P L P), which is |S^T L S|^2, measures its length. F_0, entries, F and D
    are the cone's ``tables``.
    """
    n, p = len(F_0), entries[-1, 0] + 1
    k = len(a) // p
    P, L = np.empty((n, n)), np.empty((n, n))
    A, change = np.zeros((k, n, n)), np.zeros((k, n, n))  # P L and P L P
    square = 0.0
    for b in range(k):
        for r in range(n):
            for s in range(n):
                P[r, s], L[r, s] = F_0[r, s], 0.0
        for e in range(len(entries)):  # P = F_0 + sum a_i F_i, L = sum g_i D_i
            i, r, s = b * p + entries[e, 0], entries[e, 1], entries[e, 2]
            P[r, s] += a[i] * F[e]
            L[r, s] += g[i] * D[e]
            P[s, r], L[s, r] = P[r, s], L[r, s]
        for r in range(n):
            for s in range(n):
                for t in range(n):
                    A[b, r, s] += P[r, t] * L[t, s]
        for r in range(n):
            for s in range(r + 1):
                for t in range(n):
                    change[b, r, s] += A[b, r, t] * P[t, s]
                change[b, s, r] = change[b, r, s]
                square += (1.0 if r == s else 2.0) * L[r, s] * change[b, r, s]  # tr(L P L P)
    length = h * math.sqrt(abs(square))
    if length > LARGEST_STEP:
        h *= LARGEST_STEP / length
    second = 0.5 * h if length > _ONE_TERM else 0.0
    for i in range(len(a)):
        after[i] = a[i]
    for b in range(k):
        for r in range(n):
            for s in range(r + 1):
                step = change[b, r, s]  # P - P+ = h (1 - h P L / 2) P L P, symmetric
                if second > 0.0:
                    for t in range(n):
                        step -= second * A[b, r, t] * change[b, t, s]
                P[r, s] = h * step * (1.0 if r == s else 2.0)
        for e in range(len(entries)):
            after[b * p + entries[e, 0]] -= D[e] * P[entries[e, 1], entries[e, 2]]
