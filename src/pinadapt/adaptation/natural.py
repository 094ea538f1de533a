"""Natural adaptation: the gradient in the log-det metric of a cone of positive definite matrices.

T. Lee, J. Kwon, F. C. Park, *A natural adaptive control law for robot manipulators*, IROS 2018; P.
M. Wensing and J.-J. Slotine, *Beyond convexity - contraction and global convergence of gradient
descent*, PLoS ONE 2020.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import instance, positive, vector
from .._kernels import adaptation as kernels
from ..bibliography import LEE_KWON_PARK, WENSING_SLOTINE
from ..exceptions import InputError
from ..records import named
from .adaptation import Adaptation
from .drive import Drive, Estimate
from .matrix_inequality import MatrixInequality


class Natural(Adaptation):
    """dP/dt = -gamma P L P, with tr(L P(da)) = g . da.

    Its part of V is the sum of log|P| / |P_true| + tr(P^-1 P_true) - n over gamma. Bodies may have
    shares c: dP/dt = -gamma c P L P, and c divides their term.

    The estimate stays inside the cone for every step length: in a complete cone it moves along the
    geodesic P+ = S exp(-h gamma S^T L S) S^T, P = S S^T; in others by a step that never leaves the
    Dikin ellipsoid of log det. One sample moves it by at most 0.02 in the log-det metric, so by two
    per cent in any direction (at 1 kHz, 20 a second): a sampled signal that asks for more, at a
    start far from the path for example, is no longer the one of the continuous-time proof, and
    following it would blow the estimate up between two measurements. ``rate`` is not limited.

    Attributes:
        cone: where the parameters live.
        gamma: the one gain.
        shares: (k) relative rates, one a matrix of the cone, or None where all are one.
    """

    name = "natural"
    sources = (LEE_KWON_PARK, WENSING_SLOTINE)

    def __init__(
        self,
        gamma: float,
        cone: MatrixInequality,
        name: str = "gamma_d",
        *,
        shares: ArrayLike | None = None,
    ) -> None:
        """Take the gain, the cone, and relative rates of its matrices.

        Raises:
            GainError: gamma not positive.
            InputError: no cone, or shares that are not positive, one for each of its matrices.
        """
        self.gamma = positive(gamma, name)
        self.cone = instance(cone, MatrixInequality, "cone")
        self.shares, self._scale = None, None
        if shares is not None:
            self.shares = vector(shares, self.cone.blocks, "shares")
            for share in self.shares:
                positive(share, "shares", error=InputError)
            self._scale = np.repeat(self.shares, self.cone.size // self.cone.blocks)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return an initial value (p) inside the cone; see ``MatrixInequality.validate``."""
        return self.cone.validate(value)

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether a value (p) is inside the cone."""
        return self.cone.contains(value)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p)."""
        a, g, cone = estimate.value, self._scaled(drive.gradient), self.cone
        P = cone.matrices(a)
        if cone.complete:
            return Estimate(-self.gamma * cone.components(P @ cone.covectors(g) @ P))
        return Estimate(-self.gamma * np.linalg.solve(self._metric(P[0]), g))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; inside the cone for any dt."""
        a, g = estimate.value, self._scaled(drive.gradient)
        if self.cone.complete:
            return named(Estimate, (self.cone.follow_geodesic(a, g, self.gamma * dt), ()))
        metric = self._metric(self.cone.matrices(a)[0])
        step = (-self.gamma * dt) * np.linalg.solve(metric, g)
        length = np.sqrt(step @ metric @ step)
        return Estimate(a + step * min(1.0, kernels.LARGEST_STEP / length if length else 1.0))

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), Gamma made of one block a matrix of the cone."""
        cone = self.cone
        P, X = cone.matrices(value), self._scaled(X.T).T
        if not cone.complete:
            return np.asarray(self.gamma * np.linalg.solve(self._metric(P[0]), X))
        rows = X.reshape(cone.blocks, -1, X.shape[1])
        return np.asarray(self.gamma * (cone.metric_inverses(P) @ rows).reshape(X.shape))

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the log-det divergence from the truth over gamma; None outside the cone."""
        cone = self.cone
        if not np.isfinite(value).all() or not cone.contains(truth) or not cone.contains(value):
            return None
        P, P_true = cone.matrices(value), cone.matrices(truth)
        try:
            trace = np.trace(np.linalg.solve(P, P_true), axis1=1, axis2=2)
        except np.linalg.LinAlgError:  # inside the cone by less than rounding
            return None
        logs = np.linalg.slogdet(P)[1] - np.linalg.slogdet(P_true)[1]
        terms = logs + trace - P.shape[1]
        return float(np.sum(terms if self.shares is None else terms / self.shares) / self.gamma)

    def _scaled(self, g: np.ndarray) -> np.ndarray:
        """Return gradients (..., p) with the shares of their bodies."""
        return g if self._scale is None else g * self._scale

    def _metric(self, P: np.ndarray) -> np.ndarray:
        """Return the Hessian of -log det (p, p), H_ij = tr(P^-1 F_i P^-1 F_j), of one block."""
        G = np.linalg.solve(P, self.cone.F)
        return np.einsum("iab,jba->ij", G, G)
