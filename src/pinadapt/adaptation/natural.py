"""Natural adaptation: the gradient in the log-det metric of a cone of positive definite matrices.

T. Lee, J. Kwon, F. C. Park, *A natural adaptive control law for robot manipulators*, IROS 2018; P.
M. Wensing and J.-J. Slotine, *Beyond convexity - contraction and global convergence of gradient
descent*, PLoS ONE 2020.
"""

from __future__ import annotations

import math

import numpy as np

from .._checks import positive
from .._compiled import compiled
from .adaptation import Adaptation
from .matrix_inequality import MatrixInequality

_LARGEST_STEP = 0.02
_ONE_TERM = 0.003


class Natural(Adaptation):
    """dP/dt = -gamma P L P, with tr(L P(da)) = g . da, and V's part sum of log|P|/|P_true| + tr(P^-1 P_true) - n, over gamma.

    The estimate stays inside the cone for every step length: in a complete cone it moves along the
    geodesic P+ = S exp(-h gamma S^T L S) S^T, P = S S^T; in others by a step that never leaves the
    Dikin ellipsoid of log det. One sample moves it by at most 0.02 in the log-det metric, so by two
    per cent in any direction (at 1 kHz, 20 a second): a sampled signal that asks for more, at a
    start far from the path for example, is no longer the one of the continuous-time proof, and
    following it would blow the estimate up between two measurements. ``rate`` is not limited.

    Attributes:
        cone: where the parameters live.
        gamma: the one gain.
    """

    name = "natural"

    def __init__(self, gamma: float, cone: MatrixInequality, name: str = "gamma_d") -> None:
        """Take the gain and the cone.

        Raises:
            GainError: gamma not positive.
        """
        self.gamma, self.cone = positive(gamma, name), cone

    def admit(self, a: np.ndarray) -> np.ndarray:
        """Return an initial estimate inside the cone; see ``MatrixInequality.admit``."""
        return self.cone.admit(a)

    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return da/dt (p)."""
        P = self.cone.matrices(a)
        if self.cone.complete:
            return -self.gamma * self.cone.components(P @ self.cone.covectors(g) @ P)
        return -self.gamma * np.linalg.solve(self._metric(P[0]), g)

    def advance(self, a: np.ndarray, g: np.ndarray, dt: float) -> np.ndarray:
        """Return the estimate (p) after dt [s] with g held; inside the cone for any dt."""
        if self.cone.complete:
            after = np.empty(a.size)
            _follow_geodesic(a, g, self.gamma * dt, *self.cone.tables, after)
            return after
        metric = self._metric(self.cone.matrices(a)[0])
        step = (-self.gamma * dt) * np.linalg.solve(metric, g)
        length = np.sqrt(step @ metric @ step)
        return a + step * min(1.0, _LARGEST_STEP / length if length else 1.0)

    def distance(self, a: np.ndarray, a_true: np.ndarray) -> float | None:
        """Return the log-det divergence from the truth over gamma; None if the truth itself is outside the cone."""
        if not np.isfinite(a).all() or not self.cone.contains(a_true) or not self.cone.contains(a):
            return None
        P, P_true = self.cone.matrices(a), self.cone.matrices(a_true)
        try:
            trace = np.trace(np.linalg.solve(P, P_true), axis1=1, axis2=2)
        except np.linalg.LinAlgError:  # inside the cone by less than rounding
            return None
        logs = np.linalg.slogdet(P)[1] - np.linalg.slogdet(P_true)[1]
        return float(np.sum(logs + trace - P.shape[1]) / self.gamma)

    def _metric(self, P: np.ndarray) -> np.ndarray:
        """Return the Hessian of -log det, H_ij = tr(P^-1 F_i P^-1 F_j) (p, p), of a one-block cone."""
        G = np.linalg.solve(P, self.cone.F)
        return np.einsum("iab,jba->ij", G, G)


@compiled("void(f8[:], f8[:], f8, f8[:,:], i8[:,::1], f8[::1], f8[::1], f8[:])")
def _follow_geodesic(
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
    if length > _LARGEST_STEP:
        h *= _LARGEST_STEP / length
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
