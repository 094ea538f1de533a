"""How well parameters predict a motion, and one that they were not learned from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Errors(NamedTuple):
    """Root mean squares of n joints or m coordinates; held out: of what was not learned from.

    Attributes:
        size: (n) of what is predicted, less its mean where that says nothing; [N m, N or m].
        described: (n) error of the description, of all.
        learned: (n) error of the estimate from all, of all.
        described_held_out: (n) error of the description, held out.
        learned_held_out: (n) error of the estimate from the first part, held out.
    """

    size: np.ndarray
    described: np.ndarray
    learned: np.ndarray
    described_held_out: np.ndarray
    learned_held_out: np.ndarray

    @property
    def gain(self) -> float | None:
        """How many times less the held-out error is, of all together; None where nothing was."""
        before, after = rms(self.described_held_out), rms(self.learned_held_out)
        return None if not np.isfinite(before) or not after > 0.0 else before / after

    def summary(self) -> dict[str, list[float] | float | None]:
        """Return all numbers for a file; None where there are none."""
        rows: dict[str, list[float] | float | None] = {
            name: part.tolist() if np.isfinite(part).all() else None
            for name, part in self._asdict().items()
        }
        return rows | {"gain": self.gain}


def rms(values: np.ndarray) -> float:
    """Return the root mean square of all numbers; NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else np.nan


def columns_rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column of (N, n); NaN of none."""
    if not len(values):
        return np.full(values.shape[1], np.nan)
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
