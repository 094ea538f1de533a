"""Adaptation that rests while the errors are no larger than their noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..bibliography import PETERSON_NARENDRA
from ..exceptions import GainError
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate
from .error_size import checked_size, error_size


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

    sources = (PETERSON_NARENDRA,)

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
