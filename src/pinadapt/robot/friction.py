"""Joint friction of a real robot, which Pinocchio's dynamics leave out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Friction:
    """Viscous and Coulomb friction, tau_f = diag(viscous) v + diag(coulomb) tanh(v / threshold).

    Attributes:
        viscous: (nv) N m s/rad or N s/m.
        coulomb: (nv) N m or N.
        threshold: speed [rad/s or m/s] at which the smoothed sign reaches tanh(1).
    """

    viscous: np.ndarray
    coulomb: np.ndarray
    threshold: float = 0.01

    @cached_property
    def present(self) -> bool:
        """Whether any joint has friction."""
        return bool(self.viscous.any() or self.coulomb.any())

    @classmethod
    def none(cls, nv: int) -> Friction:
        """Return no friction at nv joints."""
        return cls(np.zeros(nv), np.zeros(nv))

    def torque(self, v: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that friction takes at joint velocity v (nv)."""
        return self.viscous * v + self.coulomb * np.tanh(v / self.threshold)
