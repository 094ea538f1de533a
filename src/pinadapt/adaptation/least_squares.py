"""Least squares on the prediction error, with a gain that forgets and stays bounded."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix, positive, whole
from ..bibliography import SLOTINE_LI_COMPOSITE
from .adaptation import Adaptation
from .drive import Drive, Estimate
from .weight import checked_weight, weight_of


class LeastSquares(Adaptation):
    """da/dt = -P (Y^T e + W^T R r), dP/dt = lambda(t) P - P W^T R W P, r = W a - y.

    The gain P falls where the motion tells of the parameters, and forgets: lambda(t) = lambda_0
    (1 - |P|), |P| the largest eigenvalue of P relative to P(0). That is the bounded-gain forgetting
    of J.-J. Slotine and W. Li, *Composite adaptive control of robot manipulators*, Automatica 25
    (1989) 509-519, whose k_0 is 1 in these units: lambda >= 0, so P <= P(0) always, and estimates
    follow parameters that change.

    V's part is da^T P^-1 da / 2; dV/dt gains -r^T R r / 2 - lambda da^T P^-1 da / 2 <= 0, an
    equality. With a motion that tells of all parameters P^-1 is bounded and lambda is not zero:
    then tracking and parameter errors vanish exponentially.

    A step is that of recursive least squares, P+ = (P^-1 + dt W^T R W)^-1 and a+ = a - dt P+ g,
    then the forgetting by its own solution: P stays positive definite and bounded for any dt.

    Nothing keeps bodies physical or coefficients positive. A step takes an eigenvalue problem of
    the number of parameters, so some tenths of a millisecond for ninety.

    Attributes:
        P_0: (p, p) the gain at the start, symmetric, positive definite.
        forgetting: lambda_0 [1/s].
        prediction: bandwidth of the low pass [1/s].
    """

    name = "least-squares"
    sources = (SLOTINE_LI_COMPOSITE,)

    def __init__(
        self,
        P_0: ArrayLike,
        size: int,
        bandwidth: float,
        *,
        weight: ArrayLike = 1.0,
        forgetting: float = 1.0,
    ) -> None:
        """Take P(0) as a scalar, p numbers or a matrix, for p = ``size`` parameters.

        Args:
            P_0: the gain at the start, which is also its bound.
            size: p.
            bandwidth: of the low pass on torque and regressor [1/s].
            weight: R, a number, n numbers or (n, n), in 1 / (s (N m)^2) or 1 / (s N^2).
            forgetting: lambda_0 [1/s]; zero forgets nothing.

        Raises:
            GainError: gains that are not positive (definite), or of another size.
        """
        self.P_0 = np.ascontiguousarray(definite_matrix(P_0, whole(size, "size", 0), "gamma_d"))
        self._whiten = np.linalg.inv(np.linalg.cholesky(self.P_0))
        self.prediction = positive(bandwidth, "prediction_filter")
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self._weight = checked_weight(weight)

    def init(self, value: np.ndarray) -> Estimate:
        """Return the estimate to start from, with P(0)."""
        return Estimate(super().init(value).value, (self.P_0.copy(),))

    def weight(self, n: int) -> np.ndarray:
        """Return R (n, n) of n joints."""
        return weight_of(self._weight, n)

    def size(self, P: np.ndarray) -> float:
        """Return |P|, the largest eigenvalue of P (p, p) relative to P(0)."""
        if not np.isfinite(P).all() or not P.size:
            return math.inf if P.size else 0.0
        largest = float(np.linalg.eigvalsh(self._whiten @ P @ self._whiten.T)[-1])
        return min(largest, 1.0)  # more is rounding

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p) and dP/dt; without a prediction P rests."""
        P, W = self._gain(estimate), drive.W
        if W is None:
            return Estimate(-P.dot(drive.gradient), (np.zeros(P.shape),))
        R, P_W = self.weight(len(W)), P.dot(W.T)
        forgotten = self.forgetting * (1.0 - self.size(P)) * P
        learned = P_W.dot(R).dot(P_W.T)
        return Estimate(-P.dot(drive.weighted(R).gradient), (forgotten - learned,))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        P, W = self._gain(estimate), drive.W
        if W is None:
            return Estimate(estimate.value - dt * P.dot(drive.gradient), (P,))
        R = self.weight(len(W))
        drive = drive.weighted(R)
        P_W, size = P.dot(W.T), self.size(P)
        S = np.linalg.inv(dt * R) + W.dot(P_W)
        after = P - P_W.dot(np.linalg.solve(S, P_W.T))
        after = 0.5 * (after + after.T)
        value = estimate.value - dt * after.dot(drive.gradient)
        # d|P|/dt = lambda_0 (1 - |P|) |P| is solved by |P| / (|P| + (1 - |P|) exp(-lambda_0 t))
        return Estimate(value, (after / (size + (1.0 - size) * math.exp(-self.forgetting * dt)),))

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float:
        """Return da^T P(0)^-1 da / 2."""
        return self._energy(self.P_0, value - truth)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float:
        """Return da^T P^-1 da / 2."""
        return self._energy(self._gain(estimate), estimate.value - truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -r^T R r / 2 - lambda da^T P^-1 da / 2."""
        if drive.W is None:
            return 0.0
        P, error = self._gain(estimate), estimate.value - truth
        predicted, R = drive.W.dot(error), self.weight(len(drive.W))
        learned = predicted @ R @ drive.residual - 0.5 * predicted @ R @ predicted
        forgotten = self.forgetting * (1.0 - self.size(P)) * self._energy(P, error)
        return float(-learned - forgotten)

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return P(0) (p, p)."""
        return self.P_0

    def _gain(self, estimate: Estimate) -> np.ndarray:
        """Return P (p, p)."""
        return estimate.memory[0] if estimate.memory else self.P_0

    @staticmethod
    def _energy(P: np.ndarray, error: np.ndarray) -> float:
        return float(0.5 * error @ np.linalg.solve(P, error))
