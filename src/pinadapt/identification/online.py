"""The estimates in time, as an estimator beside the controller would have had them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..controller.estimator import Estimator
from ..controller.state import ControllerState
from ..exceptions import LogError, MeasurementError
from ..records import Measurement

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
