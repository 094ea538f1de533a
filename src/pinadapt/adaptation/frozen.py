"""No adaptation: the estimate stays what it was."""

from __future__ import annotations

import numpy as np

from .adaptation import Adaptation
from .drive import Drive, Estimate


class Frozen(Adaptation):
    """da/dt = 0, the baseline against which learning is measured."""

    name = "none"

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return zero (p)."""
        return Estimate(np.zeros(estimate.value.size))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate."""
        return estimate

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return 0 for a right estimate, None for a wrong one, for which no V is claimed."""
        return 0.0 if np.allclose(value, truth, rtol=1e-12, atol=1e-12) else None
