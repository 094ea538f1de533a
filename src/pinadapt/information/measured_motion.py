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
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..controller.state import Sample

# [Hz] for noisy positions, above the band of a window; half: a TX40's held-out error 2.5 % larger
# and a load of 17-bit encoders not known; twice: 1 % smaller, its centre 0.5 mm off in place of 0.4
CUTOFF = 15.0
LENGTH = 0.2  # [s] of a window, which is at half (-6 dB) at 6.5 Hz
# windows at any time; 2: a Panda's held-out error 13 % larger; 6: 3 % larger
OVERLAP = 3
# samples in a window, which is longer for a log of a lower rate; half: the error of a Panda at 30
# Hz is twice as large; twice: windows of a second, whose errors do not compare
FEWEST = 16

# [s] left out at both ends, where the low pass has data on one side only; half, twice: held-out
# errors differ by 1 to 8 %, as other samples are held out
_SETTLING = 0.1
# [Hz] for noisy positions of a run, well above the band of a block of 50 ms; half: a UR10's load is
# not known to 2 %; twice: the same
_CUTOFF = 30.0

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


def motion_of_samples(model: pin.Model, samples: Sequence[Sample]) -> MeasuredMotion:
    """Return the motion measured in samples of a constant rate, halfway between them.

    There the mean of both velocities and their difference over the period are exact to the square
    of the period for torques that are held.

    Args:
        model: of the chain.
        samples: of a run; of fewer than 16, which the low pass needs, there is no motion.
    """
    t = np.array([sample.t for sample in samples])
    if len(samples) < 16 or t[-1] <= t[0]:
        none = np.zeros((0, model.nv))
        return MeasuredMotion(np.zeros(0), np.zeros((0, model.nq)), none, none, none, False)
    q, v = (np.array([getattr(one.measurement, part) for one in samples]) for part in "qv")
    held = np.array([_torque_between(*ends) for ends in pairwise(samples)])
    tau = np.vstack([held, held[-1:]])
    period = (t[-1] - t[0]) / (len(t) - 1)
    t, q, v, _, tau, noisy = measured_motion(model, t, q, v, tau, period, _CUTOFF, _TOLERANCE)
    return MeasuredMotion(
        t[:-1] + 0.5 * period,
        integrated(model, q[:-1], 0.5 * differences(model, q)),
        0.5 * (v[:-1] + v[1:]),
        np.diff(v, axis=0) / period,
        tau[:-1],
        noisy,
    )


def _torque_between(before: Sample, after: Sample) -> np.ndarray:
    """Return the torque (n) between two samples: measured, or in the mean what was sent."""
    if after.measurement.tau is not None:
        return after.measurement.tau
    return before.torque if before.mean_torque is None else before.mean_torque


def measured_motion(
    model: pin.Model,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray | None,
    tau: np.ndarray,
    period: float,
    cutoff: float,
    tolerance: float,
) -> MeasuredMotion:
    """Return the motion through samples at times t (N), typically ``period`` apart [s].

    Where velocities are missing, or differ by more than the relative tolerance from the rates of
    the positions, these pass a low pass, velocity and acceleration are derivatives, and both ends
    are left out. Times may be uneven: the low pass runs at even ones, and its output is
    interpolated.
    """
    # here, because scipy is slow to import
    from scipy.interpolate import make_interp_spline
    from scipy.signal import butter, sosfiltfilt

    moved = differences(model, q)
    steps = np.diff(t)[:, None]
    if v is not None:
        near = steps[:, 0] < 1.5 * period  # no sample is missing in between
        mean = 0.5 * (v[:-1] + v[1:])[near]
        off = np.linalg.norm((moved / steps)[near] - mean)
        short = t[-1] - t[0] <= 10.0 * _SETTLING
        if short or off <= tolerance * np.linalg.norm(mean):
            return MeasuredMotion(t, q, v, np.gradient(v, t, axis=0), tau, False)
    travelled = np.vstack([np.zeros(model.nv), np.cumsum(moved, axis=0)])
    even = np.linspace(t[0], t[-1], max(round((t[-1] - t[0]) / period) + 1, 2))
    step = even[1] - even[0]
    low_pass = butter(4, min(cutoff, 0.4 / step), fs=1.0 / step, output="sos")
    linear = partial(make_interp_spline, k=1, check_finite=False)
    path = sosfiltfilt(low_pass, linear(t, travelled)(even), axis=0)
    v = np.gradient(path, step, axis=0)
    settled = (t >= t[0] + _SETTLING) & (t <= t[-1] - _SETTLING)
    travelled, v, a = (
        linear(even, part)(t[settled]) for part in (path, v, np.gradient(v, step, axis=0))
    )
    return MeasuredMotion(t[settled], integrated(model, q[0], travelled), v, a, tau[settled], True)


def differences(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Return how far the joints moved (N - 1, n) between configurations (N, nq) [rad or m]."""
    return np.array([pin.difference(model, *ends) for ends in pairwise(q)]).reshape(-1, model.nv)


def integrated(model: pin.Model, q: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return the configurations (N, nq) to which others, (N, nq) or (nq), move by (N, n)."""
    starts = np.broadcast_to(q, (len(moved), model.nq))
    found = [pin.integrate(model, *each) for each in zip(starts, moved, strict=True)]
    return np.array(found).reshape(-1, model.nq)


def at_times(
    model: pin.Model, t: np.ndarray, q: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the motion at other times, between the samples.

    Args:
        model: of the chain.
        t: (N) times of the samples [s].
        q: (N, nq) configurations.
        times: (M) [s].

    Returns:
        A mask (M) of the times that are between two samples, and the configurations (K, nq) and
        velocities (K, n) at these.
    """
    earlier, not_later = (np.searchsorted(t, times, side=side) for side in ("left", "right"))
    within = (not_later > 0) & (earlier < len(t)) & (len(t) > 1)
    k = np.minimum(not_later[within], len(t) - 1) - 1
    rates = differences(model, q)[k] / np.diff(t)[k, None]
    return within, integrated(model, q[k], rates * (times[within] - t[k])[:, None]), rates


def evenly(count: int, most: int) -> np.ndarray:
    """Return the indices of up to ``most`` of ``count`` samples, evenly chosen."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))


class Averages:
    """Averages of signals over the windows of a motion.

    Attributes:
        t: (K) times of the middles of all windows [s].
        length: of a window [s].
        whole: (K) whether a window has no gap.
        phi, rate: (K, N) sparse weights of the samples in integrals of phi and of its derivative.
    """

    def __init__(self, t: np.ndarray, period: float) -> None:
        """Lay windows over samples at times t (N), typically ``period`` apart [s]."""
        from scipy.sparse import csc_array  # here, because scipy is slow to import

        self.length = length = max(LENGTH, FEWEST * period)
        count = max(int((t[-1] - t[0]) / length * OVERLAP) - OVERLAP + 1, 0)
        half = 0.5 * length
        self.t = t[0] + half + np.arange(count) * length / OVERLAP
        first, last = np.searchsorted(t, [self.t - half, self.t + half])
        gaps = np.append(0, np.cumsum(np.diff(t) > 2.0 * length / FEWEST))  # before each sample
        before, after = gaps[np.clip([first - 1, last], 0, len(t) - 1)]
        self.whole = before == after
        window = np.repeat(np.arange(count), last - first)
        sample = np.concatenate([np.arange(0), *map(np.arange, first, last)])
        steps = np.append(np.diff(t), 0.0)
        trapezoids = 0.5 * (steps + np.roll(steps, 1))[sample]
        self.phi, self.rate = (
            csc_array((weights * trapezoids, (window, sample)), shape=(count, len(t)))
            for weights in bump(t[sample] - self.t[window], length)
        )

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the averages (K, ...) of values (N, ...) at the samples."""
        return (self.phi @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])


def bump(s: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return phi = 8 / (3 L) cos^4(pi s / L) of integral one, and phi', at times s from its middle.

    Its first three derivatives vanish at the ends, so that sums are integrals to the fourth power
    of the period.
    """
    angle = np.pi * np.clip(s / length, -0.5, 0.5)
    height = 8.0 / (3.0 * length)
    cos = np.cos(angle)
    return height * cos**4, -4.0 * height * np.pi / length * cos**3 * np.sin(angle)
