"""The filters of Wang and Xie (2009): task velocity and joint acceleration without their sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._kernels import filters as kernels
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from ..signals import Signals
from .filters import Filters
from .low_pass import LowPass


class MotionState(NamedTuple):
    """What the filters remember, in one array.

    Attributes:
        memory: (m_p p_k + m_p + n) the filtered kinematic regressor W_k of the m_p positions, (3),
            row by row; the low-passed lambda x + y_p0, xi, from which y = lambda x - xi comes, (4)
            [m/s]; the low-passed joint velocity z, from which the joint acceleration comes.
    """

    memory: np.ndarray


class FilteredMotion(NamedTuple):
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
        return MotionState(np.concatenate([np.zeros(m * p), xi, measurement.v]))

    def observe(
        self, state: MotionState, measurement: Measurement, kinematics: TaskKinematics
    ) -> FilteredMotion:
        """Return regressor, velocity and acceleration as the filters have them."""
        (memory,), m, p, x = state, kinematics.positions, kinematics.size, measurement.x
        y, a = np.empty(m), np.empty(kinematics.nv)
        lambda_, lambda_a = self.task_velocity.bandwidth, self.joint_velocity.bandwidth
        x = memory if x is None else x  # without positions it is not read
        kernels.filtered_rates(lambda_, x, lambda_a, measurement.v, memory, y, a)
        return FilteredMotion(memory[: m * p].reshape(m, p), y, a)

    def step(self, state: MotionState, s: Signals, dt: float) -> MotionState:
        """Return the state after dt [s] with Y_p, lambda x + y_p0 and v held: exact for any dt."""
        (memory,), filtered = state, s.filtered
        after = np.empty(memory.size)
        f_k, f_a = self.task_velocity.fraction(dt), self.joint_velocity.fraction(dt)
        kernels.advance(memory, s.Y_k, s.a_k, filtered.y, s.xd_hat, s.v, f_k, f_a, after)
        return MotionState(after)

    def rate(self, state: MotionState, s: Signals) -> MotionState:
        """Return the time derivative of the state."""
        W_k, y, a = s.filtered
        Y_p = s.Y_k[: y.size]
        y_p0 = s.xd_hat[: y.size] - Y_p.dot(s.a_k)
        lambda_ = self.task_velocity.bandwidth
        rates = (lambda_ * (Y_p - W_k)).ravel(), lambda_ * (y + y_p0), a  # xi to lambda x + y_p0
        return MotionState(np.concatenate(rates))

    def acceleration(self, filtered: FilteredMotion) -> np.ndarray:
        """Return the filtered joint acceleration (n)."""
        return filtered.a
