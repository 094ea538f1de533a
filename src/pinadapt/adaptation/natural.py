"""Natural adaptation: the gradient in the log-det metric of a cone of positive definite matrices.

T. Lee, J. Kwon, F. C. Park, *A natural adaptive control law for robot manipulators*, IROS 2018; P. M. Wensing and
J.-J. Slotine, *Beyond convexity - contraction and global convergence of gradient descent*, PLoS ONE 2020.
"""

from __future__ import annotations

import numpy as np

from .._checks import positive
from ..exceptions import DivergedError
from .adaptation import Adaptation
from .cone import Cone

_LARGEST_EXPONENT = 300.0  # keeps exp() finite
# Truncated exponential series, innermost divisors first, and the norm up to which each is right to 1e-5 and positive definite.
_SERIES = ((0.003, ()), (0.03, (2.0,)), (0.25, (4.0, 3.0, 2.0)))


class Natural(Adaptation):
    """dP/dt = -gamma P L P, with tr(L P(da)) = g . da, and V's part sum of log|P|/|P_true| + tr(P^-1 P_true) - n, over gamma.

    The estimate stays inside the cone for every step length: in a complete cone it moves along the geodesic
    P+ = S exp(-h gamma S^T L S) S^T, P = S S^T; in others by a step that never leaves the Dikin ellipsoid of log det.

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
        return a + step / (1.0 + np.sqrt(step @ metric @ step))

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
    """Return S exp(-S^T X S) S^T = exp(-P X) P for P = S S^T (k, n, n), X symmetric (k, n, n)."""
    A = P @ X
    flat = A.ravel()
    squared_norm = flat.dot(flat)
    for bound, terms in _SERIES:
        if squared_norm < bound * bound:
            R = P
            for k in terms:
                R = P - A @ R / k
            return P - A @ R
    try:
        S = np.linalg.cholesky(P)
        eigenvalues, U = np.linalg.eigh(S.transpose(0, 2, 1) @ X @ S)
    except np.linalg.LinAlgError as error:
        raise DivergedError("an estimate reached the edge of its cone to rounding; lower gamma_d.") from error
    SU = S @ U
    return (SU * np.exp(-np.clip(eigenvalues, -_LARGEST_EXPONENT, _LARGEST_EXPONENT))[:, None, :]) @ SU.transpose(0, 2, 1)
