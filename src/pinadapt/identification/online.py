"""The estimates in time, as an estimator beside the controller would have had them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..controller.estimator import Estimator
from ..controller.state import ControllerState
from ..exceptions import LogError, MeasurementError
from ..logs.log import Log
from ..records import Measurement
from ..robot.robot import Robot
from .fits import CUTOFF, Frames

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


_KEPT = 2000  # estimates that are kept


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """What an estimator had learned in time.

    Attributes:
        t: (K) times [s].
        a_k: (K, p_k) kinematic estimates [m].
        a_d: (K, p_d) dynamic estimates.
        state: at the end.
        refused: how many samples could not be believed.
        reason: why the first of them, or None.
    """

    t: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    state: ControllerState
    refused: int
    reason: str | None

    def at(self, t: float) -> np.ndarray:
        """Return the dynamic estimate (p_d) that was kept last before a time [s]."""
        return np.asarray(self.a_d[max(int(np.searchsorted(self.t, t, side="right")) - 1, 0)])


def estimate_online(
    estimator: Estimator, samples: Iterable[Measurement], count: int
) -> OnlineEstimates:
    """Return what an estimator learns of at most ``count`` samples, one at a time.

    Samples that cannot be believed are left out, as a robot's loop would.

    Raises:
        LogError: none of them could be believed.
        DivergedError: the estimates ran away.
    """
    state: ControllerState | None = None
    kept: list[ControllerState] = []
    refused, reason, every = 0, None, max(1, count // _KEPT)
    for k, sample in enumerate(samples):
        try:
            state = estimator.init(sample) if state is None else estimator.step(state, sample)
        except MeasurementError as error:
            refused += 1
            reason = reason or f"at {sample.t:g} s '{error.field}' {error.flaw}"
            continue
        if k % every == 0:
            kept.append(state)
    if state is None:
        raise LogError(f"no sample can be believed: {reason}.", where="log")
    return OnlineEstimates(*_stacked([*kept, state]), state=state, refused=refused, reason=reason)


def _stacked(states: Sequence[ControllerState]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.array([state.t for state in states]),
        np.array([state.a_k for state in states]),
        np.array([state.a_d for state in states]),
    )
