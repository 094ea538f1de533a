"""Filters of Wang and Xie (2009): task velocity and joint acceleration without their sensors."""

from __future__ import annotations

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
from .low_pass import LowPass


class MotionState(NamedTuple):
    """What the filters remember.

    Attributes:
        W_k: (m_p, p_k) filtered kinematic regressor of the m_p positions, (3).
        memory: (m_p + n) the low-passed lambda x + y_p0, xi, from which y = lambda x - xi comes,
            (4) [m/s]; the low-passed joint velocity z, from which the joint acceleration comes.
    """

    W_k: np.ndarray
    memory: np.ndarray


@dataclass(slots=True, eq=False)
class FilteredMotion:
    """What the filters tell.

    Attributes:
        W_k, y: (m_p, p_k) and (m_p) filtered regressor and velocity, (3)-(4), the known part taken
            off y; positions only.
        a: (n) filtered joint acceleration.
    """

    W_k: np.ndarray
    y: np.ndarray
    a: np.ndarray


@dataclass(frozen=True, eq=False)
class MotionFilters(Filters):
    """lambda / (lambda + p) on the task velocity and its regressor, p / (lambda_a p + 1) on v.

    Attributes:
        task_velocity: low pass lambda of (3)-(4).
        joint_velocity: low pass behind the acceleration, of bandwidth 1 / lambda_a.
    """

    task_velocity: LowPass
    joint_velocity: LowPass

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> MotionState:
        """Return the filters at rest."""
        m, p = kinematics.task.positions, kinematics.size
        xi = np.zeros(0)
        if m and measurement.x is not None:
            xi = self.task_velocity.bandwidth * kinematics.task.position(measurement.x)
        return MotionState(np.zeros((m, p)), np.concatenate([xi, measurement.v]))

    def observe(
        self, state: MotionState, measurement: Measurement, kinematics: TaskKinematics
    ) -> FilteredMotion:
        """Return regressor, velocity and acceleration as the filters have them.

        Raises:
            InputError: the state of other filters.
        """
        if state.__class__ is MotionState:
            W_k, memory = state
            x = memory if measurement.x is None else measurement.x  # not read without positions
            y, a = empty(kinematics.positions), empty(kinematics.nv)
            if kernels.filtered_rates(
                W_k, memory, kinematics.size, self.task_velocity.bandwidth, x,
                self.joint_velocity.bandwidth, measurement.v, y, a,
            ):  # fmt: skip
                return FilteredMotion(W_k, y, a)
        raise InputError("the filters are those of another controller.", where="state")

    def step(self, state: MotionState, s: Signals, dt: float) -> MotionState:
        """Return the state after dt [s] with Y_p, lambda x + y_p0 and v held: exact for any dt."""
        W_k, memory = state
        W_k_after, memory_after = empty(W_k.shape), empty(memory.size)
        kernels.advance(
            W_k, memory, s.Y_k, s.a_k, s.filtered.y, s.xd_hat, s.v,
            self.task_velocity.bandwidth, self.joint_velocity.bandwidth, dt,
            W_k_after, memory_after,
        )  # fmt: skip
        return named(MotionState, (W_k_after, memory_after))

    def rate(self, state: MotionState, s: Signals) -> MotionState:
        """Return the time derivative of the state."""
        y = s.filtered.y
        Y_p = s.Y_k[: y.size]
        y_p0 = s.xd_hat[: y.size] - Y_p.dot(s.a_k)
        lambda_ = self.task_velocity.bandwidth
        rates = lambda_ * (y + y_p0), s.filtered.a  # xi to lambda x + y_p0, z to v
        return MotionState(lambda_ * (Y_p - s.filtered.W_k), np.concatenate(rates))

    def acceleration(self, filtered: FilteredMotion) -> np.ndarray:
        """Return the filtered joint acceleration (n)."""
        return filtered.a
