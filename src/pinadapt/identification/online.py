"""Online estimates from a log, sample by sample, as an estimator on the robot computes them."""

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

_KEPT = 2000  # estimates that are stored
_RATE = 2.0 * math.pi * CUTOFF  # [1/s] of the causal low pass
_SETTLED = 10.0 / _RATE  # [s]
_SAME = 1e-9  # [s] up to which two times are the same


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """Estimates in time.

    Attributes:
        t: (K) times [s].
        a_k: (K, p_k) kinematic estimates [m].
        a_d: (K, p_d) dynamic estimates.
        state: at the end.
        refused: number of samples that were refused.
        reason: why the first of them was, or None.
    """

    t: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    state: ControllerState
    refused: int
    reason: str | None

    def at(self, t: float) -> np.ndarray:
        """Return the last stored dynamic estimate (p_d) before a time [s]."""
        return np.asarray(self.a_d[max(int(np.searchsorted(self.t, t, side="right")) - 1, 0)])


def estimate_online(
    estimator: Estimator, samples: Iterable[Measurement], count: int
) -> OnlineEstimates:
    """Return the estimates of an estimator over at most ``count`` measurements.

    Measurements that the estimator refuses are skipped, as in the loop of a robot.

    Raises:
        LogError: all of them were refused.
        DivergedError: the estimates diverged.
    """
    state: ControllerState | None = None
    stored: list[ControllerState] = []
    refused, reason, every = 0, None, max(1, count // _KEPT)
    for k, sample in enumerate(samples):
        try:
            state = estimator.init(sample) if state is None else estimator.step(state, sample)
        except MeasurementError as error:
            refused += 1
            reason = reason or f"at {sample.t:g} s '{error.field}' {error.flaw}"
            continue
        if k % every == 0:
            stored.append(state)
    if state is None:
        raise LogError(f"the estimator refuses every sample: {reason}.", where="log")
    return OnlineEstimates(*_stacked([*stored, state]), state=state, refused=refused, reason=reason)


def _stacked(states: Sequence[ControllerState]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.array([state.t for state in states]),
        np.array([state.a_k for state in states]),
        np.array([state.a_d for state in states]),
    )


def measurements(log: Log, robot: Robot, frames: Frames) -> Iterator[Measurement]:
    """Yield one measurement a sample: q, v, the mean torque since the last one, x if there is one.

    If the log has no velocities, positions and torques pass the same causal low pass, and the
    velocity is the rate of its output. It delays all of them, and the frames, by 11 ms.
    """
    q, v, tau = log.configurations(robot), log.v, log.tau
    before = np.where(np.isfinite(tau[:-1]), tau[:-1], tau[1:])
    mean = np.vstack([tau[:1], tau[:-1] if log.held else 0.5 * (tau[1:] + before)])
    delay = 0.0 if v is not None else 1.0 / _RATE
    low_pass = _CausalLowPass(robot.model)
    count, taken = 0, frames.t + delay
    for k, t in enumerate(log.t.tolist()):
        x, x_time = None, None
        while count < len(taken) and taken[count] <= t + _SAME:
            x, x_time = frames.x[count], min(float(taken[count]), t)
            count += 1
        x_time = None if x_time is None or abs(x_time - t) <= _SAME else x_time
        if v is not None:
            yield Measurement(t, q[k], v[k], x, x_time, tau=mean[k])
            continue
        position, velocity, torque = low_pass.step(t, q[k], mean[k])
        if t >= log.t[0] + _SETTLED:
            yield Measurement(t, position, velocity, x, x_time, tau=torque)


class _CausalLowPass:
    """Positions and torques through a first-order low pass, exact for linear changes in between."""

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._memory: tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None

    def step(
        self, t: float, q: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and tau after the low pass; v is NaN if the sample is not finite."""
        if not (np.isfinite(q).all() and np.isfinite(tau).all()):
            return q, np.full(self._model.nv, np.nan), tau
        t_0, q_0, tau_0, slow, torque = self._memory or (t, q, tau, q, tau)
        lag = pin.difference(self._model, slow, q_0)
        change, x = pin.difference(self._model, q_0, q), _RATE * (t - t_0)
        share = -math.expm1(-x)
        ramp = 1.0 - share / x if x > 0.0 else 0.0  # of the change over the step
        slow = pin.integrate(self._model, slow, share * lag + ramp * change)
        torque = torque + share * (tau_0 - torque) + ramp * (tau - tau_0)
        self._memory = t, q, tau, slow, torque
        return slow, _RATE * pin.difference(self._model, slow, q), torque
