"""Least squares on the prediction error, with bounded-gain forgetting."""

from __future__ import annotations

import math

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import MOST_PARAMETERS, definite_matrix, flag, numbers, positive, whole
from .._kernels import estimates as kernels
from ..exceptions import GainError
from .adaptation import Adaptation, Drive, Estimate

_SMALL = 40  # parameters, up to which loops are faster than LAPACK


def checked_weight(weight: ArrayLike, where: str = "weight") -> np.ndarray:
    """Return a number, n numbers or a matrix (n, n) as an array, checked to be positive definite.

    Raises:
        GainError: it is not.
    """
    given = numbers(weight, where, error=GainError)
    definite_matrix(given, len(np.atleast_1d(given)), where)
    return given


def weight_of(checked: np.ndarray, n: int) -> np.ndarray:
    """Return R (n, n) from what ``checked_weight`` returned."""
    return checked if checked.ndim == 2 else np.diag(np.broadcast_to(checked, n))


class DecayWeight:
    """R = rate (W Gamma W^T + diag(floor))^-1: the prediction error r decays at one rate.

    With it dr/dt = -rate r + (terms in dW/dt): every row of the error decays at the same rate,
    whatever its units. The floor limits the weight of rows with little excitation; where the gain
    Gamma has become small, R tends to the constant weight rate diag(floor)^-1.

    Attributes:
        rate: [1/s].
        floor: a positive number, or one per row, in units of W Gamma W^T.
    """

    def __init__(self, rate: float, floor: ArrayLike) -> None:
        """Choose rate [1/s] and floor.

        Raises:
            GainError: one of them is not positive.
        """
        self.rate = positive(rate, "prediction_rate")
        self.floor = np.atleast_1d(numbers(floor, "floor", error=GainError))
        if not (self.floor > 0.0).all():
            raise GainError("must be positive; at rest only it bounds the weight.", where="floor")

    def at(self, S: np.ndarray) -> np.ndarray:
        """Return R (n, n) where W Gamma W^T is S (n, n)."""
        S = S.copy()
        S.flat[:: len(S) + 1] += self.floor
        R = self.rate * np.linalg.inv(S)
        return np.asarray(0.5 * (R + R.T))


class LeastSquares(Adaptation):
    """da/dt = -P (Y^T e + W^T R r), dP^-1/dt = W^T R W - F, r = W a - y, F the forgetting.

    The gain P decreases in directions that the motion excites, and recovers by forgetting:

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
    Step:       recursive least squares, P+ = (P^-1 + dt W^T R W)^-1 and a+ = a - dt P+ g, then the
                forgetting by its exact solution. P stays positive definite and bounded for any dt.
    Limits:     bodies may become unphysical, and coefficients negative. A step solves an eigenvalue
                problem of size p, which takes some tenths of a millisecond for p = 90.

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
    updates_gain = True

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
                ``DecayWeight``, with Gamma = P.
            floor: with a rate: a positive number or l of them, in units of W P W^T.
            forgetting: lambda_0 [1/s]; zero forgets nothing.
            directional: whether each direction forgets on its own.
            unit: of P, see the attribute.

        Raises:
            GainError: gains that are not positive (definite), or of another size.
        """
        self.P_0 = np.ascontiguousarray(
            definite_matrix(P_0, whole(size, "size", 0, most=MOST_PARAMETERS), "gamma_d")
        )
        self._whiten = np.linalg.inv(np.linalg.cholesky(self.P_0))
        self._prior, self._size = self._whiten.T @ self._whiten, len(self.P_0)  # P(0)^-1
        self._shape = self.P_0.shape
        self.torque_bandwidth = (
            None if bandwidth is None else positive(bandwidth, "prediction_filter")
        )
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self.directional, self.unit = flag(directional, "directional"), positive(unit, "unit")
        if self.directional:
            self.sources = (*self.sources, "SalgadoGoodwinMiddleton1988")
        self._constant = None if weight is None or rate is not None else checked_weight(weight)
        self._decay = None if rate is None else DecayWeight(rate, floor)
        self._rate, self._floor = 0.0, np.ones(1)  # of no weight that decays
        if self._decay is not None:
            self._rate, self._floor = self._decay.rate, self._decay.floor
        if bandwidth is not None and weight is None and rate is None:
            raise GainError(
                "the prediction error of the torque needs a weight or a rate.", where="weight"
            )

    def init(self, value: np.ndarray) -> Estimate:
        """Return the estimate to start from, with P(0)."""
        return Estimate(super().init(value).value, (self.P_0.copy(),))

    def informed(self, estimate: Estimate, H: np.ndarray) -> Estimate:
        """Return the estimate with the gain (P(0)^-1 + unit H)^-1."""
        P = np.linalg.inv(self._prior + self.unit * H)
        return estimate if not H.any() else Estimate(estimate.value, (0.5 * (P + P.T),))

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the estimate at an announced value (p), with P(0) again."""
        return Estimate(value, (self.P_0.copy(),))

    def weight(self, drive: Drive, P: np.ndarray) -> np.ndarray:
        """Return R (l, l) for a drive with a prediction error, at the gain P (p, p)."""
        W, given = drive.W, drive.weight
        assert W is not None
        if self._decay is not None:
            return self._decay.at(W.dot(P).dot(W.T))
        if self._constant is not None:
            return weight_of(self._constant, len(W))
        return np.zeros((len(W), len(W))) if given is None else given

    def _started(self, drive: Drive) -> tuple[np.ndarray, np.ndarray]:
        """Return the weight R_0 (l, l) that the kernels start from, and the gradient (p) with it.

        R_0 is the constant weight, or else that of the drive.
        """
        given, constant = drive.weight, self._constant
        if constant is None and given is not None:
            return given, drive.gradient
        assert drive.W is not None
        m = len(drive.W)
        if constant is None:
            return np.zeros((m, m)), drive.gradient
        R = weight_of(constant, m)
        return R, drive.weighted(R).gradient

    def size(self, P: np.ndarray) -> float:
        """Return |P|, the largest eigenvalue of P (p, p) relative to P(0)."""
        if not np.isfinite(P).all() or not P.size:
            return math.inf if P.size else 0.0
        largest = float(np.linalg.eigvalsh(self._whiten @ P @ self._whiten.T)[-1])
        return min(largest, 1.0)  # above one is rounding

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p) and dP/dt, which is zero without a prediction error."""
        P, W = self._gain(estimate), drive.W
        if W is None:
            return Estimate(-P.dot(drive.gradient), (np.zeros(P.shape),))
        R, P_W = self.weight(drive, P), P.dot(W.T)
        learned = P_W.dot(R).dot(P_W.T)
        return Estimate(-P.dot(drive.weighted(R).gradient), (self._recovery(P) - learned,))

    def value_rate(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return da/dt (p)."""
        P, W, residual = self._gain(estimate), drive.W, drive.residual
        if W is None or residual is None or len(P) > _SMALL:
            return self.rate(estimate, drive).value
        return self._small_step(P, drive, W, residual, 0.0)[0]

    def _small_step(
        self, P: np.ndarray, drive: Drive, W: np.ndarray, residual: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean of da/dt (p) over dt [s], and P (p, p) after it."""
        (R_0, g), slope, gain = self._started(drive), empty(len(P)), empty(self._shape)
        kernels.fit(
            P, W, residual, R_0, g, self._rate, self._floor,
            dt, self._prior, math.exp(-self.forgetting * dt), slope, gain,
        )  # fmt: skip
        return slope, gain

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        P, W, residual = self._gain(estimate), drive.W, drive.residual
        if W is None or residual is None:
            return Estimate(estimate.value - dt * P.dot(drive.gradient), (P,))
        if self.directional and len(P) <= _SMALL:
            slope, gain = self._small_step(P, drive, W, residual, dt)
            return Estimate(estimate.value + dt * slope, (gain,))
        R, P_W = self.weight(drive, P), P.dot(W.T)
        # (P^-1 + dt W^T R W)^-1 by the matrix inversion lemma, for R >= 0
        inner = np.linalg.solve(np.eye(len(R)) + dt * R.dot(W.dot(P_W)), dt * R)
        updated = P - P_W.dot(inner).dot(P_W.T)
        updated = 0.5 * (updated + updated.T)
        value = estimate.value - dt * updated.dot(drive.weighted(R).gradient)
        return Estimate(value, (self._after_forgetting(P, updated, dt),))

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float:
        """Return da^T P(0)^-1 da / 2."""
        return self._energy(self.P_0, value - truth)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float:
        """Return da^T P^-1 da / 2."""
        return self._energy(self._gain(estimate), estimate.value - truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -r^T (R - R_0) r + r^T R r / 2 - da^T F da / 2, R_0 the weight of the drive."""
        if drive.W is None:
            return 0.0
        P, error = self._gain(estimate), estimate.value - truth
        predicted, R = drive.W.dot(error), self.weight(drive, P)
        beyond = R if drive.weight is None else R - drive.weight
        learned = predicted @ beyond @ drive.residual - 0.5 * predicted @ R @ predicted
        in_P = np.linalg.solve(P, error)
        forgotten = max(float(in_P @ self._recovery(P) @ in_P), 0.0)  # below zero is rounding
        return float(-learned - 0.5 * forgotten)

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return P(0) (p, p)."""
        return self.P_0

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return P (p, p)."""
        return self._gain(estimate)

    def _gain(self, estimate: Estimate) -> np.ndarray:
        """Return P (p, p)."""
        if not estimate.memory:
            return self.P_0
        P: np.ndarray = estimate.memory[0]
        return P

    def _recovery(self, P: np.ndarray) -> np.ndarray:
        """Return P F P (p, p), the part of dP/dt by which forgetting restores the gain P (p, p)."""
        if self.directional:
            return self.forgetting * (P - P @ self._prior @ P)
        return self.forgetting * (1.0 - self.size(P)) * P

    def _after_forgetting(self, P: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
        """Return the gain (p, p) after dt [s] of forgetting.

        Args:
            P: (p, p) before the step.
            after: (p, p) updated by the prediction error.
            dt: [s].
        """
        rest = math.exp(-self.forgetting * dt)
        if self.directional:  # P^-1 - P(0)^-1 decays
            mixed = np.linalg.inv(rest * np.linalg.inv(after) + (1.0 - rest) * self._prior)
            return np.asarray(0.5 * (mixed + mixed.T))
        size = self.size(P)  # d|P|/dt = lambda_0 (1 - |P|) |P|
        return after / (size + (1.0 - size) * rest)

    @staticmethod
    def _energy(P: np.ndarray, error: np.ndarray) -> float:
        """Return da^T P^-1 da / 2."""
        return float(0.5 * error @ np.linalg.solve(P, error))
