"""The motion in a log."""

from __future__ import annotations

import numpy as np

from ..exceptions import LogError
from ..information.measured_motion import CUTOFF, MeasuredMotion, agree, differences, smoothed
from ..logs.log import Log
from ..robot.robot import Robot

# Relative difference, root mean square, up to which measured velocities are those of the positions.
# Trapezoids over the longer periods of logs differ by themselves, at 50 Hz by about 1e-3.
_TOLERANCE = 5e-3


def motion_of_log(robot: Robot, log: Log, *, cutoff: float = CUTOFF) -> MeasuredMotion:
    """Return the motion in a log at its own times, without samples that are not finite.

    Args:
        robot: whose joints were recorded.
        log: of the motion.
        cutoff: of the low pass [Hz]; at most 0.4 times the sampling rate is taken.

    Raises:
        LogError: fewer than two samples are finite.
    """
    model, q = robot.model, log.configurations(robot)
    signals = np.hstack([q, log.tau, *([] if log.v is None else [log.v])])
    finite = np.isfinite(signals).all(axis=1)
    if np.count_nonzero(finite) < 2:
        raise LogError(
            "fewer than two samples have all signals finite.",
            where=log.source,
            hint="Record all joints at the same times, or interpolate.",
        )
    t, q, tau = log.t[finite], q[finite], log.tau[finite]
    moved, steps = differences(model, q), np.diff(t)
    if log.v is not None:
        v = log.v[finite]
        near = steps < 1.5 * log.period  # no sample is missing in between
        mean = 0.5 * (v[:-1] + v[1:])
        if agree((moved / steps[:, None])[near], mean[near], _TOLERANCE):
            return MeasuredMotion(t, q, v, np.gradient(v, t, axis=0), tau, False)
    travelled = np.vstack([np.zeros(model.nv), np.cumsum(moved, axis=0)])
    return smoothed(model, q[0], t, travelled, tau, log.period, cutoff)
