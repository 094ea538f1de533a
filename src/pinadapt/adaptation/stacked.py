"""Several adaptations side by side, each for its own part of the estimate."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from .adaptation import Adaptation


class Stacked(Adaptation):
    """Adaptations of consecutive blocks of one estimate; V's part is the sum of theirs.

    Attributes:
        parts: the adaptations, in the order of their blocks.
    """

    def __init__(self, parts: Sequence[tuple[Adaptation, int]]) -> None:
        """Take adaptations with the sizes of their blocks; the first one gives the name."""
        ends = np.cumsum([0] + [size for _, size in parts])
        self.parts = [
            (part, slice(int(a), int(b)))
            for (part, _), (a, b) in zip(parts, pairwise(ends), strict=True)
        ]
        self.name = parts[0][0].name

    def admit(self, a: np.ndarray) -> np.ndarray:
        """Return the initial estimate (p), each block as its adaptation admits it."""
        return np.concatenate([part.admit(a[block]) for part, block in self.parts])

    def keep(self, a: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the estimate (p) to use at q, each block as its adaptation keeps it."""
        blocks = [part.keep(a[block], q) for part, block in self.parts]
        return a if all(kept.base is a for kept in blocks) else np.concatenate(blocks)

    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return da/dt (p)."""
        return np.concatenate([part.rate(a[block], g[block]) for part, block in self.parts])

    def advance(self, a: np.ndarray, g: np.ndarray, dt: float) -> np.ndarray:
        """Return the estimate (p) after dt [s] with g held."""
        return np.concatenate([part.advance(a[block], g[block], dt) for part, block in self.parts])

    def distance(self, a: np.ndarray, a_true: np.ndarray) -> float | None:
        """Return the sum of the blocks' parts of V, or None where one is undefined."""
        distances = [part.distance(a[block], a_true[block]) for part, block in self.parts]
        return (
            None
            if any(d is None for d in distances)
            else float(sum(d for d in distances if d is not None))
        )
