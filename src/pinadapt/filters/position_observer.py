"""An observer of the position that carries it on by the believed velocity between measurements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import empty

from .._kernels import filters as kernels
from ..exceptions import InputError
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement, named
from ..signals import Signals
from .filters import Filters


class ObserverState(NamedTuple):
    """What the observer remembers.

    Attributes:
        memory: (m_p + 1) observed position x_o [m], less what the velocity at the end of the last
            step adds, and for how long it adds [s]: half of that step.
        s_f: (n) low-passed error of the joint velocity [rad/s or m/s]; empty where nobody asks.
    """

    memory: np.ndarray
    s_f: np.ndarray


class Observed(NamedTuple):
    """What the observer tells at one instant.

    Attributes:
        dx_o: (m_p) x_o - x, observed minus measured [m].
        s_f: (n) low-passed error of the joint velocity [rad/s or m/s]; empty where nobody asks.
    """

    dx_o: np.ndarray
    s_f: np.ndarray


@dataclass(frozen=True, eq=False)
class PositionObserver(Filters):
    """dx_o/dt = J_hat qd - beta (x_o - x), H. Wang, IEEE TAC 62 (2017) 948-954.

    Sampled, x_o moves by the mean of the believed velocities at both ends of a period, the later
    one as soon as it is known, and by the share 1 - exp(-beta dt) to x: its error falls with the
    square of the period. By the earlier velocity alone it would lag by dt |xdd| / (2 beta), some
    thousandths of a millimetre on a circle of 0.1 m in 3 s.

    Attributes:
        beta: [1/s].
        error: returns s (n) of the law, to be low-passed; None for no such filter.
        bandwidth: of this low pass [1/s].
    """

    beta: float
    error: Callable[[Signals], np.ndarray] | None = None
    bandwidth: float = math.inf

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> ObserverState:
        """Return the observer at the first measured position."""
        s_f = np.zeros(0 if self.error is None else kinematics.nv)
        memory = np.zeros(kinematics.positions + 1)
        if kinematics.positions and measurement.x is not None:
            memory[:-1] = kinematics.task.position(measurement.x)
        return ObserverState(memory, s_f)

    def observe(
        self, state: ObserverState, measurement: Measurement, kinematics: TaskKinematics
    ) -> Observed:
        """Return the error of the observation.

        Raises:
            InputError: the state of other filters.
        """
        m = kinematics.positions
        if state.__class__ is not ObserverState or state.memory.size != m + 1:
            raise InputError("the filters are those of another controller.", where="state")
        if not m or measurement.x is None:
            return Observed(np.zeros(0), state.s_f)
        x, dx_o = kinematics.task.position(measurement.x), empty(m)
        kernels.observed(state.memory, kinematics.xd_hat, x, dx_o)
        return Observed(dx_o, state.s_f)

    def step(self, state: ObserverState, s: Signals, dt: float) -> ObserverState:
        """Return the state after dt [s]."""
        (memory, s_f), after = state, empty(state.memory.size)
        kernels.carry(memory, s.xd_hat, s.filtered.dx_o, self.beta, dt, after)
        if self.error is not None:
            s_f = s_f - math.expm1(-self.bandwidth * dt) * (self.error(s) - s_f)
        return named(ObserverState, (after, s_f))

    def rate(self, state: ObserverState, s: Signals) -> ObserverState:
        """Return dx_o/dt (m_p) and ds_f/dt (n)."""
        dx_o, s_f = s.filtered.dx_o, state.s_f
        if self.error is not None:
            s_f = self.bandwidth * (self.error(s) - s_f)
        moved = np.zeros(dx_o.size + 1)
        moved[:-1] = s.xd_hat[: dx_o.size] - self.beta * dx_o
        return ObserverState(moved, s_f)
