"""An observer of the position that carries it on by the believed velocity between measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import empty

from .._kernels import filters as kernels
from ..exceptions import InputError
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from ..signals import Signals
from .filters import Filters


class ObserverState(NamedTuple):
    """What the observer remembers.

    Attributes:
        x_o: (m_p) observed position [m].
    """

    x_o: np.ndarray


class Observed(NamedTuple):
    """What the observer tells at one instant; m_p positions, p kinematic parameters.

    Attributes:
        dx_o: (m_p) x_o - x, observed minus measured [m].
        epsilon: (m_p) x_hat(q; a_k) - x = X_k da_k, predicted minus measured [m].
        X_k: (m_p, p) position regressor dx/da_k.
    """

    dx_o: np.ndarray
    epsilon: np.ndarray
    X_k: np.ndarray


@dataclass(frozen=True, eq=False)
class PositionObserver(Filters):
    """dx_o/dt = J_hat qd - beta (x_o - x), H. Wang, IEEE TAC 62 (2017) 948-954.

    Sampled, x_o moves by the held velocity and then by the share 1 - exp(-beta dt) to x.

    Attributes:
        beta: [1/s].
    """

    beta: float

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> ObserverState:
        """Return the observer at the first measured position."""
        if not kinematics.positions or measurement.x is None:
            return ObserverState(np.zeros(0))
        return ObserverState(np.array(kinematics.task.position(measurement.x), dtype=float))

    def observe(
        self, state: ObserverState, measurement: Measurement, kinematics: TaskKinematics
    ) -> Observed:
        """Return the errors of observation and prediction.

        Raises:
            InputError: the state of other filters.
        """
        m = kinematics.positions
        if state.__class__ is not ObserverState or state.x_o.shape != (m,):
            raise InputError("the filters are those of another controller.", where="state")
        if not m or measurement.x is None:
            nothing = np.zeros(0)
            return Observed(nothing, nothing, np.zeros((0, kinematics.size)))
        x = kinematics.task.position(measurement.x)
        epsilon = kinematics.task.position(kinematics.x_hat) - x
        return Observed(state.x_o - x, epsilon, kinematics.position_regressor()[:m])

    def step(self, state: ObserverState, s: Signals, dt: float) -> ObserverState:
        """Return the state after dt [s]."""
        x_o = empty(state.x_o.size)
        kernels.carry(state.x_o, s.xd_hat, s.filtered.dx_o, self.beta, dt, x_o)
        return ObserverState(x_o)

    def rate(self, state: ObserverState, s: Signals) -> ObserverState:
        """Return dx_o/dt (m_p)."""
        dx_o = s.filtered.dx_o
        return ObserverState(s.xd_hat[: dx_o.size] - self.beta * dx_o)
