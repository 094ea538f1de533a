"""A leak of the estimate back to where it started: the sigma modification."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from ..exceptions import GainError
from .adaptation import Adaptation, Drive, Estimate, Wrapper


class Leak(Wrapper):
    """da/dt = (inner rate) - lambda (a - a_0), a_0 the initial value: the sigma modification.

    Noise of the joint velocities has a mean in Y^T s, and what motion does not excite follows it
    without bound; a leak bounds it, and is nothing against the rate at which excited directions
    learn. A step mixes the inner one's result with a_0, so it stays in every convex domain that
    holds both.

    The inner adaptation's part of V stays, and dV/dt gains -lambda da^T Gamma^-1 (a - a_0), an
    equality in every metric. For a constant Gamma it is at most -lambda (D(a) - D(a_0)), D the
    inner part of V: with a disturbance d of the closed loop V falls wherever the parameter error is
    larger than that at the start and what d asks for, so it is bounded, and errors end in a
    neighbourhood of zero that shrinks with lambda (P. Ioannou, P. Kokotovic, *Instability analysis
    and improvement of robustness of adaptive control*, Automatica 20 (1984) 583-594, whose leak
    -Gamma sigma a goes to zero; this one to a_0, and at the same rate in all directions).

    Attributes:
        inner: the adaptation that it wraps.
        bandwidth: lambda [1/s].
    """

    sources = ("IoannouKokotovic1984",)

    def __init__(self, inner: Adaptation, bandwidth: float) -> None:
        """Take the adaptation to wrap, any, and lambda [1/s].

        Raises:
            GainError: not positive.
        """
        super().__init__(inner)
        self.bandwidth = positive(bandwidth, "leak")

    def leaking(self, drive: Drive) -> float:
        """Return lambda [1/s] under a drive."""
        return self.bandwidth

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, which is remembered."""
        estimate = self.inner.init(value)
        return Estimate(estimate.value, (estimate.value.copy(), *estimate.memory))

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return what the inner adaptation makes of an announced value (p); leak to ``start``."""
        inner = self.inner.reset_to(self._inner(estimate), value, start)
        return Estimate(inner.value, (start.copy(), *inner.memory))

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project(self._inner(estimate), q)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner rates, and of the value what leaks."""
        rate, start = self.inner.rate(self._inner(estimate), drive), estimate.memory[0]
        leaking = rate.value + self._flow(estimate, drive)
        return Estimate(leaking, (np.zeros(start.size), *rate.memory))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s], mixed with the start."""
        start = estimate.memory[0]
        after = self.inner.step(self._inner(estimate), drive, dt)
        share = -math.expm1(-self.leaking(drive) * dt)
        return Estimate(after.value + share * (start - after.value), (start, *after.memory))

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(self._inner(estimate), truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt, and -lambda da^T Gamma^-1 (a - a_0)."""
        inner, flow = self._inner(estimate), self._flow(estimate, drive)
        return self.inner.dissipation(inner, drive, truth) + self.inner.power(inner, flow, truth)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(self._inner(estimate))

    def _flow(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return -lambda (a - a_0) (p)."""
        return np.asarray(self.leaking(drive) * (estimate.memory[0] - estimate.value))

    def _inner(self, estimate: Estimate) -> Estimate:
        """Return the estimate with what the inner adaptation remembers."""
        return Estimate(estimate.value, estimate.memory[1:])


def checked_size(size: ArrayLike, where: str) -> np.ndarray:
    """Return a number or k of them as an array.

    Raises:
        GainError: one of them is not positive.
    """
    given = numbers(size, where, error=GainError)
    if given.ndim > 1 or not (given > 0.0).all():
        raise GainError("expected a positive number, or one for each error.", where=where)
    return given


def error_size(e: np.ndarray, size: np.ndarray) -> float:
    """Return the root mean square of e (k) over its size, a number or (k); zero of none."""
    ratio = e / size
    return math.sqrt(float(ratio.dot(ratio)) / ratio.size) if ratio.size else 0.0


class ErrorLeak(Leak):
    """da/dt = (inner rate) - lambda |e| (a - a_0), |e| the error over its size: e1 modification.

    A ``Leak`` costs accuracy where nothing is wrong any more; this one ceases with the error, so
    that with a disturbance that vanishes the true parameters are an equilibrium, and a motion that
    excites them leads there. It leaks most while the loop is upset, and least when nobody would
    notice a drift: a small error that noise keeps up drives the estimate as far as noise over
    lambda, whatever its size.

    dV/dt gains -lambda |e| da^T Gamma^-1 (a - a_0), an equality; for a constant Gamma at most
    -lambda |e| (D(a) - D(a_0)), so both the error's and the parameters' part of dV/dt are negative
    outside of a bounded set under a bounded disturbance. K. Narendra, A. Annaswamy, *A new adaptive
    law for robust adaptation without persistent excitation*, IEEE TAC 32 (1987) 134-145, whose leak
    -Gamma nu |e| a goes to zero.

    Attributes:
        bandwidth: lambda [1/s], at an error of its size.
        size: (k) or a number, in units of the drive's e; |e| is the root mean square of e over it.
    """

    sources = ("NarendraAnnaswamy1987",)

    def __init__(self, inner: Adaptation, bandwidth: float, size: ArrayLike) -> None:
        """Take the adaptation to wrap, any, lambda [1/s] and the error's size.

        Raises:
            GainError: one of them is not positive.
        """
        super().__init__(inner, bandwidth)
        self.size = checked_size(size, "e1")

    def leaking(self, drive: Drive) -> float:
        """Return lambda |e| [1/s] under a drive; zero where its error is disregarded."""
        e: np.ndarray | None = drive.e
        return 0.0 if e is None else self.bandwidth * error_size(e, self.size)


class DeadZone(Wrapper):
    """Any adaptation, driven by errors less a dead zone: e (1 - 1 / |e|) where |e| > 1, else zero.

    |e| is the root mean square of e over its size, and |r| that of the prediction error. Continuous
    in the errors and without hysteresis; large errors lose one size of theirs.

    The inner adaptation's part of V stays, and dV/dt gains da^T (g - g_zone), g_zone the gradient
    that is left, an equality. With a measured r = W da + n the prediction's part of dV/dt is then
    -phi (r - n)^T R r <= -phi |r|_R (|r|_R - |n|_R), phi = max(0, 1 - 1 / |r|): with R = diag(1 /
    size^2) up to a factor and noise |n| <= 1 it never raises V, whatever n is, which without the
    zone it does. Of the tracking part dV/dt gains da^T Y^T e min(1, 1 / |e|), of any sign, bounded
    by |Y da| times the zone: V falls to a level of that size. B. Peterson, K. Narendra, *Bounded
    error adaptive control*, IEEE TAC 27 (1982) 1161-1168.

    What it is for: inside the zone estimates rest, so what noise, late frames, friction or elastic
    joints leave as a steady error below its size does not drive them away. What it costs: nothing
    is learned from errors that small, so the loop ends at about the size.

    Attributes:
        inner: the adaptation that it wraps.
        size: (k) or a number, in units of the drive's e; None: no zone for the tracking error.
        residual: (l) or a number, in units of the prediction error; None: no zone for that.
    """

    sources = ("PetersonNarendra1982",)

    def __init__(
        self, inner: Adaptation, size: ArrayLike | None, residual: ArrayLike | None = None
    ) -> None:
        """Take the adaptation to wrap, any, and the sizes of its errors.

        Raises:
            GainError: sizes that are not positive, or none.
        """
        super().__init__(inner)
        if size is None and residual is None:
            raise GainError("give the size of an error.", where="dead-zone")
        self.size = None if size is None else checked_size(size, "dead-zone")
        self.residual = None if residual is None else checked_size(residual, "dead-zone")

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner rates under what is left of the errors."""
        return self.inner.rate(estimate, self._left(drive))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s] under what is left of the errors."""
        return self.inner.step(estimate, self._left(drive), dt)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt, and da^T (g - g_zone)."""
        left = self._left(drive)
        missing = (estimate.value - truth) @ (drive.gradient - left.gradient)
        return float(missing) + self.inner.dissipation(estimate, left, truth)

    def _left(self, drive: Drive) -> Drive:
        """Return the drive by what is left of its errors."""
        return drive.scaled(_share(drive.e, self.size), _share(drive.residual, self.residual))


def _share(error: np.ndarray | None, size: np.ndarray | None) -> float:
    """Return 1 - 1 / |e|, zero inside the zone, one where there is none."""
    if error is None or size is None:
        return 1.0
    length = error_size(error, size)
    return 1.0 - 1.0 / length if length > 1.0 else 0.0


class Normalised(Wrapper):
    """Any adaptation, driven by Y^T e / m_Y^2 + W^T R r / m_W^2, m_Y^2 = 1 + tr(Y Gamma Y^T) / c.

    However large the regressor, what the estimate's rate does to the torque is bounded, |Y da/dt|
    <= c |e|, and with it what a burst of the error, a fast motion or a wrong sample can do
    (P. Ioannou, J. Sun, *Robust Adaptive Control*, 1996, section 4.3). Gamma is that of the inner
    adaptation with an empty memory.

    The inner adaptation's part of V stays, and dV/dt gains da^T (g - g / m^2), an equality. Of the
    prediction part -r^T R r becomes -r^T R r / m_W^2: still no more than zero. Of the tracking part
    it is da^T Y^T e (1 - 1 / m_Y^2), of any sign: with V_e / m_Y^2 in place of the law's part V_e
    of V it vanishes, and dV/dt gains -2 (dm_Y/dt) V_e / m_Y^3 instead, which the law's own decay of
    V_e outweighs while m_Y falls slower than that. It goes with regressors that change slower than
    the loop settles.

    Attributes:
        inner: the adaptation that it wraps.
        size: c, the tr(Y Gamma Y^T) at which the adaptation is half as fast.
    """

    sources = ("IoannouSun1996",)

    def __init__(self, inner: Adaptation, size: float) -> None:
        """Take the adaptation to wrap, any, and the size of its regressors.

        Raises:
            GainError: not positive.
        """
        super().__init__(inner)
        self.size = positive(size, "normalised")

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner rates under the normalised drive."""
        return self.inner.rate(estimate, self._normalised(estimate, drive))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s] under the normalised drive."""
        return self.inner.step(estimate, self._normalised(estimate, drive), dt)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt, and da^T (g - g / m^2)."""
        slower = self._normalised(estimate, drive)
        missing = (estimate.value - truth) @ (drive.gradient - slower.gradient)
        return float(missing) + self.inner.dissipation(estimate, slower, truth)

    def _normalised(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with each part over its m^2."""
        of_W = 1.0 if drive.W is None else self._share(estimate.value, drive.W)
        return drive.scaled(self._share(estimate.value, drive.Y), of_W)

    def _share(self, value: np.ndarray, Y: np.ndarray) -> float:
        """Return 1 / m^2 at a value (p) for a regressor (k, p)."""
        trace = float(np.sum(Y.T * self.inner.gain_times(value, Y.T)))
        return 1.0 / (1.0 + trace / self.size)
