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
        """Return the estimate (p) after dt [s] with g held; inside the cone for any dt."""
        P = self.cone.matrices(a)
        if self.cone.complete:
            return self.cone.parameters(_geodesic(P, (dt * self.gamma) * self.cone.covectors(g)))
        metric = self._metric(P[0])
        step = -dt * self.gamma * np.linalg.solve(metric, g)
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


def _geodesic(P: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return S exp(-S^T X S) S^T = exp(-P X) P for P = S S^T (k, n, n), X symmetric (k, n, n), at most _LARGEST_STEP long.

    So short a step needs one or two terms of the series to be right to 5e-6, and stays positive definite.
    """
    A = P @ X
    length = math.sqrt(abs(A.ravel().dot(A.transpose(0, 2, 1).ravel())))  # tr(A A) is the squared norm of S^T X S
    if length > _LARGEST_STEP:
        A *= _LARGEST_STEP / length
    R = P if length < _ONE_TERM else P - 0.5 * (A @ P)
    return P - A @ R
