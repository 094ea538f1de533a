"""The task of several frames of one robot: the same coordinates of each, one controller for all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from .frame import FrameTask
from .task import RowGroup, Task


@dataclass(frozen=True)
class FramesTask(Task):
    """The positions, or the poses, of k frames, in world axes.

    x are the positions of all frames, in the order of the frames, then, for poses, their
    quaternions xyzw in the same order; errors, velocities and accelerations are the linear rows of
    all frames, then the angular ones. Frames have priority in their order, see ``RightInverse``.

    Attributes:
        frames: their names (k).
        ids: (k) their indices in the model.
        part: the task of each.
    """

    frames: tuple[str, ...]
    ids: tuple[int, ...]
    part: FrameTask

    @classmethod
    def of(cls, part: FrameTask, frames: Mapping[str, int]) -> FramesTask:
        """Return the task of frames, name -> index in the model, with the same coordinates each."""
        own = [np.array([f"{frame}.{label}" for label in part.labels]) for frame in frames]
        labels = tuple(joined(own, part.positions).tolist())
        return cls(part.name, labels, tuple(frames), tuple(frames.values()), part)

    @property
    def coordinates(self) -> int:
        """Number of coordinates x: k times those of one frame."""
        return len(self.frames) * self.part.coordinates

    @property
    def positions(self) -> int:
        """The positions of all frames."""
        return len(self.frames) * self.part.positions

    @cached_property
    def levels(self) -> np.ndarray:
        """The place of each row's frame (m)."""
        return self.joined([np.full(self.part.size, float(k)) for k in range(len(self.frames))])

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """The positions of all frames, then all rotations."""
        k = len(self.frames)
        return tuple(
            group._replace(rows=slice(k * group.rows.start, k * group.rows.stop))
            for group in self.part.groups
        )

    def parts(self, x: np.ndarray) -> Iterator[np.ndarray]:
        """Return the coordinates, or the rows, of each frame."""
        return parts_of(x, len(self.frames), self.part.positions)

    def joined(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Return the coordinates, or the rows, of all frames, given those of each."""
        return joined(parts, self.part.positions)

    def _both(
        self, found: Iterable[tuple[np.ndarray, np.ndarray]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return two arrays of all frames, given those of each."""
        first, second = map(self.joined, zip(*found, strict=True))
        return first, second

    def _each(self, call: Callable[..., Any], *given: np.ndarray) -> np.ndarray:
        """Return what a function makes of the parts of some coordinates or rows, joined."""
        return self.joined(list(map(call, *map(self.parts, given))))

    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x and the task velocity (m) at q (nq) and v (nv)."""
        return self._both(self.part.motion(model, data, own, q, v) for own in self.ids)

    def linear_map(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x and the task Jacobian (m, nv) at q (nq)."""
        return self._both(self.part.linear_map(model, data, own, q) for own in self.ids)

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return the error dx (m) of x from x_d."""
        return self._each(self.part.error, x, x_d)

    def drift(self, dx: np.ndarray, xd_hat: np.ndarray, xd_d: np.ndarray) -> np.ndarray | None:
        """Return delta (m), as of each frame; None without rotations."""
        if self.size == self.positions:
            return None
        return self._each(self.part.drift, dx, xd_hat, xd_d)

    def turn(self, x_hat: np.ndarray, x: np.ndarray, before: Any = None, share: float = 0.0) -> Any:
        """Return the rotation of each frame from the estimated to the measured orientation."""
        given = self.parts(x_hat), self.parts(x), before or [None] * len(self.frames)
        return [self.part.turn(*own, share) for own in zip(*given, strict=True)]

    def carried(self, x_hat: np.ndarray, epsilon: np.ndarray, turn: Any) -> np.ndarray:
        """Return estimated coordinates corrected by an error epsilon (m_p) [m] and rotations."""
        errors = np.split(epsilon, len(self.frames))
        return self.joined(list(map(self.part.carried, self.parts(x_hat), errors, turn)))

    def moved(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the coordinates displaced from x by ``by`` (m), their error from x."""
        return self._each(self.part.moved, x, by)

    def flaw(self, x: np.ndarray) -> str | None:
        """Return what is wrong with finite coordinates x, or None."""
        return next(filter(None, map(self.part.flaw, self.parts(x))), None)


def parts_of(x: np.ndarray, count: int, positions: int) -> Iterator[np.ndarray]:
    """Yield the coordinates of each of so many frames, the first so many of each positions."""
    first = count * positions
    rest = (len(x) - first) // count
    for k in range(count):
        places = x[k * positions : (k + 1) * positions]
        yield np.concatenate([places, x[first + k * rest : first + (k + 1) * rest]])


def joined(parts: Sequence[np.ndarray], positions: int) -> np.ndarray:
    """Return coordinates or rows of several frames, given those of each, positions first."""
    return np.concatenate([part[:positions] for part in parts] + [p[positions:] for p in parts])
