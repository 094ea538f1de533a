"""The estimates of an ``Estimator`` that runs through a motion sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..information.measured_motion import MeasuredMotion
from ..records import Measurement
from ..simulation.simulate import Progress, watched
from .estimator import Estimate, Estimator

_TIMES = 20  # at which estimates are asked for, for the picture


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """Estimates in time.

    Attributes:
        t: (K) times [s].
        estimates: K of them.
        before_split: that of the part of the motion that is not held out.
    """

    t: np.ndarray
    estimates: tuple[Estimate, ...]
    before_split: Estimate

    @property
    def a(self) -> np.ndarray:
        """The parameters (K, p)."""
        return np.array([one.a for one in self.estimates])

    @classmethod
    def of(
        cls,
        estimator: Estimator,
        motion: MeasuredMotion,
        split: float,
        progress: Progress | bool | None = None,
    ) -> OnlineEstimates:
        """Run an estimator through a motion.

        Args:
            estimator: whose torques are those of the instant.
            motion: with N samples.
            split: time [s] from which on the motion is held out.
            progress: as of ``simulate``.
        """
        t, count = motion.t, len(motion.t)
        stops = {*np.linspace(0, count - 1, _TIMES).astype(int), np.searchsorted(t, split) - 1}
        state = estimator.init(Measurement(t[0], motion.q[0], motion.v[0], tau=motion.tau[0]))
        found: dict[int, Estimate] = {}
        for k in watched(range(1, count), progress, "online"):
            sample = Measurement(t[k], motion.q[k], motion.v[k], tau=motion.tau[k])
            state = estimator.step(state, sample)
            if k in stops:
                found[k] = estimator.estimate(state, next(reversed(found.values()), None))
        held_out = max(k for k in found if t[k] < split)
        return cls(t[list(found)], tuple(found.values()), found[held_out])
