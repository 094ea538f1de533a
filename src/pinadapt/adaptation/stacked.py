"""Several adaptations side by side, each of its own block of the estimate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy import concatenate

from .._checks import instance, whole
from ..exceptions import InputError
from .adaptation import Adaptation, Drive, Estimate


class Stacked(Adaptation):
    """Adaptations of consecutive blocks of one estimate; its part of V is the sum of theirs.

    Attributes:
        parts: the adaptations, in the order of their blocks.
    """

    def __init__(self, parts: Sequence[tuple[Adaptation, int]]) -> None:
        """Stack pairs of an adaptation and the size of its block; the first gives the name.

        Raises:
            InputError: no pair, or something that is not a pair of adaptation and size.
        """
        for given in instance(parts, Sequence, "parts"):
            part, size = given if isinstance(given, tuple) and len(given) == 2 else (given, 0)
            instance(part, Adaptation, "parts")
            whole(size, "parts", 0)
        if not parts:
            raise InputError("expected at least one adaptation.", where="parts")
        ends = np.cumsum([0] + [size for _, size in parts])
        self.parts = [
            (part, slice(int(a), int(b)))
            for (part, _), (a, b) in zip(parts, pairwise(ends), strict=True)
        ]
        self._size, self.name = int(ends[-1]), parts[0][0].name
        self._forgetful = ((),) * len(parts)
        self.torque_bandwidth = next(
            (p.torque_bandwidth for p, _ in self.parts if p.torque_bandwidth), None
        )
        self.updates_gain = any(part.updates_gain for part, _ in self.parts)
        self._projects = any(type(p).project is not Adaptation.project for p, _ in self.parts)

    def init(self, value: np.ndarray) -> Estimate:
        """Return the estimate to start from; its memory holds one memory a block."""
        return self._joined(part.init(value[block]) for part, block in self.parts)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p), each block validated by its adaptation."""
        return np.concatenate([part.validate(value[block]) for part, block in self.parts])

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether each block of a value (p) is in the domain of its adaptation."""
        return all(part.contains(value[block]) for part, block in self.parts)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) to use at q (nq), each block projected by its adaptation."""
        value = estimate.value
        if not self._projects:
            return value
        split = list(self._split(estimate))
        blocks = [part.project(own, q) for part, _, own in split]
        same = (kept is own.value for kept, (_, _, own) in zip(blocks, split, strict=True))
        return value if all(same) else np.concatenate(blocks)

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the estimate with each block reset by its adaptation to an announced value."""
        return self._joined(
            part.reset_to(own, value[block], start[block])
            for part, block, own in self._split(estimate)
        )

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the rates of all blocks."""
        return self._joined(
            part.rate(own, drive.columns(block)) for part, block, own in self._split(estimate)
        )

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        value, own = estimate.value, estimate.memory or self._forgetful
        drives = [drive.columns(block) for _, block in self.parts]
        values, memories = [], []
        for (part, block), memory, its_drive in zip(self.parts, own, drives, strict=True):
            after, kept = part.step(Estimate(value[block], memory), its_drive, dt)
            values.append(after)
            memories.append(kept)
        return Estimate(concatenate(values), tuple(memories))

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the sum of the blocks' parts of V, or None where one is undefined."""
        parts = [part.divergence(value[block], truth[block]) for part, block in self.parts]
        return (
            None if any(d is None for d in parts) else float(sum(d for d in parts if d is not None))
        )

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the sum of the blocks' parts of V, or None where one is undefined."""
        parts = [part.storage(own, truth[block]) for part, block, own in self._split(estimate)]
        known = [part for part in parts if part is not None]
        return float(sum(known)) if len(known) == len(parts) else None

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return the sum of what the blocks' adaptations add to dV/dt."""
        blocks = self._split(estimate)
        return float(sum(p.dissipation(own, drive.columns(b), truth[b]) for p, b, own in blocks))

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), block by block."""
        blocks = [part.gain_times(value[block], X[block]) for part, block in self.parts]
        return np.concatenate(blocks)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return Gamma (p, p) at an estimate with its memory, block by block."""
        Gamma = np.zeros((self._size, self._size))
        for part, block, own in self._split(estimate):
            Gamma[block, block] = part.metric(own)
        return Gamma

    def references(self) -> tuple[str, ...]:
        """Return the sources of all parts, in their order."""
        return tuple(source for part, _ in self.parts for source in part.references())

    def _split(self, estimate: Estimate) -> Iterator[tuple[Adaptation, slice, Estimate]]:
        """Return each adaptation with its block and that block's estimate."""
        memories = estimate.memory or self._forgetful
        for (part, block), memory in zip(self.parts, memories, strict=True):
            yield part, block, Estimate(estimate.value[block], memory)

    def _joined(self, estimates: Iterable[Estimate]) -> Estimate:
        """Return the estimates of all blocks as one."""
        value, memories = np.empty(self._size), []
        for (_, block), (part, memory) in zip(self.parts, estimates, strict=True):
            value[block] = part
            memories.append(memory)
        return Estimate(value, tuple(memories))
