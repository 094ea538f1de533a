"""No adaptation: the estimate stays what it was."""

from __future__ import annotations

import numpy as np

from .adaptation import Adaptation


class Frozen(Adaptation):
    """da/dt = 0, the baseline against which learning is measured."""

    name = "none"

    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return zero (p)."""
        return np.zeros_like(a)

    def advance(self, a: np.ndarray, g: np.ndarray, dt: float) -> np.ndarray:
        """Return ``a``."""
        return a

    def distance(self, a: np.ndarray, a_true: np.ndarray) -> float | None:
        """Return 0 for a right estimate, None for a wrong one: no Lyapunov function is claimed for that."""
        return 0.0 if np.allclose(a, a_true, rtol=1e-12, atol=1e-12) else None
