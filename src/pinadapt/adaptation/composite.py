"""Composite adaptation: tracking error and prediction error of the torque together.

``Composite`` uses the prediction error of the present, ``CompositeMemory`` that of all past data.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from ..exceptions import GainError
from ..models.physical_fit import sums_of
from .adaptation import Adaptation, Drive, Estimate, Wrapper, positive_numbers
from .least_squares import PredictionWeight

# name of the inner adaptation -> of its composite, and of that with a memory
_NAMES = {
    "gradient": ("composite", "composite-memory"),
    "natural": ("natural-composite", "natural-memory"),
}


class Composite(Wrapper):
    """da/dt = -Gamma (Y^T e + W^T R r), r = W a - y, Gamma that of any adaptation.

    W and y are the filtered regressor and torque of the joints; see ``FilteredRegressor``. For the
    true parameters W a = y, hence r = W da for any tracking error, and adaptation continues when
    the tracking error has vanished.

    V:          dV/dt changes by -r^T R r <= 0, an equality for every R >= 0, which may change with
                time, in the metric of any inner adaptation. Under natural adaptation the estimate
                stays in its cone.
    Weight:     constant, as published, or R = rate (W Gamma W^T + diag(floor))^-1; see
                ``PredictionWeight``.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519, with a constant Gamma; with natural adaptation it is the same gradient in its metric.

    Attributes:
        inner: the wrapped adaptation, of all dynamic parameters.
        torque_bandwidth: bandwidth of the low pass [1/s].
        weight: how R is chosen.
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
        self.name = _NAMES.get(inner.name, (inner.name,))[0]
        self.torque_bandwidth = positive(bandwidth, "prediction_filter")
        if (weight is None) == (rate is None):
            raise GainError("expected either a weight or a rate.", where="prediction_rate")
        self.weight = PredictionWeight(weight, rate, floor)

    def _driven(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with its weight R; unchanged without a prediction error."""
        if drive.W is None:
            return drive
        return drive.weighted(self.weight.at(drive, partial(self.inner.gain_times, estimate)))


class CompositeMemory(Wrapper):
    """da/dt = -Gamma (Y^T e + (rho / kappa) H da), H = A (I + P A)^-1, P = Gamma / kappa.

    Gamma is that of any adaptation, and P the covariance that the memory takes for that of da. A
    and b accumulate the information in the filtered regressor W and torque y of the joints,
    weighted by R = bandwidth diag(noise)^-2:

        dA/dt = W^T R W - mu A,     db/dt = W^T R y - mu b,     A(0) = 0, b(0) = 0.

    For the true parameters W a = y and hence b = A a. So A da = A a_hat - b contains only known
    quantities, and H da = (I + A P)^-1 (A a_hat - b). Composite adaptation uses the n
    combinations of parameters that W shows at one instant; this uses all those that the motion has
    excited so far.

    V:          dV/dt changes by -(rho / kappa) da^T H da, an equality for all mu >= 0 and R >= 0,
                which may change with time, in the metric of any inner adaptation. H is symmetric
                and positive semidefinite: H^-1 = A^-1 + P where A is invertible. Under natural
                adaptation the estimate stays in its cone.
    Share:      written with P, da/dt = -P (kappa Y^T e + rho H da). With kappa below one the
                tracking error adapts more slowly than the memory: a fast loop of torque and
                estimate rings where motors are late or joints are elastic.
    Rate:       errors in directions with much information, P A >> 1, decay as exp(-rho t). A
                need not have full rank for that, and excitation need not persist. The eigenvalues
                of rho P H are at most rho, so a step is stable for every period below 2 / rho.
    Fading:     1 / mu = 1 / (forgetting d) + 1 / bandwidth, d the normalised innovation squared of
                least squares, d = r_m^T (S + diag(noise)^2)^-1 r_m / n. r_m is the prediction error
                of the memory's own estimate a_hat - P H da; S = W (P^-1 + A)^-1 W^T is the part of
                its covariance that comes from too little data. So data are forgotten when new ones
                contradict them, at most at the bandwidth of the low pass; otherwise they are kept.
                Meanwhile rho is reduced by the factor (1 - mu / bandwidth)^doubt: parameters that
                cannot explain the torque would follow its errors.
    Prior:      where W is noisy, least squares is biased (errors in variables): E W^T R W grows by
                the information N of the noise per second, E W^T R y does not, so that a direction
                that no motion shows tends to N a = 0. With Pi for a prior, dA/dt gains Pi and db/dt
                gains Pi a_0, a_0 the value at the start or the announced one. dV/dt gains
                (rho / kappa) da^T (I + A P)^-1 Pi (a_0 - a) t.
    Sampling:   A and b are integrated, and H da, which needs the solution of p equations, is
                evaluated and held over steps of ``interval``. V does not notice, as H is positive
                semidefinite.

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
        share: kappa.
        doubt: exponent of the factor by which rho is reduced while data fade.
        interval: between evaluations of H da [s]; zero for every sample.
        unit: the parameters' covariance before any data is about ``unit`` P: P is the rate of a
            loop, and larger.
        prior: Pi (p, p) [1/s], or None.
    """

    sources = ("Kreisselmeier1977", "PanYu2018", "FortescueKershenbaumYdstie1981")
    _parts = 4

    def __init__(
        self,
        inner: Adaptation,
        bandwidth: float,
        *,
        rate: float,
        noise: ArrayLike,
        forgetting: float = 0.0,
        share: float = 1.0,
        doubt: float = 1.0,
        interval: float = 0.0,
        unit: float = 1.0,
        prior: ArrayLike | None = None,
    ) -> None:
        """Wrap an adaptation with a memory.

        Args:
            inner: any adaptation, whose metric is used.
            bandwidth: of the low pass on torque and regressor [1/s].
            rate: rho [1/s].
            noise: standard deviation of the torques, one number or n [N m or N].
            forgetting: rate of fading at an innovation as large as expected [1/s].
            share: kappa, Gamma / P.
            doubt: exponent of the factor by which rho is reduced while data fade, zero for none.
            interval: between evaluations of H da [s], at most 1 / rho; zero: every sample.
            unit: of P, by which information of other data is multiplied.
            prior: Pi (p, p) [1/s], symmetric and positive semidefinite; None: zero.

        Raises:
            GainError: gains that are not positive, or too long an interval.
        """
        super().__init__(inner)
        self.name = _NAMES.get(inner.name, (inner.name,))[-1]
        self.torque_bandwidth = self._bandwidth = positive(bandwidth, "prediction_filter")
        self.speed = positive(rate, "prediction_rate")
        self.noise = positive_numbers(noise, "noise")
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self.share = positive(share, "share")
        self.doubt = positive(doubt, "doubt", zero=True)
        self.interval = positive(interval, "interval", zero=True, most=1.0 / self.speed)
        self.unit = positive(unit, "unit")
        self.prior = None if prior is None else numbers(prior, "prior", error=GainError)
        self._variance = self.noise * self.noise

    def _own(self, start: np.ndarray) -> tuple:
        """Return no sums, no gradient, the time to its next evaluation, and the prior's sums."""
        p = start.size
        prior = np.zeros(1) if self.prior is None else sums_of(np.eye(p), start, self.prior)
        return np.zeros((p + 1, p + 1)), np.zeros(p), np.zeros(1), prior

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the inner adaptation's start, with A = unit H and b = A a_hat for other data.

        Where the other data's best value is off by e, dV/dt changes by (rho / kappa) da^T
        (I + A P)^-1 A e besides: the memory keeps the other data with the stated accuracy.
        """
        estimate = super().init(value)
        if information is not None:
            sums = sums_of(np.eye(len(information)), estimate.value, self.unit * information)
            estimate.memory = (sums, *estimate.memory[1:])
        return estimate

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return the estimate without the memory, which V does not contain."""
        inner = self.inner.recorded(self._inner(estimate))
        return self._outer((np.zeros(0),) * self._parts, inner)

    def _driven(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive of the inner adaptation, with the memory's gradient."""
        return self._total(drive, self._memory_gradient(estimate, drive)[0])

    def _total(self, drive: Drive, gradient: np.ndarray) -> Drive:
        """Return the drive of the inner adaptation, with the memory's gradient H da (p)."""
        total = drive.gradient + self.speed / self.share * gradient
        return Drive(drive.Y, drive.e, gradient=total)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under drive and memory, dA/dt and db/dt."""
        rate = super().rate(estimate, drive)
        if drive.W is None or drive.saturated:
            return rate
        _, fading = self._memory_gradient(estimate, drive)
        learned = self._information_rate(estimate, drive) - fading * estimate.memory[0]
        return Estimate(rate.value, (learned, *rate.memory[1:]))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; fading is integrated exactly."""
        if drive.W is None or drive.saturated:
            return super().step(estimate, drive, dt)
        sums, gradient, due, prior = estimate.memory[: self._parts]
        if due[0] < 0.5 * dt:
            span = max(self.interval, dt)
            due = np.array([span])
            gradient, fading = self._memory_gradient(estimate, drive)
            sums = span * self._information_rate(estimate, drive) + math.exp(-fading * span) * sums
        after = self.inner.step(self._inner(estimate), self._total(drive, gradient), dt)
        return self._outer((sums, gradient, due - dt, prior), after)

    def _information_rate(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return the sums (p + 1, p + 1) of a prediction error and of the prior, per second."""
        W = drive.W
        assert W is not None
        y = W.dot(estimate.value) - drive.residual
        R = self._bandwidth / self._variance * np.eye(len(W))
        return sums_of(W, y, R) + estimate.memory[3]

    def _memory_gradient(self, estimate: Estimate, drive: Drive) -> tuple[np.ndarray, float]:
        """Return H da (p) and mu [1/s]; zeros without a prediction error.

        One factorisation of I + A P serves H da and S.
        """
        W = drive.W
        if W is None or drive.saturated:
            return np.zeros(estimate.value.size), 0.0
        from scipy.linalg.lapack import dgesv  # slow to import

        sums = estimate.memory[0]
        inner = self._inner(estimate)
        n = len(W)
        A = sums[:-1, :-1]
        b = sums[:-1, -1]
        moved = self.inner.gain_times(inner, A)  # kappa P A
        moved.flat[:: len(b) + 1] += self.share
        sides = np.column_stack([A.dot(estimate.value) - b, W.T])
        # (I + A P)^-1 / kappa times A da and W^T
        solved = dgesv(moved.T, sides)[2]
        W_Gamma = self.inner.gain_times(inner, W.T).T
        innovation = drive.residual - W_Gamma.dot(solved[:, 0])
        S = W_Gamma.dot(solved[:, 1:])
        S.flat[:: n + 1] += self._variance
        fading = self.forgetting / n * float(innovation @ np.linalg.solve(S, innovation))
        fading /= 1.0 + fading / self._bandwidth
        trust = (1.0 - fading / self._bandwidth) ** self.doubt
        return trust * self.share * solved[:, 0], fading
