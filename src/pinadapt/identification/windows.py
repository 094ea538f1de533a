"""Averages of a recorded motion over overlapping windows: equations without accelerations.

The equations of motion are averaged over windows phi(t), with the momentum p = Y_M a + p_0
integrated by parts (Shinbrot 1957):

    int phi tau dt = int (phi (Y_0 a + tau_0) - phi' (Y_M a + p_0)) dt.

Each window is one row W a = y for each joint.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..information.measured_motion import MeasuredMotion
from ..models.dynamics import Dynamics
from ..models.regressor import Momentum

LENGTH = 0.2  # [s] of a window, which is at half (-6 dB) at 6.5 Hz
OVERLAP = 3  # windows at any time
_FEWEST = 16  # samples in a window, which is longer for a log of a lower rate
_GAP = 8  # the longest gap between two samples in a window, as so many parts of its length
_CHUNK = 250  # samples whose regressors are in memory at once


class Windows(NamedTuple):
    """Averages over N windows of a motion.

    Attributes:
        t: (N) times of their middles [s].
        W: (N, n, p) regressor.
        y: (N, n) torque without its known part [N m or N].
        tau: (N, n) torque [N m or N].
        length: of a window [s].
    """

    t: np.ndarray
    W: np.ndarray
    y: np.ndarray
    tau: np.ndarray
    length: float

    def between(self, first: float, last: float) -> Windows:
        """Return the windows that lie wholly between two times [s]."""
        half = 0.5 * self.length
        kept = (self.t - half >= first) & (self.t + half <= last)
        return Windows(self.t[kept], self.W[kept], self.y[kept], self.tau[kept], self.length)

    def residual(self, a: np.ndarray) -> np.ndarray:
        """Return y - W a (N, n) [N m or N] at parameters a (p)."""
        return np.asarray(self.y - self.W @ a)


class Chunk(NamedTuple):
    """Successive samples, and their weights in the windows that contain some of them.

    Attributes:
        samples: M of them.
        near: (k) indices of the windows.
        phi, rate: (k, M) weights in integrals of phi and of its derivative [1, 1/s].
    """

    samples: slice
    near: np.ndarray
    phi: np.ndarray
    rate: np.ndarray


class Averages:
    """Averages of signals over the windows of a motion.

    Attributes:
        chunks: of all samples, with their weights.
        t: (K) times of the middles of all windows [s].
        length: of a window [s].
        whole: (K) whether a window has no gap.
    """

    def __init__(self, t: np.ndarray, period: float) -> None:
        """Lay windows over samples at times t (N), typically ``period`` apart [s]."""
        self.length = length = max(LENGTH, _FEWEST * period)
        count = max(int(np.floor((t[-1] - t[0]) / length * OVERLAP)) - OVERLAP + 1, 0)
        self.t = t[0] + 0.5 * length + np.arange(count) * length / OVERLAP
        self.whole = _without_gap(t, self.t, length)
        first = np.searchsorted(t, self.t - 0.5 * length, side="right")
        last = np.searchsorted(t, self.t + 0.5 * length)
        weights = _trapezoids(t)
        self.chunks: list[Chunk] = []
        for start in range(0, len(t), _CHUNK):
            part = slice(start, min(start + _CHUNK, len(t)))
            near = np.flatnonzero((last > part.start) & (first < part.stop))
            away = t[part] - self.t[near, None]
            inside = (np.abs(away) < 0.5 * length) * weights[part]
            phi, rate = _window(away, length)
            self.chunks.append(Chunk(part, near, phi * inside, rate * inside))

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the averages (K, ...) of values (N, ...) at the samples."""
        return self._sums(values, derivative=False)

    def rate(self, values: np.ndarray) -> np.ndarray:
        """Return the averages (K, ...) of the time derivative of values (N, ...)."""
        return -self._sums(values, derivative=True)

    def _sums(self, values: np.ndarray, *, derivative: bool) -> np.ndarray:
        """Return the integrals (K, ...) of phi, or of its derivative, times values (N, ...)."""
        found = np.zeros((len(self.t), *values.shape[1:]))
        for part, near, phi, rate in self.chunks:
            found[near] += np.tensordot(rate if derivative else phi, values[part], axes=1)
        return found


def windows_of(
    motion: MeasuredMotion,
    dynamics: Dynamics,
    period: float,
    *,
    held: bool,
    inertial: Windows | None = None,
) -> Windows:
    """Return the windows of a motion that have no gap.

    Args:
        motion: the samples.
        dynamics: of the unknown parameters.
        period: typical time between samples [s].
        held: whether torques were held from each sample to the next; else each is of its instant.
        inertial: the windows of its inertial block alone, if they are known already.
    """
    averages, n = Averages(motion.t, period), motion.v.shape[1]
    whole, t = averages.whole, averages.t[averages.whole]
    if inertial is None:
        W, y = _equations(motion, averages, dynamics.momentum, dynamics.size)
        if held:
            tau = _held_torques(motion, averages.t, averages.length)
        else:
            tau = averages.mean(motion.tau)
        return Windows(t, W[whole], (tau - y)[whole], tau[whole], averages.length)
    joints = dynamics.joints
    if joints is None:
        return inertial
    none = Momentum(np.zeros((n, 0)), np.zeros((n, 0)), np.zeros(n), np.zeros(n))

    def momentum(q: np.ndarray, v: np.ndarray) -> Momentum:
        return joints.momentum(q, v, none)

    W, y = _equations(motion, averages, momentum, joints.size)
    both = np.concatenate([inertial.W, W[whole]], axis=2)
    return inertial._replace(W=both, y=inertial.y - y[whole])


def _equations(
    motion: MeasuredMotion,
    averages: Averages,
    momentum: Callable[[np.ndarray, np.ndarray], Momentum],
    size: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return W (K, n, p), p = ``size``, and the averages (K, n) of the known part of the torque."""
    K, n = len(averages.t), motion.v.shape[1]
    W, known = np.zeros((K, n, size)), np.zeros((K, n))
    for part, near, phi, rate in averages.chunks:
        count = part.stop - part.start
        moving, rest = np.empty((2, count, n, size + 1))
        for k in range(count):
            Y_M, Y_0, p_0, tau_0 = momentum(motion.q[part.start + k], motion.v[part.start + k])
            moving[k, :, :size], moving[k, :, size] = Y_M, p_0
            rest[k, :, :size], rest[k, :, size] = Y_0, tau_0
        both = np.tensordot(phi, rest, axes=1) - np.tensordot(rate, moving, axes=1)
        W[near] += both[:, :, :size]
        known[near] += both[:, :, size]
    return W, known


def _window(s: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return phi = 8 / (3 L) cos^4(pi s / L) of integral one, and phi', at times s from its middle.

    Its first three derivatives vanish at the ends, so that sums are integrals to the fourth power
    of the period.
    """
    angle = np.pi * s / length
    height = 8.0 / (3.0 * length)
    cos = np.cos(angle)
    square = cos * cos
    return height * square * square, -4.0 * height * np.pi / length * square * cos * np.sin(angle)


def _integral(s: np.ndarray, length: float) -> np.ndarray:
    """Return int phi from the left end of a window to times s from its middle, zero to one."""
    angle = np.pi * np.clip(s, -0.5 * length, 0.5 * length) / length
    whole = 3.0 * angle + 2.0 * np.sin(2.0 * angle) + 0.25 * np.sin(4.0 * angle)
    return np.asarray(0.5 + whole / (3.0 * np.pi))


def _trapezoids(t: np.ndarray) -> np.ndarray:
    """Return the weight (N) [s] of each sample in an integral by trapezoids."""
    steps = np.diff(t)
    return 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))


def _held_torques(motion: MeasuredMotion, middles: np.ndarray, length: float) -> np.ndarray:
    """Return int phi tau dt (N, n) of torques that are held from each sample to the next."""
    found = np.zeros((len(middles), motion.tau.shape[1]))
    for k, middle in enumerate(middles):
        first, last = np.searchsorted(motion.t, (middle - 0.5 * length, middle + 0.5 * length))
        part = slice(max(first - 1, 0), last + 1)
        weights = np.diff(_integral(motion.t[part] - middle, length))
        found[k] = weights @ motion.tau[part][: len(weights)]
    return found


def _without_gap(t: np.ndarray, middles: np.ndarray, length: float) -> np.ndarray:
    """Tell of each window whether no two successive samples in it are too far apart."""
    gaps = np.flatnonzero(np.diff(t) > length / _GAP)
    starts, ends = t[gaps], t[gaps + 1]
    hit = (starts < middles[:, None] + 0.5 * length) & (ends > middles[:, None] - 0.5 * length)
    return np.asarray(~hit.any(axis=1))
