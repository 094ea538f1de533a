"""How an estimate follows its gradient signal: da/dt = -Gamma g in some metric."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np


class Adaptation(ABC):
    """The law da/dt = -Gamma(a) g of an estimate a (p), g (p) = (regressor)^T (error) from the control law.

    Every control law here proves dV/dt <= 0 with any adaptation for which ``distance`` D obeys
    dD/dt = (a - a_true)^T (-g): the metric is free. Laws and adaptations therefore combine freely.

    Attributes:
        name: as written in scenarios.
    """

    name: str

    def admit(self, a: np.ndarray) -> np.ndarray:
        """Return the initial estimate to start from: ``a`` itself, or moved (with a warning) to where the law is defined."""
        return a

    def keep(self, a: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the estimate (p) to use at configuration q (nq): ``a`` itself, or a point closer to every possible truth."""
        return a

    @abstractmethod
    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return da/dt (p)."""

    def advance(self, a: np.ndarray, g: np.ndarray, dt: float) -> np.ndarray:
        """Return the estimate (p) after a sampling period dt [s] with g held."""
        return a + dt * self.rate(a, g)

    @abstractmethod
    def distance(self, a: np.ndarray, a_true: np.ndarray) -> float | None:
        """Return this adaptation's part of V, or None where it is undefined."""
