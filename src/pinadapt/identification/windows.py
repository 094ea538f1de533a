"""Rows W a = y of a recorded motion, through windows that need no acceleration.

The torque is the rate of a momentum and a rest, tau = d/dt (Y_M a + p_0) + Y_0 a + tau_0 (see
``MomentumRegressor``). Weighed by a window phi that vanishes smoothly at both ends, and integrated
by parts,

    y = int phi (tau - tau_0) + phi' p_0 dt,        W = int phi Y_0 - phi' Y_M dt,        W a = y.

So regressor and torque pass the same low pass, with no delay, and are decimated at once; times
may jitter, and a window with a hole is left out. Modulating functions: M. Shinbrot, *On the
analysis of linear and nonlinear systems*, Trans. ASME 79 (1957) 547-552.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..models.dynamics import Dynamics
from .motion import Motion

LENGTH = 0.2  # [s] of a window: -6 dB at 6.5 Hz
_FEWEST = 16  # samples in a window, which is longer where they are rarer
_OVERLAP = 3  # windows at any time
_HOLE = 8  # windows, parts of which the longest may be between two samples


class Windows(NamedTuple):
    """N windows of a motion.

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


def windows_of(motion: Motion, dynamics: Dynamics, period: float, *, held: bool) -> Windows:
    """Return the windows of a motion; see above.

    Args:
        motion: the samples.
        dynamics: whose parameters are to be told.
        period: typical time between samples [s].
        held: whether torques were held from each sample to the next; else they are of the sample.
    """
    t, p, n = motion.t, dynamics.size, motion.v.shape[1]
    length = max(LENGTH, _FEWEST * period)
    count = max(int(np.floor((t[-1] - t[0]) / length * _OVERLAP)) - _OVERLAP + 1, 0)
    middles = t[0] + 0.5 * length + np.arange(count) * length / _OVERLAP
    shares = _shares(t)
    W, y, tau = np.zeros((count, n, p)), np.zeros((count, n)), np.zeros((count, n))
    given = _held_torques(motion, middles, length) if held else None
    for k in range(t.size):
        near = np.flatnonzero(np.abs(t[k] - middles) < 0.5 * length)
        if not near.size:
            continue
        Y_M, Y_0, p_0, tau_0 = dynamics.momentum(motion.q[k], motion.v[k])
        for window in near:
            phi, rate = _window(t[k] - middles[window], length)
            phi, rate = phi * shares[k], rate * shares[k]
            W[window] += phi * Y_0
            W[window] -= rate * Y_M
            y[window] += rate * p_0 - phi * tau_0
            tau[window] += phi * motion.tau[k]
    tau = tau if given is None else given
    whole = _whole(t, middles, length)
    return Windows(middles[whole], W[whole], (y + tau)[whole], tau[whole], length)


def _window(s: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return phi = 8 / (3 L) cos^4(pi s / L) of integral one, and phi', at times s from its middle.

    Its first three derivatives vanish at the ends, so that sums are integrals to the fourth power
    of the period.
    """
    angle = np.pi * s / length
    height = 8.0 / (3.0 * length)
    cos = np.cos(angle)
    return height * cos**4, -4.0 * height * np.pi / length * cos**3 * np.sin(angle)


def _antiderivative(s: np.ndarray, length: float) -> np.ndarray:
    """Return int phi from the left end to times s from the middle, zero to one."""
    angle = np.pi * np.clip(s, -0.5 * length, 0.5 * length) / length
    whole = 3.0 * angle + 2.0 * np.sin(2.0 * angle) + 0.25 * np.sin(4.0 * angle)
    return np.asarray(0.5 + whole / (3.0 * np.pi))


def _shares(t: np.ndarray) -> np.ndarray:
    """Return the time (N) that each sample stands for [s], by trapezoids."""
    steps = np.diff(t)
    return 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))


def _held_torques(motion: Motion, middles: np.ndarray, length: float) -> np.ndarray:
    """Return int phi tau dt (N, n) of torques that are held from each sample to the next."""
    found = np.zeros((len(middles), motion.tau.shape[1]))
    for k, middle in enumerate(middles):
        first, last = np.searchsorted(motion.t, (middle - 0.5 * length, middle + 0.5 * length))
        part = slice(max(first - 1, 0), last + 1)
        weights = np.diff(_antiderivative(motion.t[part] - middle, length))
        found[k] = weights @ motion.tau[part][: len(weights)]
    return found


def _whole(t: np.ndarray, middles: np.ndarray, length: float) -> np.ndarray:
    """Tell of each window whether no two samples in it are too far apart."""
    holes = np.flatnonzero(np.diff(t) > length / _HOLE)
    starts, ends = t[holes], t[holes + 1]
    hit = (starts < middles[:, None] + 0.5 * length) & (ends > middles[:, None] - 0.5 * length)
    return np.asarray(~hit.any(axis=1))
