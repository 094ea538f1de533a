"""Composite adaptation: tracking error and prediction error of the torque together.

``Composite`` uses the prediction error of the present, ``CompositeMemory`` that of all past data.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from ..exceptions import GainError
from .adaptation import Adaptation, Drive, Estimate, Wrapper
from .least_squares import DecayWeight, checked_weight, weight_of

# name of the inner adaptation -> name of the wrapped one
_COMPOSITE = {"gradient": "composite", "natural": "natural-composite"}
_WITH_MEMORY = {"gradient": "composite-memory", "natural": "natural-memory"}


class Composite(Wrapper):
    """da/dt = -Gamma (Y^T e + W^T R r), r = W a - y, Gamma that of any adaptation.

    W and y are the filtered regressor and torque of the joints; see ``FilteredRegressor``. For the
    true parameters W a = y, hence r = W da for any tracking error, and adaptation continues when
    the tracking error has vanished.

    V:          dV/dt changes by -r^T R r <= 0, an equality for every R >= 0, which may change with
                time, in the metric of any inner adaptation. Under natural adaptation the estimate
                stays in its cone.
    Weight:     constant, as published, or R = rate (W Gamma W^T + diag(floor))^-1; see
                ``DecayWeight``.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519, with a constant Gamma; with natural adaptation it is the same gradient in its metric.

    Attributes:
        inner: the wrapped adaptation, of all dynamic parameters.
        torque_bandwidth: bandwidth of the low pass [1/s].
    """

    sources: tuple[str, ...] = ("SlotineLi1989",)

    def __init__(
        self,
        inner: Adaptation,
        bandwidth: float,
        *,
        weight: ArrayLike | None = None,
        rate: float | None = None,
        floor: ArrayLike = 0.0,
    ) -> None:
        """Wrap an adaptation; the prediction error has either a weight or a rate.

        Args:
            inner: any adaptation.
            bandwidth: of the low pass [1/s].
            weight: R, a number, n numbers or (n, n), in 1 / (N m)^2 or 1 / N^2.
            rate: [1/s] at which the prediction error decays, instead of a weight.
            floor: with a rate: a positive number or n of them, in units of W Gamma W^T.

        Raises:
            GainError: neither or both of weight and rate, or gains that are not positive.
        """
        super().__init__(inner)
        self.name = _COMPOSITE.get(inner.name, inner.name)
        self.torque_bandwidth = positive(bandwidth, "prediction_filter")
        if (weight is None) == (rate is None):
            raise GainError("expected either a weight or a rate.", where="prediction_rate")
        self._constant = None if weight is None else checked_weight(weight)
        self._decay = None if rate is None else DecayWeight(rate, floor)

    def weight(self, value: np.ndarray, W: np.ndarray) -> np.ndarray:
        """Return R (n, n) at a value (p) and a filtered regressor W (n, p)."""
        if self._constant is not None:
            return weight_of(self._constant, len(W))
        assert self._decay is not None
        return self._decay.at(W.dot(self.inner.gain_times(value, W.T)))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under tracking and prediction error."""
        return self.inner.rate(estimate, self._weighted(estimate, drive))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s] under both errors, held."""
        return self.inner.step(estimate, self._weighted(estimate, drive), dt)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -r^T R r, and what the inner adaptation adds to dV/dt."""
        own, weighted = 0.0, self._weighted(estimate, drive)
        if weighted.W is not None and weighted.weight is not None:
            predicted = weighted.W.dot(estimate.value - truth)
            own = -float(predicted @ weighted.weight @ weighted.residual)
        return own + self.inner.dissipation(estimate, weighted, truth)

    def _weighted(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with its weight R; unchanged without a prediction error."""
        W = drive.W
        return drive if W is None else drive.weighted(self.weight(estimate.value, W))


class _Recalled(NamedTuple):
    """Effect of the memory on an estimate.

    Attributes:
        pull: (p) H da, the gradient that the memory adds.
        fading: mu, the rate at which it is forgotten now [1/s].
    """

    pull: np.ndarray
    fading: float


class CompositeMemory(Wrapper):
    """da/dt = -Gamma (Y^T e + rho H da), H = A (I + Gamma A)^-1, Gamma that of any adaptation.

    A and b accumulate the information in the filtered regressor W and torque y of the joints,
    weighted by R = bandwidth diag(noise)^-2:

        dA/dt = W^T R W - mu A,     db/dt = W^T R y - mu b,     A(0) = 0, b(0) = 0.

    For the true parameters W a = y and hence b = A a. So A da = A a_hat - b contains only known
    quantities, and H da = (I + A Gamma)^-1 (A a_hat - b). Composite adaptation uses the n
    combinations of parameters that W shows at one instant; this uses all those that the motion has
    excited so far.

    V:          dV/dt changes by -rho da^T H da, an equality for all mu >= 0 and R >= 0, which may
                change with time, in the metric of any inner adaptation. H is symmetric and positive
                semidefinite: H^-1 = A^-1 + Gamma where A is invertible. Under natural adaptation
                the estimate stays in its cone.
    Rate:       errors in directions with much information, Gamma A >> 1, decay as exp(-rho t). A
                need not have full rank for that, and excitation need not persist. The eigenvalues
                of rho Gamma H are at most rho, so a step is stable for every period below 2 / rho.
    Fading:     1 / mu = 1 / (forgetting d) + 1 / bandwidth, d the normalised innovation of least
                squares, d = r_m^T (S + diag(noise)^2)^-1 r_m / n. r_m is the prediction error of
                the memory's own estimate a_hat - Gamma H da; S = W (Gamma^-1 + A)^-1 W^T is the
                part of its covariance that comes from too little data, with Gamma for the
                covariance of da. So data are forgotten when new ones contradict them, for example
                after a change of the load, at most at the bandwidth of the low pass; otherwise they
                are kept.

    G. Kreisselmeier, *Adaptive observers with exponential rate of convergence*, IEEE TAC 22 (1977)
    2-8 (the integrals); Y. Pan, H. Yu, *Composite learning robot control with guaranteed parameter
    convergence*, Automatica 89 (2018) 398-406 (such a memory beside the tracking error);
    T. Fortescue, L. Kershenbaum, B. Ydstie, *Implementation of self-tuning regulators with variable
    forgetting factors*, Automatica 17 (1981) 831-835 (forgetting by the innovation). New here are
    any metric, and H in place of a constant gain on A a_hat - b, for which A is too stiff.

    Attributes:
        inner: the wrapped adaptation, of all dynamic parameters.
        torque_bandwidth: bandwidth of the low pass [1/s]; its inverse is the correlation time
            assumed for the noise.
        speed: rho [1/s].
        noise: standard deviation of the torques, one number or (n) [N m or N].
        forgetting: [1/s] at an innovation as large as expected; zero never forgets.
    """

    sources = ("Kreisselmeier1977", "PanYu2018", "FortescueKershenbaumYdstie1981")

    def __init__(
        self,
        inner: Adaptation,
        bandwidth: float,
        *,
        rate: float,
        noise: ArrayLike,
        forgetting: float = 0.0,
    ) -> None:
        """Wrap an adaptation with a memory.

        Args:
            inner: any adaptation, whose metric is used.
            bandwidth: of the low pass on torque and regressor [1/s].
            rate: rho [1/s].
            noise: standard deviation of the torques, one number or n [N m or N].
            forgetting: rate of fading at an innovation as large as expected [1/s].

        Raises:
            GainError: gains that are not positive.
        """
        super().__init__(inner)
        self.name = _WITH_MEMORY.get(inner.name, inner.name)
        self.torque_bandwidth = positive(bandwidth, "prediction_filter")
        self.speed = positive(rate, "prediction_rate")
        self.noise = numbers(noise, "noise", error=GainError)
        if self.noise.ndim > 1 or not (self.noise > 0.0).all():
            raise GainError("expected a positive number, or one per joint.", where="noise")
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self._variance = self.noise * self.noise

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, with an empty memory."""
        return self._with_empty_memory(self.inner.init(value))

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the inner adaptation's estimate at an announced value (p), with empty memory."""
        return self._with_empty_memory(self.inner.reset_to(self._inner(estimate), value, start))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under drive and memory, dA/dt and db/dt."""
        A, b = estimate.memory[:2]
        fading, A_new, b_new, total = self._parts(estimate, drive)
        rate = self.inner.rate(self._inner(estimate), total)
        return Estimate(rate.value, (A_new - fading * A, b_new - fading * b, *rate.memory))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; fading is integrated exactly."""
        A, b = estimate.memory[:2]
        fading, A_new, b_new, total = self._parts(estimate, drive)
        after, kept = self.inner.step(self._inner(estimate), total, dt), math.exp(-fading * dt)
        A_new *= dt
        A_new += kept * A
        return Estimate(after.value, (A_new, kept * b + dt * b_new, *after.memory))

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -rho da^T H da, and what the inner adaptation adds to dV/dt."""
        total = self._parts(estimate, drive)[-1]
        own = (estimate.value - truth).dot(total.gradient - drive.gradient)
        return float(-own + self.inner.dissipation(self._inner(estimate), total, truth))

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(self._inner(estimate), truth)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project(self._inner(estimate), q)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(self._inner(estimate))

    def _parts(
        self, estimate: Estimate, drive: Drive
    ) -> tuple[float, np.ndarray, np.ndarray, Drive]:
        """Return mu [1/s], W^T R W (p, p), W^T R y (p), and the drive with rho H da added.

        Zeros and the drive itself where it has no prediction error.
        """
        value, (A, b) = estimate.value, estimate.memory[:2]
        W, residual = drive.W, drive.residual
        if W is None or residual is None:
            return 0.0, np.zeros(A.shape), np.zeros(b.size), drive
        pull, fading = self._recalled(value, A, b, W, residual)
        weighted = (W.T * (self.torque_bandwidth / self._variance)).dot  # W^T R
        total = Drive(drive.Y, drive.e, gradient=drive.gradient + self.speed * pull)
        return fading, weighted(W), weighted(W.dot(value) - residual), total

    def _recalled(
        self, value: np.ndarray, A: np.ndarray, b: np.ndarray, W: np.ndarray, residual: np.ndarray
    ) -> _Recalled:
        """Return H da and mu at a value (p), memory A, b and prediction error W (n, p), r (n).

        One factorisation of I + A Gamma serves H da and S.
        """
        n, p = W.shape
        sides = np.empty((p, p + n))
        sides[:, :p], sides[:, p:] = A, W.T
        moved = self.inner.gain_times(value, sides)  # Gamma A, Gamma W^T
        system = moved[:, :p].T.copy()
        system.flat[:: p + 1] += 1.0
        sides[:, p - 1] = A.dot(value) - b
        solved = np.linalg.solve(system, sides[:, p - 1 :])
        pull, W_Gamma = solved[:, 0], moved[:, p:].T
        innovation = residual - W_Gamma.dot(pull)
        S = W_Gamma.dot(solved[:, 1:])
        S.flat[:: n + 1] += self._variance
        size = float(innovation.dot(np.linalg.solve(0.5 * (S + S.T), innovation)))
        fading = self.forgetting * max(size, 0.0) / n  # forgetting d
        return _Recalled(pull, fading / (1.0 + fading / self.torque_bandwidth))

    @staticmethod
    def _with_empty_memory(estimate: Estimate) -> Estimate:
        """Return the inner adaptation's estimate with A = 0 and b = 0."""
        p = estimate.value.size
        return Estimate(estimate.value, (np.zeros((p, p)), np.zeros(p), *estimate.memory))

    @staticmethod
    def _inner(estimate: Estimate) -> Estimate:
        """Return the estimate with the inner adaptation's own memory."""
        return Estimate(estimate.value, estimate.memory[2:])
