"""The motion in a log."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..exceptions import LogError
from ..information.measured_motion import CUTOFF, MeasuredMotion, measured_motion
from ..logs.log import Log
from ..robot.robot import Robot

# Relative difference, root mean square, up to which measured velocities are those of the positions.
# Trapezoids over the longer periods of logs differ by themselves, at 50 Hz by about 1e-3.
_TOLERANCE = 5e-3  # half, twice: the same held-out errors of a Panda and a TX40


def several(given: Any) -> tuple[Any, ...]:
    """Return one or several logs as a tuple."""
    return tuple(given) if isinstance(given, list | tuple) else (given,)


def motion_of_log(robot: Robot, log: Log) -> MeasuredMotion:
    """Return the motion in a log at its own times, without samples that are not finite.

    Torques that were held are interpolated between the middles of their periods, by cubics.

    Args:
        robot: whose joints were recorded.
        log: of the motion.

    Raises:
        LogError: fewer than two samples are finite.
    """
    tau = log.tau
    if log.held:
        around = np.pad(tau, ((2, 1), (0, 0)), mode="edge")
        tau = (9.0 * (around[1:-2] + around[2:-1]) - around[:-3] - around[3:]) / 16.0
    whole = replace(log, q=log.configurations(robot), tau=tau)
    seen = whole.sampled(whole.finite)
    if len(seen.t) < 2:
        raise LogError(
            "fewer than two samples have all signals finite.",
            where=log.source,
            hint="Record all joints at the same times, or interpolate.",
        )
    parts = seen.t, seen.q, seen.v, seen.tau
    return measured_motion(robot.model, *parts, log.period, CUTOFF, _TOLERANCE)
