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
    """What the memory says about an estimate.

    Attributes:
        pull: (p) H da, the gradient that the memory adds, times the share of rho that holds now.
        surprise: d, the normalised innovation.
        fading: mu, the rate at which it is forgotten now [1/s].
    """

    pull: np.ndarray
    surprise: float
    fading: float


_NOTHING = np.zeros(0)
_QUIET = 6.0  # times the time constant of the low pass: its memory of an old load is 0.2 %
_USUAL = 30.0  # time constants of the low pass over which innovations are averaged
_UNUSUAL = 10.0  # times the usual innovation
_CALM = 0.1  # least share of rho


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

    Other data: A and b may begin with the information of a recorded motion, see ``informed``.

    V:          dV/dt changes by -(rho / kappa) da^T H da, an equality for all mu >= 0 and R >= 0,
                which may change with time, in the metric of any inner adaptation. H is symmetric
                and positive semidefinite: H^-1 = A^-1 + P where A is invertible. Under natural
                adaptation the estimate stays in its cone.
    Share:      written with P, da/dt = -P (kappa Y^T e + rho H da), and kappa V has the derivative
                kappa (that of the law) - rho da^T H da. With kappa below one the tracking error
                teaches more slowly than the memory, which needs no fast loop of torque and estimate
                for its accuracy: such a loop rings where motors are late or joints give way.
    Rate:       errors in directions with much information, P A >> 1, decay as exp(-rho t). A
                need not have full rank for that, and excitation need not persist. The eigenvalues
                of rho P H are at most rho, so a step is stable for every period below 2 / rho.
    Agreement:  where memory and estimate nearly agree on the torque, rho is reduced, to a tenth at
                least: rho m / (m + agreement), m the root mean square over the joints of W P H da /
                noise. Errors that no parameters cause, such as those of sampling, are then left to
                the tracking error, which compensates them as an integrator does.
    Fading:     1 / mu = 1 / (forgetting d) + 1 / bandwidth, d the normalised innovation of least
                squares, d = r_m^T (S + diag(noise)^2)^-1 r_m / n. r_m is the prediction error of
                the memory's own estimate a_hat - P H da; S = W (P^-1 + A)^-1 W^T is the
                part of its covariance that comes from too little data. So data are forgotten when
                new ones contradict them, at most at the bandwidth of the low pass; otherwise they
                are kept.
    New start:  where d exceeds ``contradiction`` and ten times its own mean over the last
                30 / bandwidth, for example after a change of the load, and at an announcement:
                A = 0 and b = 0. Nothing is stored for 6 / bandwidth, until the low pass has
                forgotten what it knew of the old load. V does not contain A and b, so nothing
                jumps. The mean is for errors that no parameters explain, such as friction that is
                none of them: they contradict all data alike.
    Sampling:   A and b are integrated, and H da, which needs the solution of p equations, is
                evaluated and held over steps of ``interval``. As part of an ODE (``rate``) all are
                continuous, and the memory does not begin anew.

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
        contradiction: d above which the memory begins anew; infinite for never.
        interval: between evaluations of H da [s]; zero for every sample.
        agreement: size of the torques that memory and estimate differ by, relative to the noise,
            below which rho is reduced; zero for never.
        unit: the parameters' covariance before any data is about ``unit`` P: P is the rate of a
            loop, and larger.
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
        share: float = 1.0,
        contradiction: float = math.inf,
        interval: float = 0.0,
        agreement: float = 0.0,
        unit: float = 1.0,
    ) -> None:
        """Wrap an adaptation with a memory.

        Args:
            inner: any adaptation, whose metric is used.
            bandwidth: of the low pass on torque and regressor [1/s].
            rate: rho [1/s].
            noise: standard deviation of the torques, one number or n [N m or N].
            forgetting: rate of fading at an innovation as large as expected [1/s].
            share: kappa in (0, 1], Gamma / P.
            contradiction: normalised innovation above which the memory begins anew; infinite:
                never.
            interval: between evaluations of H da [s], at most 1 / rho; zero: every sample.
            agreement: below which difference of the torques, relative to the noise, rho is reduced.
            unit: of P, by which information of other data is multiplied.

        Raises:
            GainError: gains that are not positive, a share above one or too long an interval.
        """
        super().__init__(inner)
        self.name = _WITH_MEMORY.get(inner.name, inner.name)
        self.torque_bandwidth = self._bandwidth = positive(bandwidth, "prediction_filter")
        self.speed = positive(rate, "prediction_rate")
        self.noise = numbers(noise, "noise", error=GainError)
        if self.noise.ndim > 1 or not (self.noise > 0.0).all():
            raise GainError("expected a positive number, or one per joint.", where="noise")
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self.share = positive(share, "share")
        if self.share > 1.0:
            raise GainError(
                f"the tracking error teaches at most as fast as the memory, got {share:g} > 1.",
                where="share",
            )
        self.contradiction = math.inf
        if not (isinstance(contradiction, float) and contradiction == math.inf):
            self.contradiction = positive(contradiction, "contradiction")
        self.interval = positive(interval, "interval", zero=True)
        if self.interval * self.speed > 1.0:
            raise GainError(
                f"{interval:g} s is longer than 1 / rho = {1.0 / self.speed:.3g} s.",
                where="interval",
            )
        self.agreement = positive(agreement, "agreement", zero=True)
        self.unit = positive(unit, "unit")
        self._variance = self.noise * self.noise

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, with an empty memory."""
        return self._with_empty_memory(self.inner.init(value), 0.0)

    def informed(self, estimate: Estimate, H: np.ndarray) -> Estimate:
        """Return the estimate with A = unit H and b = A a_hat.

        Where the other data's best value is off by e, dV/dt changes by (rho / kappa) da^T
        (I + A P)^-1 A e besides: the memory holds what it was told, as exactly as it was told.
        """
        A = self.unit * H
        return Estimate(estimate.value, (A, A.dot(estimate.value), *estimate.memory[2:]))

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the inner adaptation's estimate at an announced value (p); memory begins anew."""
        inner = self.inner.reset_to(self._inner(estimate), value, start)
        return self._with_empty_memory(inner, _QUIET / self._bandwidth)

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return the estimate without what the memory holds, which V does not contain."""
        inner = self.inner.recorded(self._inner(estimate))
        own = len(estimate.memory) - len(self._inner(estimate).memory)
        return Estimate(inner.value, (*[_NOTHING] * own, *inner.memory))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under drive and memory, dA/dt and db/dt."""
        A, b, pull, clock = estimate.memory[:4]
        inner, still = self._inner(estimate), (np.zeros(pull.size), np.zeros(clock.size))
        told = self._recalled(estimate, drive)
        rate = self.inner.rate(inner, self._total(drive, None if told is None else told.pull))
        if told is None:
            still[1][0] = -float(clock[0] > 0.0)
            return Estimate(rate.value, (np.zeros(A.shape), np.zeros(b.size), *still, *rate.memory))
        A_new, b_new = self._news(estimate.value, drive)
        moved = A_new - told.fading * A, b_new - told.fading * b
        return Estimate(rate.value, (*moved, *still, *rate.memory))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; fading is integrated exactly."""
        A, b, pull, (quiet, due, usual, looks) = estimate.memory[:4]
        inner = self._inner(estimate)
        if quiet > 0.0 or drive.W is None:
            after = self.inner.step(inner, self._total(drive, None), dt)
            clock = np.array([quiet - dt, 0.0, usual, looks])
            return Estimate(after.value, (A, b, pull, clock, *after.memory))
        if due > 0.5 * dt:
            after = self.inner.step(inner, self._total(drive, pull), dt)
            clock = np.array([0.0, due - dt, usual, looks])
            return Estimate(after.value, (A, b, pull, clock, *after.memory))
        told = self._recalled(estimate, drive)
        assert told is not None
        span, d = max(self.interval, dt), told.surprise
        weight = max(1.0 / (looks + 1.0), min(1.0, span * self._bandwidth / _USUAL))
        mean = usual + weight * (d - usual)
        if d > max(self.contradiction, _UNUSUAL * mean):
            after = self.inner.step(inner, self._total(drive, None), dt)
            return self._with_empty_memory(after, _QUIET / self._bandwidth, mean, looks)
        after = self.inner.step(inner, self._total(drive, told.pull), dt)
        kept, (A_new, b_new) = math.exp(-told.fading * span), self._news(estimate.value, drive)
        A_new *= span
        A_new += A if kept == 1.0 else kept * A
        clock = np.array([0.0, due + span - dt, mean, looks + 1.0])
        memory = A_new, kept * b + span * b_new, told.pull, clock
        return Estimate(after.value, (*memory, *after.memory))

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -(rho / kappa) da^T H da, and what the inner adaptation adds to dV/dt."""
        told = self._recalled(estimate, drive)
        total = self._total(drive, None if told is None else told.pull)
        own = (estimate.value - truth).dot(total.gradient - drive.gradient)
        return float(-own + self.inner.dissipation(self._inner(estimate), total, truth))

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(self._inner(estimate), truth)

    @property
    def projects(self) -> bool:
        """Whether the inner adaptation projects."""
        return self.inner.projects

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project(self._inner(estimate), q)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(self._inner(estimate))

    def _total(self, drive: Drive, pull: np.ndarray | None) -> Drive:
        """Return the drive of the inner adaptation, with the pull H da (p) of the memory."""
        gradient = drive.gradient
        if pull is not None:
            gradient = gradient + (self.speed / self.share) * pull
        return Drive(drive.Y, drive.e, gradient=gradient)

    def _news(self, value: np.ndarray, drive: Drive) -> tuple[np.ndarray, np.ndarray]:
        """Return W^T R W (p, p) and W^T R y (p) of a drive with a prediction error."""
        W, residual = drive.W, drive.residual
        assert W is not None and residual is not None
        weighted = (W.T * (self._bandwidth / self._variance)).dot  # W^T R
        return weighted(W), weighted(W.dot(value) - residual)

    def _recalled(self, estimate: Estimate, drive: Drive) -> _Recalled | None:
        """Return H da, d and mu; None while the memory is quiet or without a prediction error.

        One factorisation of I + A P serves H da and S.
        """
        value, (A, b, _, clock) = estimate.value, estimate.memory[:4]
        W, residual = drive.W, drive.residual
        if W is None or residual is None or clock[0] > 0.0:
            return None
        n, p = W.shape
        sides = np.empty((p, p + n))
        sides[:, :p], sides[:, p:] = A, W.T
        moved = self.inner.gain_times(value, sides) / self.share  # P A, P W^T
        moved.flat[:: p + n + 1] += 1.0
        sides[:, p - 1] = A.dot(value) - b
        solved = np.linalg.solve(moved[:, :p].T, sides[:, p - 1 :])
        pull, W_P = solved[:, 0], moved[:, p:].T
        change = W_P.dot(pull)
        innovation = residual - change
        S = W_P.dot(solved[:, 1:])
        S.flat[:: n + 1] += self._variance
        size = innovation.dot(np.linalg.solve(0.5 * (S + S.T), innovation))
        surprise = max(float(size), 0.0) / n
        fading = self.forgetting * surprise
        fading /= 1.0 + fading / self._bandwidth
        return _Recalled(self._calm(change) * pull, surprise, fading)

    def _calm(self, change: np.ndarray) -> float:
        """Return the share of rho where the memory would change the torque by so much (n)."""
        if not self.agreement:
            return 1.0
        m = math.sqrt(float(np.mean(change * change / self._variance)))
        return max(_CALM, m / (m + self.agreement))

    @staticmethod
    def _with_empty_memory(
        estimate: Estimate, quiet: float, usual: float = 0.0, looks: float = 0.0
    ) -> Estimate:
        """Return the inner adaptation's estimate with A = 0 and b = 0, quiet for a time [s]."""
        p = estimate.value.size
        empty = np.zeros((p, p)), np.zeros(p), np.zeros(p), np.array([quiet, 0.0, usual, looks])
        return Estimate(estimate.value, (*empty, *estimate.memory))

    @staticmethod
    def _inner(estimate: Estimate) -> Estimate:
        """Return the estimate with the inner adaptation's own memory."""
        return Estimate(estimate.value, estimate.memory[4:])
