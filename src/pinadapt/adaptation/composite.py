"""Composite adaptation: the tracking error and the prediction error of the torque together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive
from ..bibliography import SLOTINE_LI_COMPOSITE
from ..exceptions import GainError
from ..reference import Reference
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate
from .weight import DecayWeight, checked_weight, weight_of

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

    sources: tuple[Reference, ...] = (SLOTINE_LI_COMPOSITE,)

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
