"""A leak of the estimate back to where it started: the sigma modification."""

from __future__ import annotations

import math

import numpy as np

from .._checks import positive
from ..bibliography import IOANNOU_KOKOTOVIC
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate


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

    sources = (IOANNOU_KOKOTOVIC,)

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

    def told(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return what the inner adaptation makes of an announced value (p); leak to ``start``."""
        told = self.inner.told(self._inner(estimate), value, start)
        return Estimate(told.value, (start.copy(), *told.memory))

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
