"""Least squares on the prediction error, with forgetting, and the weights of prediction errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import MOST_PARAMETERS, definite_matrix, flag, numbers, positive, whole
from .._kernels import estimates as kernels
from ..exceptions import GainError
from .adaptation import Adaptation, Drive, Estimate, positive_numbers


class PredictionWeight:
    """R of a prediction error r: constant, or such that the error decays at one rate.

    With R = rate (W Gamma W^T + diag(floor))^-1 it is dr/dt = -rate r + (terms in dW/dt): every row
    of the error decays at the same rate, whatever its units. The floor limits the weight of rows
    with little excitation; where the gain Gamma has become small, R tends to the constant weight
    rate diag(floor)^-1.

    Attributes:
        constant: (n, n) or (n) or a number, or None.
        rate: [1/s], or zero. With neither the weight is that of the drive.
        floor: a positive number, or one per row, in units of W Gamma W^T.
    """

    def __init__(self, weight: ArrayLike | None, rate: float | None, floor: ArrayLike) -> None:
        """Choose a constant weight, or a rate [1/s] with its floor.

        Raises:
            GainError: numbers that are not positive (definite).
        """
        self.constant = None
        self.rate = 0.0
        self.floor = np.ones(1)
        if weight is not None:
            self.constant = numbers(weight, "weight", error=GainError)
            definite_matrix(self.constant, len(np.atleast_1d(self.constant)), "weight")
        if rate is not None:
            self.rate = positive(rate, "prediction_rate")
            self.floor = np.atleast_1d(positive_numbers(floor, "floor"))

    def at(self, drive: Drive, times_Gamma: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Return R (n, n) for a drive with W (n, p), by a function that multiplies by Gamma."""
        W = drive.W
        constant = self.constant
        assert W is not None
        if self.rate:
            S = W.dot(times_Gamma(W.T))
            S.flat[:: len(W) + 1] += self.floor
            R = self.rate * np.linalg.inv(S)
            return 0.5 * (R + R.T)
        if constant is None:
            return np.zeros((len(W), len(W))) if drive.weight is None else drive.weight
        return constant if constant.ndim == 2 else np.diag(np.broadcast_to(constant, len(W)))


class LeastSquares(Adaptation):
    """da/dt = -P (Y^T e + W^T R r), dP^-1/dt = W^T R W - F, r = W a - y, F the forgetting.

    The information P^-1 grows in directions that the motion excites, and is forgotten:

        F = lambda P^-1, lambda(t) = lambda_0 (1 - |P|)         bounded-gain forgetting (default)
        F = lambda_0 (P^-1 - P(0)^-1)                           directional

    |P| is the largest eigenvalue of P relative to P(0). The first is that of Slotine and Li (1989),
    whose k_0 is 1 in these units; if the motion leaves one combination of parameters unexcited,
    |P| = 1 and nothing is forgotten. The second is an exponential resetting in the manner of
    Salgado, Goodwin and Middleton (1988), in which each direction forgets on its own; it is what
    ``make_controller`` takes, as ten parameters per body are never all excited. Both keep
    P <= P(0), so that estimates can follow parameters that change.

    V:          the adaptation's part is da^T P^-1 da / 2. dV/dt changes by
                -r^T R r / 2 - da^T F da / 2 <= 0, an equality for every R >= 0, which may change
                with time. If the drive already has a weight R_0, so that the law's dV/dt contains
                -r^T R_0 r, it changes by -r^T (R - R_0) r + r^T R r / 2 - da^T F da / 2. Under
                persistent excitation of all parameters P^-1 is bounded and F does not vanish; then
                tracking and parameter errors converge to zero exponentially.
    Memory:     P^-1.
    Step:       recursive least squares, P+^-1 = P^-1 + dt W^T R W and a+ = a - dt P+ g, then the
                forgetting by its exact solution. P stays positive definite and bounded for any dt.
    Limits:     bodies may become unphysical, and coefficients negative.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519; M. Salgado, G. Goodwin, R. Middleton, *Modified least squares algorithm incorporating
    exponential resetting and forgetting*, Int. J. Control 47 (1988) 477-491.

    Attributes:
        P_0: (p, p) the gain at the start, symmetric, positive definite.
        forgetting: lambda_0 [1/s].
        directional: whether each direction forgets on its own.
        torque_bandwidth: bandwidth of the low pass [1/s]; None where the law's own drive has the
            prediction error, of the position or velocity of the frame.
        unit: the parameters' covariance before any data is about ``unit`` P(0): P(0) is the rate of
            a loop. The start with information H of other data is (P(0)^-1 + unit H)^-1.
    """

    name = "least-squares"
    sources: tuple[str, ...] = ("SlotineLi1989",)

    def __init__(
        self,
        P_0: ArrayLike,
        size: int,
        bandwidth: float | None = None,
        *,
        weight: ArrayLike | None = 1.0,
        rate: float | None = None,
        floor: ArrayLike = 0.0,
        forgetting: float = 1.0,
        directional: bool = False,
        unit: float = 1.0,
    ) -> None:
        """Choose gain, weight and forgetting for p = ``size`` parameters.

        Args:
            P_0: the gain at the start, which is also its bound: a number, p numbers or (p, p).
            size: p.
            bandwidth: of the low pass on torque and regressor [1/s]; None: the law's drive has a
                prediction error.
            weight: R, a number, l numbers or (l, l), in 1/s over the square of the predicted unit;
                None: that of the law's drive.
            rate: [1/s] at which the prediction error decays, instead of a weight: see
                ``PredictionWeight``, with Gamma = P.
            floor: with a rate: a positive number or l of them, in units of W P W^T.
            forgetting: lambda_0 [1/s]; zero forgets nothing.
            directional: whether each direction forgets on its own.
            unit: of P, see the attribute.

        Raises:
            GainError: gains that are not positive (definite), or of another size.
        """
        size = whole(size, "size", 0, most=MOST_PARAMETERS)
        self.P_0 = np.ascontiguousarray(definite_matrix(P_0, size, "gamma_d"))
        self._prior = np.linalg.inv(self.P_0)
        self._root = np.linalg.cholesky(self.P_0)
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self.directional = flag(directional, "directional")
        self.unit = positive(unit, "unit")
        if self.directional:
            self.sources = (*self.sources, "SalgadoGoodwinMiddleton1988")
        self._weight = PredictionWeight(weight if rate is None else None, rate, floor)
        if bandwidth is not None:
            self.torque_bandwidth = positive(bandwidth, "prediction_filter")
            if weight is None and rate is None:
                raise GainError("a torque's error needs a weight or a rate.", where="weight")

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the estimate to start from, with P(0), or (P(0)^-1 + unit H)^-1."""
        H = self._prior if information is None else self._prior + self.unit * information
        return Estimate(value, (H,))

    def weight(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return R (l, l) for a drive with a prediction error."""
        return self._weight.at(drive, partial(self.gain_times, estimate))

    def size(self, information: np.ndarray) -> float:
        """Return |P|, the largest eigenvalue of P relative to P(0), for P^-1 (p, p)."""
        if not information.size:
            return 0.0
        least = np.linalg.eigvalsh(self._root.T @ information @ self._root)[0]
        return 1.0 / max(least, 1.0)  # below one is rounding

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p) and dP^-1/dt, which is zero without a prediction error."""
        information = self._information(estimate)
        W = drive.W
        value = self.value_rate(estimate, drive)
        if W is None:
            return Estimate(value, (np.zeros(information.shape),))
        learned = W.T.dot(self.weight(estimate, drive)).dot(W)
        return Estimate(value, (learned - self._forgotten(information),))

    def value_rate(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return da/dt (p)."""
        return self._moved(estimate, drive, 0.0)[0]

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        if drive.W is None:
            return Estimate(estimate.value + dt * self.value_rate(estimate, drive), estimate.memory)
        kept = math.exp(-self.forgetting * dt)
        restored = 1.0 - kept
        if not self.directional:  # d|P|/dt = lambda_0 (1 - |P|) |P|
            size = self.size(self._information(estimate))
            kept = size + (1.0 - size) * kept
            restored = 0.0
        rate, information = self._moved(estimate, drive, dt, kept, restored)
        value = empty(rate.size)
        kernels.advance(estimate.value, rate, dt, value)
        return Estimate(value, (information,))

    def _moved(
        self,
        estimate: Estimate,
        drive: Drive,
        dt: float,
        kept: float = 1.0,
        restored: float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean of da/dt (p) over dt [s], and P^-1 (p, p) after it.

        Of P^-1 the share ``kept`` is left, and the share ``restored`` of P(0)^-1 is added.
        """
        information = self._information(estimate)
        W = drive.W
        r = drive.residual
        if W is None or r is None:
            W = empty((0, len(information)))
            r = empty(0)
        elif not self._weight.rate:
            drive = drive.weighted(self.weight(estimate, drive))
        R = np.zeros((len(W), len(W))) if drive.weight is None else drive.weight
        rate = empty(len(information))
        after = empty(information.shape)
        kernels.fit(
            information, W, r, R, drive.gradient, self._weight.rate, self._weight.floor,
            dt, kept, restored, self._prior, rate, after,
        )  # fmt: skip
        return rate, after

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float:
        """Return da^T P^-1 da / 2."""
        error = estimate.value - truth
        return 0.5 * error @ self._information(estimate) @ error

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -r^T (R - R_0) r + r^T R r / 2 - da^T F da / 2, R_0 the weight of the drive."""
        if drive.W is None:
            return 0.0
        error = estimate.value - truth
        R = self.weight(estimate, drive)
        predicted = drive.W.dot(error)
        beyond = R if drive.weight is None else R - drive.weight
        learned = predicted @ beyond @ drive.residual - 0.5 * predicted @ R @ predicted
        forgotten = error @ self._forgotten(self._information(estimate)) @ error
        return -learned - 0.5 * max(forgotten, 0.0)  # below zero is rounding

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return P X (p, l)."""
        return np.linalg.solve(self._information(estimate), X)

    def _information(self, estimate: Estimate) -> np.ndarray:
        """Return P^-1 (p, p)."""
        return estimate.memory[0] if estimate.memory else self._prior

    def _forgotten(self, information: np.ndarray) -> np.ndarray:
        """Return F (p, p) where P^-1 is the information."""
        if self.directional:
            return self.forgetting * (information - self._prior)
        return self.forgetting * (1.0 - self.size(information)) * information
