"""Natural adaptation: the gradient in the log-det metric of a cone of positive definite matrices.

T. Lee, J. Kwon, F. C. Park, *A natural adaptive control law for robot manipulators*, IROS 2018; P. M. Wensing and
J.-J. Slotine, *Beyond convexity - contraction and global convergence of gradient descent*, PLoS ONE 2020.
"""

from __future__ import annotations

import math

import numpy as np

from .._checks import positive
from .adaptation import Adaptation
from .cone import Cone

_LARGEST_STEP = 0.02
_ONE_TERM = 0.003


class Natural(Adaptation):
    """dP/dt = -gamma P L P, with tr(L P(da)) = g . da, and V's part sum of log|P|/|P_true| + tr(P^-1 P_true) - n, over gamma.

    The estimate stays inside the cone for every step length: in a complete cone it moves along the geodesic
    P+ = S exp(-h gamma S^T L S) S^T, P = S S^T; in others by a step that never leaves the Dikin ellipsoid of log det. One
    sample moves it by at most 0.02 in the log-det metric, so by two per cent in any direction (at 1 kHz, 20 a second): a
    sampled signal that asks for more, at a start far from the path for example, is no longer the one of the continuous-time
    proof, and following it would blow the estimate up between two measurements. ``rate`` is not limited.

    Attributes:
        cone: where the parameters live.
        gamma: the one gain.
    """

    name = "natural"

    def __init__(self, gamma: float, cone: Cone, name: str = "gamma_d") -> None:
        """Take the gain and the cone.

        Raises:
            GainError: gamma not positive.
        """
        self.gamma, self.cone = positive(gamma, name), cone

    def admit(self, a: np.ndarray) -> np.ndarray:
        """Return an initial estimate inside the cone; see ``Cone.admit``."""
        return self.cone.admit(a)

    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return da/dt (p)."""
        P = self.cone.matrices(a)
        if self.cone.complete:
            return -self.gamma * self.cone.components(P @ self.cone.covectors(g) @ P)
        return -self.gamma * np.linalg.solve(self._metric(P[0]), g)

    def advance(self, a: np.ndarray, g: np.ndarray, dt: float) -> np.ndarray:
        """Return the estimate (p) after dt [s] with g held; inside the cone for any dt.

        In a complete cone P+ = exp(-h P L) P with h = gamma dt, so short that one or two terms of the series are right to
        5e-6 of P and stay positive definite; tr(L P L P), which is |S^T L S|^2, measures its length.
        """
        P, h = self.cone.matrices(a), self.gamma * dt
        if self.cone.complete:
            L = self.cone.covectors(g)
            A = P @ L
            change = A @ P
            length = h * math.sqrt(abs(np.vdot(L, change)))
            if length > _LARGEST_STEP:
                h *= _LARGEST_STEP / length
            if length > _ONE_TERM:
                change -= (0.5 * h) * (A @ change)
            return a - h * self.cone.components(change)
        metric = self._metric(P[0])
        step = -h * np.linalg.solve(metric, g)
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
