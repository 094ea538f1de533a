"""What can be identified from: a file, a log, or a rollout in memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..logs.log import Log
from ..logs.read import read_log
from ..robot.robot import Robot
from ..rollout.rollout import Rollout


def log_of(source: Any, robot: Robot, **options: Any) -> Log:
    """Return the checked log of a path, a ``Log``, or a ``Rollout``, for a robot.

    Of a rollout what its sensors said, since the last change of its robot, and the torques that
    were held.

    Raises:
        LogError: as ``read_log``.
    """
    return read_log(_recorded(source) if isinstance(source, Rollout) else source, robot, **options)


def _recorded(rollout: Rollout) -> Log:
    since = max((at for at, what in rollout.marks if what != "told"), default=-np.inf)
    evaluation, framed = rollout.evaluation, rollout.task.positions > 0
    x = rollout.x if framed else None
    if evaluation is None or not evaluation.samples:
        log = Log(rollout.t, rollout.q, rollout.tau, rollout.v, x=x, held=True, source="rollout")
        return log.after(since)
    measured = [sample.measurement for sample in evaluation.samples]
    seen = [part for part in measured if framed and part.x is not None]
    return Log(
        np.array([part.t for part in measured]),
        np.array([part.q for part in measured]),
        rollout.tau,
        np.array([part.v for part in measured]),
        x=np.array([part.x for part in seen]) if seen else None,
        x_time=np.array([part.t if part.x_time is None else part.x_time for part in seen]),
        held=True,
        source="rollout",
    ).after(since)
