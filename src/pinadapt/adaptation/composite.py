"""Composite adaptation: the tracking error and the prediction error of the torque together."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from ..exceptions import GainError
from .adaptation import Adaptation, Drive, Estimate, Wrapper
from .least_squares import DecayWeight, checked_weight, weight_of

_NAMES = {"gradient": "composite", "natural": "natural-composite"}


class Composite(Wrapper):
    """da/dt = -Gamma (Y^T e + W^T R r), Gamma that of any adaptation, r = W a - y.

    W and y are regressor and torque of the joints through a low pass; see ``FilteredRegressor``.
    With the true parameters W a = y, so r = W da whatever the tracking error is, and learning goes
    on where that has died out.

    V:          as without the prediction error; dV/dt gains -r^T R r <= 0, an equality, for every
                R >= 0, which may change with time, in whatever metric the adaptation has. Of a
                natural one the estimate stays in its cone.
    Weight:     constant, as published, or R = rate (W Gamma W^T + diag(floor))^-1: then dr/dt =
                -rate r + (what W changes), on every joint at the same rate and in no units; the
                floor keeps joints that hardly move from being heard.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519, with a constant Gamma; on natural adaptation the same gradient in its metric.

    Attributes:
        inner: the adaptation that it wraps, of all dynamic parameters.
        prediction: bandwidth of the low pass [1/s].
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
        """Take the adaptation to wrap, and the low pass with a weight or a rate.

        Args:
            inner: any adaptation.
            bandwidth: of the low pass [1/s].
            weight: R, a number, n numbers or (n, n), in 1 / (N m)^2 or 1 / N^2.
            rate: [1/s] at which the prediction error decays, instead of a weight.
            floor: a positive number or n of them in units of W Gamma W^T, with a rate.

        Raises:
            GainError: neither weight nor rate or both of them, or gains that are not positive.
        """
        super().__init__(inner)
        self.name = _NAMES.get(inner.name, inner.name)
        self.prediction = positive(bandwidth, "prediction_filter")
        if (weight is None) == (rate is None):
            raise GainError("give either a weight or a rate.", where="prediction_rate")
        self._constant = None if weight is None else checked_weight(weight)
        self._decay = None if rate is None else DecayWeight(rate, floor)

    def weight(self, value: np.ndarray, W: np.ndarray) -> np.ndarray:
        """Return R (n, n) at a value (p) and a filtered regressor W (n, p)."""
        if self._constant is not None:
            return weight_of(self._constant, len(W))
        assert self._decay is not None
        return self._decay.at(W.dot(self.inner.gain_times(value, W.T)))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under both errors."""
        return self.inner.rate(estimate, self._weighted(estimate, drive))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s] under both errors."""
        return self.inner.step(estimate, self._weighted(estimate, drive), dt)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -r^T R r, and what the inner adaptation adds to dV/dt."""
        own, weighted = 0.0, self._weighted(estimate, drive)
        if weighted.W is not None and weighted.weight is not None:
            predicted = weighted.W.dot(estimate.value - truth)
            own = -float(predicted @ weighted.weight @ weighted.residual)
        return own + self.inner.dissipation(estimate, weighted, truth)

    def _weighted(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with its weight; the drive itself where nothing is predicted."""
        W = drive.W
        return drive if W is None else drive.weighted(self.weight(estimate.value, W))


_MEMORY_NAMES = {"gradient": "composite-memory", "natural": "natural-memory"}


class _Recalled(NamedTuple):
    """What the memory says to an estimate.

    Attributes:
        pull: (p) H da, by which it moves the estimate.
        fading: rate at which it is forgotten now [1/s].
    """

    pull: np.ndarray
    fading: float


class CompositeMemory(Wrapper):
    """da/dt = -Gamma (Y^T e + rho H da), H = A (I + Gamma A)^-1, Gamma that of any adaptation.

    A and b are what regressor W and torque y of the joints, through a low pass, have told until
    now, weighted by R = bandwidth diag(noise)^-2:

        dA/dt = W^T R W - mu A,     db/dt = W^T R y - mu b,     A(0) = 0, b(0) = 0.

    With the true parameters W a = y and so b = A a: A a_hat - b = A da needs no parameter that is
    not known, and H da = (I + A Gamma)^-1 (A a_hat - b). Composite adaptation hears one instant,
    n combinations of the parameters; this hears all that the motion has told apart.

    V:          as without the memory; dV/dt gains -rho da^T H da, an equality, for whatever mu >= 0
                and R >= 0 do with time, in whatever metric the adaptation has. H is symmetric and
                never negative: H^-1 = A^-1 + Gamma where A is invertible. Of a natural adaptation
                the estimate stays in its cone.
    Rate:       with what is told of a direction far beyond the metric, Gamma A >> 1, its error
                decays as exp(-rho t), all such directions alike; A need not be complete for that,
                and no excitation need go on. As rho H Gamma <= rho, no step is too long for it.
    Fading:     1 / mu = 1 / (forgetting d) + 1 / bandwidth, d the normalised innovation of least
                squares, r_m^T (S + diag(noise)^2)^-1 r_m / n: r_m is what the memory's own
                estimate, a_hat - Gamma H da, predicts wrongly of the torque now, S = W (Gamma^-1 +
                A)^-1 W^T what it may miss for having seen too little, Gamma taken for the
                covariance of da. So it forgets what is contradicted, as after a change of the load,
                never faster than the low pass lets new torques in, and else keeps all, however
                long.

    G. Kreisselmeier, *Adaptive observers with exponential rate of convergence*, IEEE TAC 22 (1977)
    2-8, has the integrals; Y. Pan and H. Yu, *Composite learning robot control with guaranteed
    parameter convergence*, Automatica 89 (2018) 398-406, such a memory beside the tracking error;
    T. Fortescue, L. Kershenbaum and B. Ydstie, *Implementation of self-tuning regulators with
    variable forgetting factors*, Automatica 17 (1981) 831-835, forget by the innovation. H in place
    of a constant gain on A a_hat - b, and any metric, are ours: A is too stiff for a constant one.

    Attributes:
        inner: the adaptation that it wraps, of all dynamic parameters.
        prediction: bandwidth of the low pass [1/s]; noise counts as independent after its inverse.
        speed: rho [1/s].
        noise: (n) or one, standard deviation of the torques [N m or N].
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
        """Take the adaptation to wrap, any, and the gains.

        Args:
            inner: whose metric it moves in.
            bandwidth: of the low pass on torque and regressor [1/s].
            rate: rho [1/s].
            noise: of the torques, a number or n of them [N m or N].
            forgetting: [1/s].

        Raises:
            GainError: gains that are not positive.
        """
        super().__init__(inner)
        self.name = _MEMORY_NAMES.get(inner.name, inner.name)
        self.prediction = positive(bandwidth, "prediction_filter")
        self.speed = positive(rate, "prediction_rate")
        self.noise = numbers(noise, "noise", error=GainError)
        if self.noise.ndim > 1 or not (self.noise > 0.0).all():
            raise GainError("expected a positive number, or one a joint.", where="noise")
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self._variance = self.noise * self.noise

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, with nothing remembered."""
        return self._remembering_nothing(self.inner.init(value))

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return what the inner adaptation makes of an announced value (p); memory begins anew."""
        return self._remembering_nothing(self.inner.reset_to(self._inner(estimate), value, start))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under both, and dA/dt and db/dt."""
        A, b = estimate.memory[:2]
        fading, A_told, b_told, total = self._parts(estimate, drive)
        rate = self.inner.rate(self._inner(estimate), total)
        return Estimate(rate.value, (A_told - fading * A, b_told - fading * b, *rate.memory))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; it fades by its own solution."""
        A, b = estimate.memory[:2]
        fading, A_told, b_told, total = self._parts(estimate, drive)
        after, kept = self.inner.step(self._inner(estimate), total, dt), math.exp(-fading * dt)
        A_told *= dt
        A_told += kept * A
        return Estimate(after.value, (A_told, kept * b + dt * b_told, *after.memory))

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
        """Return mu, what of dA/dt and db/dt is told now, and the drive with the memory's pull.

        Without a prediction nothing is told and nothing pulls.
        """
        value, (A, b) = estimate.value, estimate.memory[:2]
        W, residual = drive.W, drive.residual
        if W is None or residual is None:
            return 0.0, np.zeros(A.shape), np.zeros(b.size), drive
        pull, fading = self._recalled(value, A, b, W, residual)
        weighted = (W.T * (self.prediction / self._variance)).dot  # W^T R
        total = Drive(drive.Y, drive.e, gradient=drive.gradient + self.speed * pull)
        return fading, weighted(W), weighted(W.dot(value) - residual), total

    def _recalled(
        self, value: np.ndarray, A: np.ndarray, b: np.ndarray, W: np.ndarray, residual: np.ndarray
    ) -> _Recalled:
        """Return what the memory says at W (n, p) and residual (n)."""
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
        doubted = self.forgetting * max(size, 0.0) / n
        return _Recalled(pull, doubted / (1.0 + doubted / self.prediction))

    @staticmethod
    def _remembering_nothing(estimate: Estimate) -> Estimate:
        p = estimate.value.size
        return Estimate(estimate.value, (np.zeros((p, p)), np.zeros(p), *estimate.memory))

    @staticmethod
    def _inner(estimate: Estimate) -> Estimate:
        """Return the estimate with what the inner adaptation remembers."""
        return Estimate(estimate.value, estimate.memory[2:])
