"""The motion in a log with velocities: as measured, or of the positions where these are better."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..logs.log import Log
from ..robot.robot import Robot

CUTOFF = 15.0  # [Hz] of the zero-phase low pass on positions
_ORDER = 4
_NOISY = 5e-3  # share of a velocity by which it may differ from that of the positions
_END = 0.1  # [s] at both ends, where a low pass has settled on one side only


class Motion(NamedTuple):
    """N samples of which all numbers are finite.

    Attributes:
        t: (N) times [s].
        q: (N, nq) configurations.
        v: (N, n) velocities [rad/s or m/s].
        tau: (N, n) torques of the joints [N m or N].
        smooth: whether v comes from q through a low pass without delay, and q with it.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    smooth: bool


def motion_of(log: Log, robot: Robot) -> Motion:
    """Return the motion in a log, without the samples that are not whole.

    Velocities come from the positions through a zero-phase low pass where there are none, or where
    they are not those of the positions to 0.5 %: differenced encoders are noisy, and the filter of
    a drive delays. The low pass is wider than what the torque is compared in, so it changes nothing
    but noise.
    """
    q = log.configurations(robot)
    whole = np.isfinite(q).all(axis=1) & np.isfinite(log.tau).all(axis=1)
    if log.v is not None:
        whole &= np.isfinite(log.v).all(axis=1)
    t, q, tau = log.t[whole], q[whole], log.tau[whole]
    way = np.array([pin.difference(robot.model, *ends) for ends in pairwise(q)])
    if log.v is not None:
        v = log.v[whole]
        mean, rate = 0.5 * (v[:-1] + v[1:]), way / np.diff(t)[:, None]
        near = np.diff(t) < 1.5 * log.period
        if np.linalg.norm((rate - mean)[near]) <= _NOISY * np.linalg.norm(mean[near]):
            return Motion(t, q, v, tau, False)
    travelled = np.vstack([np.zeros(way.shape[1]), np.cumsum(way, axis=0)])
    smooth, v = _smooth(t, travelled, log.period)
    path = np.array([pin.integrate(robot.model, q[0], part) for part in smooth])
    kept = (t >= t[0] + _END) & (t <= t[-1] - _END)
    return Motion(t[kept], path[kept], v[kept], tau[kept], True)


def _smooth(t: np.ndarray, way: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (N, n) without what is faster than ``CUTOFF``, and their rates (N, n)."""
    from scipy.signal import butter, sosfiltfilt  # here, because scipy is slow to import

    even = np.linspace(t[0], t[-1], max(round((t[-1] - t[0]) / period) + 1, 2))
    step = even[1] - even[0]
    low_pass = butter(_ORDER, min(CUTOFF, 0.4 / step), fs=1.0 / step, output="sos")
    placed = np.column_stack([np.interp(even, t, column) for column in way.T])
    passed = sosfiltfilt(low_pass, placed, axis=0)
    rates = np.gradient(passed, step, axis=0)
    back = [[np.interp(t, even, column) for column in part.T] for part in (passed, rates)]
    return np.column_stack(back[0]), np.column_stack(back[1])
