"""A log as the measurements that an estimator beside the controller would have got."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ..logs.log import Log
from ..records import Measurement
from ..robot.robot import Robot
from .frames import Frames
from .motion import CUTOFF

_RATE = 2.0 * math.pi * CUTOFF  # [1/s] of the causal low pass
_SETTLED = 10.0 / _RATE  # [s]
_SAME = 1e-9  # [s] between times that are taken for one


def measurements(log: Log, robot: Robot, frames: Frames) -> Iterator[Measurement]:
    """Yield a sample at a time: q, v, the mean torque since the last one, and x where one came.

    Where the log has no velocities, positions and torques pass a causal low pass, whose rate is the
    velocity. They then belong together, 11 ms late, and so do the frames.
    """
    q, v, tau = log.configurations(robot), log.v, log.tau
    before = np.where(np.isfinite(tau[:-1]), tau[:-1], tau[1:])
    mean = np.vstack([tau[:1], tau[:-1] if log.held else 0.5 * (tau[1:] + before)])
    late = 0.0 if v is not None else 1.0 / _RATE
    passed = _Causal(robot.model)
    seen, taken = 0, frames.t + late
    for k, t in enumerate(log.t.tolist()):
        x, x_time = None, None
        while seen < len(taken) and taken[seen] <= t + _SAME:
            x, x_time = frames.x[seen], min(float(taken[seen]), t)
            seen += 1
        x_time = None if x_time is None or abs(x_time - t) <= _SAME else x_time
        if v is not None:
            yield Measurement(t, q[k], v[k], x, x_time, tau=mean[k])
            continue
        slow, rate, torque = passed.step(t, q[k], mean[k])
        if t >= log.t[0] + _SETTLED:
            yield Measurement(t, slow, rate, x, x_time, tau=torque)


class _Causal:
    """Positions and torques through one first-order low pass each, and the rate of the former."""

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._memory: tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None

    def step(
        self, t: float, q: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and tau of the low pass at t [s]; a sample that is not finite as it is."""
        if not (np.isfinite(q).all() and np.isfinite(tau).all()):
            return q, np.full(self._model.nv, np.nan), tau
        t_0, q_0, tau_0, slow, torque = self._memory or (t, q, tau, q, tau)
        lag = pin.difference(self._model, slow, q_0)
        way, x = pin.difference(self._model, q_0, q), _RATE * (t - t_0)
        share = -math.expm1(-x)
        late = 1.0 - share / x if x > 0.0 else 0.0  # of what changed over the step, linearly
        slow = pin.integrate(self._model, slow, share * lag + late * way)
        torque = torque + share * (tau_0 - torque) + late * (tau - tau_0)
        self._memory = t, q, tau, slow, torque
        return slow, _RATE * pin.difference(self._model, slow, q), torque
