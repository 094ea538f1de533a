"""Joint friction of a real robot, which Pinocchio's dynamics leave out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._checks import numbers, positive, whole
from ..exceptions import RobotError


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

    def __post_init__(self) -> None:
        """Refuse what is no friction.

        Raises:
            RobotError: negative coefficients, not one of each a joint, or a threshold that is not
                positive.
        """
        for name in ("viscous", "coulomb"):
            given = numbers(getattr(self, name), f"friction.{name}", error=RobotError)
            if given.ndim != 1 or (given < 0.0).any():
                raise RobotError(
                    f"expected one number a joint, none of them negative, got {given.tolist()}.",
                    where=f"friction.{name}",
                )
            object.__setattr__(self, name, given)
        if self.viscous.size != self.coulomb.size:
            raise RobotError("viscous and coulomb differ in size.", where="friction")
        threshold = positive(self.threshold, "friction.threshold", error=RobotError)
        object.__setattr__(self, "threshold", threshold)

    @cached_property
    def present(self) -> bool:
        """Whether any joint has friction."""
        return bool(self.viscous.any() or self.coulomb.any())

    @classmethod
    def none(cls, nv: int) -> Friction:
        """Return no friction at nv joints."""
        joints = whole(nv, "friction", 0, RobotError)
        return cls(np.zeros(joints), np.zeros(joints))

    def torque(self, v: np.ndarray) -> np.ndarray:
        """Return the torque (nv) that friction takes at joint velocity v (nv)."""
        return self.viscous * v + self.coulomb * np.tanh(v / self.threshold)
