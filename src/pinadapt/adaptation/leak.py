"""A leak of the estimate back to where it started."""

from __future__ import annotations

import math

import numpy as np

from .._checks import positive
from ..bibliography import IOANNOU_KOKOTOVIC
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate


class Leak(Wrapper):
    """da/dt = (inner rate) - lambda (a - a_0), a_0 the initial value.

    Noise of the joint velocities has a mean in Y^T s, and what motion does not excite follows it
    without bound; a leak bounds it, and is nothing against the rate at which excited directions
    learn. A step mixes the inner one's result with a_0, so it stays in every convex domain that
    holds both.

    The inner adaptation's part of V stays, and dV/dt gains -lambda dD/da (a - a_0), which is not
    negative everywhere: errors end in a neighbourhood of zero that shrinks with lambda (P. Ioannou,
    P. Kokotovic, *Instability analysis and improvement of robustness of adaptive control*,
    Automatica 20 (1984) 583-594, whose sigma modification leaks to zero).

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

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, which is remembered."""
        estimate = self.inner.init(value)
        return Estimate(estimate.value, (estimate.value.copy(), *estimate.memory))

    def told(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return what the inner adaptation makes of an announced value (p); leak to ``start``."""
        told = self.inner.told(self._inner(estimate), value, start)
        return Estimate(told.value, (start.copy(), *told.memory))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner rates, and of the value what leaks."""
        a, start = estimate.value, estimate.memory[0]
        rate = self.inner.rate(self._inner(estimate), drive)
        leaking = rate.value - self.bandwidth * (a - start)
        return Estimate(leaking, (np.zeros(start.size), *rate.memory))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s], mixed with the start."""
        start = estimate.memory[0]
        after = self.inner.step(self._inner(estimate), drive, dt)
        share = -math.expm1(-self.bandwidth * dt)
        return Estimate(after.value + share * (start - after.value), (start, *after.memory))

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(self._inner(estimate), truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt; what leaks is not in it."""
        return self.inner.dissipation(self._inner(estimate), drive, truth)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project(self._inner(estimate), q)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(self._inner(estimate))

    def _inner(self, estimate: Estimate) -> Estimate:
        """Return the estimate with what the inner adaptation remembers."""
        return Estimate(estimate.value, estimate.memory[1:])
