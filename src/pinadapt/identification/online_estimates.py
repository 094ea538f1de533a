"""The estimates of an ``Estimator`` that runs through a log sample by sample."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ..controller.estimator import Estimator
from ..controller.state import ControllerState
from ..exceptions import LogError, MeasurementError
from ..information.measured_motion import MeasuredMotion
from ..records import Measurement
from .fits import Frames

_KEPT = 2000  # estimates that are stored


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """Estimates in time.

    Attributes:
        t: (K) times [s].
        a_k: (K, p_k) kinematic estimates [m].
        a_d: (K, p_d) dynamic estimates.
        state: at the end.
    """

    t: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    state: ControllerState

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
    reason, every = "", max(1, count // _KEPT)
    for k, sample in enumerate(samples):
        try:
            state = estimator.init(sample) if state is None else estimator.step(state, sample)
        except MeasurementError as error:
            reason = reason or f"at {sample.t:g} s '{error.field}' {error.flaw}"
            continue
        if k % every == 0:
            stored.append(state)
    if state is None:
        raise LogError(f"the estimator refuses every sample: {reason}.", where="log")
    t, a_k, a_d = zip(*((each.t, each.a_k, each.a_d) for each in (*stored, state)), strict=True)
    return OnlineEstimates(np.array(t), np.array(a_k), np.array(a_d), state)


def measurements(motion: MeasuredMotion, frames: Frames) -> Iterator[Measurement]:
    """Yield one measurement a sample: q, v, the mean torque since the last one, x if there is one.

    Args:
        motion: of a log.
        frames: of the log.
    """
    tau = motion.tau
    mean = 0.5 * (tau + np.vstack([tau[:1], tau[:-1]]))
    last = np.searchsorted(frames.t, motion.t, side="right") - 1
    new = np.diff(last, prepend=-1) > 0
    for k, t in enumerate(motion.t.tolist()):
        x, taken = (frames.x[last[k]], float(frames.t[last[k]])) if new[k] else (None, None)
        yield Measurement(t, motion.q[k], motion.v[k], x, taken, tau=mean[k])
