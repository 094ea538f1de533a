"""Adaptation that slows down where the regressor is large."""

from __future__ import annotations

import numpy as np

from .._checks import positive
from ..bibliography import IOANNOU_SUN
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate


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

    sources = (IOANNOU_SUN,)

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
