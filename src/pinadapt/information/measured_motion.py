"""Measured motion, from samples of a run or from a log, smoothed where the sensors are noisy.

A measured velocity is used as it is where it agrees with the measured positions. Where it does not,
or where there is none, positions pass a Butterworth low pass of order four, once forwards and once
backwards so that nothing is delayed, and velocity and acceleration are its derivatives.

Torques are never filtered. Whoever compares them with the motion averages both over a window, in
which the noise of the torque is independent. The cutoff is chosen there, well above the band of the
window, so that the low pass removes nothing that is compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..controller.state import Sample

CUTOFF = 15.0  # [Hz] for noisy positions, above the band of a window
LENGTH = 0.2  # [s] of a window, which is at half (-6 dB) at 6.5 Hz
OVERLAP = 3  # windows at any time
_FEWEST = 16  # samples in a window, which is longer for a log of a lower rate
_GAP = 8  # the longest gap between two samples in a window, as so many parts of its length
_CHUNK = 250  # samples whose regressors are in memory at once

_ORDER = 4
_SETTLING = 0.1  # [s] left out at both ends, where the low pass has data on one side only
_FASTEST = 0.4  # of the sampling rate: the highest cutoff
_SHORTEST = 10.0 * _SETTLING  # [s] of a run that is smoothed

# Relative difference, root mean square, up to which the velocities of a run are those of the
# positions. Half: noise of encoders smooths them; twice: filtered velocities pass.
_TOLERANCE = 1e-3


class MeasuredMotion(NamedTuple):
    """Measured motion and torque at N instants.

    Attributes:
        t: (N) times [s].
        q: (N, nq) configurations.
        v, a: (N, n) velocities and accelerations [rad/s, rad/s^2 or m].
        tau: (N, n) torques of the joints [N m or N].
        smoothed: whether q passed the low pass, and v and a are its derivatives.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    smoothed: bool

    @property
    def period(self) -> float:
        """Mean time between the instants [s], zero for fewer than two."""
        return float(self.t[-1] - self.t[0]) / (len(self.t) - 1) if len(self.t) > 1 else 0.0


def motion_of_samples(
    model: pin.Model, samples: Sequence[Sample], *, cutoff: float
) -> MeasuredMotion:
    """Return the motion measured in samples of a constant rate, halfway between them.

    There the mean of both velocities and their difference over the period are exact to the square
    of the period for torques that are held.

    Args:
        model: of the chain.
        samples: of a run.
        cutoff: of the low pass [Hz]. Noisy runs that are shorter than a second or sampled at less
            than 2.5 times the cutoff are not smoothed.
    """
    t = np.array([sample.t for sample in samples])
    measured = [sample.measurement for sample in samples]
    steps = len(samples) - 1
    if steps < 2 or t[-1] <= t[0]:
        none = np.zeros((0, model.nv))
        return MeasuredMotion(np.zeros(0), np.zeros((0, model.nq)), none, none, none, False)
    period = float(t[-1] - t[0]) / steps
    halfway = t[:-1] + 0.5 * period
    q = np.array([one.q for one in measured])
    v = np.array([one.v for one in measured])
    tau = np.array([_torque(*both) for both in pairwise(samples)])
    moved = differences(model, q)
    mean = 0.5 * (v[:-1] + v[1:])
    long_enough = t[-1] - t[0] > _SHORTEST and cutoff * period < _FASTEST
    if agree(moved / period, mean, _TOLERANCE) or not long_enough:
        middle = [
            pin.integrate(model, start, 0.5 * part)
            for start, part in zip(q[:-1], moved, strict=True)
        ]
        a = np.diff(v, axis=0) / period
        return MeasuredMotion(halfway, np.array(middle), mean, a, tau, False)
    travelled = np.cumsum(moved, axis=0) - 0.5 * moved
    return smoothed(model, q[0], halfway, travelled, tau, period, cutoff)


def instants_of_samples(
    model: pin.Model, samples: Sequence[Sample], *, cutoff: float, window: float, most: int
) -> MeasuredMotion:
    """Return the motion of ``motion_of_samples`` at up to ``most`` instants, evenly chosen.

    Where measured velocities agree with the positions, only these instants are looked at. Where
    they do not, torques are averaged over a window around each.

    Args:
        model: of the chain.
        samples: of a run.
        cutoff: of the low pass for noisy positions [Hz].
        window: over which torques of a noisy run are averaged [s].
        most: instants.
    """
    count = len(samples) - 1
    chosen = np.unique(np.linspace(0, max(count - 1, 0), most).astype(int))
    pairs = [(samples[k], samples[k + 1]) for k in chosen if k < count]
    t, after = (np.array([pair[side].t for pair in pairs]) for side in (0, 1))
    if count < 2 or (after <= t).any():
        return motion_of_samples(model, (), cutoff=cutoff)
    measured = [(before.measurement, then.measurement) for before, then in pairs]
    moved = np.array([pin.difference(model, one.q, other.q) for one, other in measured])
    v, v_after = (np.array([both[side].v for both in measured]) for side in (0, 1))
    steps, mean = (after - t)[:, None], 0.5 * (v + v_after)
    if agree(moved / steps, mean, _TOLERANCE):
        q = [
            pin.integrate(model, one.q, 0.5 * d)
            for (one, _), d in zip(measured, moved, strict=True)
        ]
        tau = np.array([_torque(*pair) for pair in pairs])
        halfway = 0.5 * (t + after)
        return MeasuredMotion(halfway, np.array(q), mean, (v_after - v) / steps, tau, False)
    motion = motion_of_samples(model, samples, cutoff=cutoff)
    some = np.unique(np.linspace(0, len(motion.t) - 1, most).astype(int))
    half = max(round(0.5 * window / motion.period), 1)
    sums = np.vstack([np.zeros(model.nv), np.cumsum(motion.tau, axis=0)])
    first, last = np.maximum(some - half, 0), np.minimum(some + half + 1, len(motion.t))
    tau = (sums[last] - sums[first]) / (last - first)[:, None]
    t, q, v, a = (part[some] for part in motion[:4])
    return MeasuredMotion(t, q, v, a, tau, motion.smoothed)


def _torque(sample: Sample, after: Sample) -> np.ndarray:
    """Return the torque (n) between two samples: measured, or else as it was commanded."""
    measured = after.measurement.tau
    return sample.torque if measured is None else np.asarray(measured, dtype=float)


def differences(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Return how far the joints moved (N - 1, n) between configurations (N, nq) [rad or m]."""
    return np.array([pin.difference(model, *ends) for ends in pairwise(q)])


def agree(rates: np.ndarray, v: np.ndarray, tolerance: float) -> bool:
    """Return whether measured velocities (N, n) are the rates of the positions."""
    return bool(np.linalg.norm(rates - v) <= tolerance * np.linalg.norm(v))


def smoothed(
    model: pin.Model,
    start: np.ndarray,
    t: np.ndarray,
    travelled: np.ndarray,
    tau: np.ndarray,
    period: float,
    cutoff: float,
) -> MeasuredMotion:
    """Return the motion without what is faster than the cutoff [Hz], and without its ends.

    ``travelled`` (N, n) counts from the configuration ``start`` (nq). Times may be uneven: the low
    pass runs at even ones, ``period`` apart, and its output is interpolated.
    """
    from scipy.signal import butter, sosfiltfilt  # here, because scipy is slow to import

    even = np.linspace(t[0], t[-1], max(round((t[-1] - t[0]) / period) + 1, 2))
    step = even[1] - even[0]
    low_pass = butter(_ORDER, min(cutoff, _FASTEST / step), fs=1.0 / step, output="sos")
    path = sosfiltfilt(low_pass, _at(even, t, travelled), axis=0)
    v = np.gradient(path, step, axis=0)
    a = np.gradient(v, step, axis=0)
    settled = (t >= t[0] + _SETTLING) & (t <= t[-1] - _SETTLING)
    t, tau = t[settled], tau[settled]
    path, v, a = (_at(t, even, part) for part in (path, v, a))
    q = np.array([pin.integrate(model, start, part) for part in path])
    return MeasuredMotion(t, q, v, a, tau, True)


def _at(t: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (N, n) at times (N), interpolated at others (K): (K, n)."""
    return np.column_stack([np.interp(t, times, column) for column in values.T])


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


def _trapezoids(t: np.ndarray) -> np.ndarray:
    """Return the weight (N) [s] of each sample in an integral by trapezoids."""
    steps = np.diff(t)
    return 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))


def _without_gap(t: np.ndarray, middles: np.ndarray, length: float) -> np.ndarray:
    """Return for each window whether no two successive samples in it are too far apart."""
    gaps = np.flatnonzero(np.diff(t) > length / _GAP)
    starts, ends = t[gaps], t[gaps + 1]
    hit = (starts < middles[:, None] + 0.5 * length) & (ends > middles[:, None] - 0.5 * length)
    return np.asarray(~hit.any(axis=1))
