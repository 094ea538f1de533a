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
    """What the filters remember.

    Attributes:
        W_k: (m_p, p_k) filtered kinematic regressor of the m_p positions, (3).
        xi: (m_p) low-passed lambda x + y_p0, from which y = lambda x - xi comes, (4) [m/s].
        z: (n) low-passed joint velocity, from which the joint acceleration comes.
    """

    W_k: np.ndarray
    xi: np.ndarray
    z: np.ndarray


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
        task = kinematics.task
        x = np.zeros(0) if measurement.x is None else task.position(measurement.x)
        return MotionState(
            W_k=np.zeros((task.positions, kinematics.size)),
            xi=self.task_velocity.bandwidth * np.array(x, dtype=float),
            z=np.array(measurement.v, dtype=float),
        )

    def observe(
        self, state: MotionState, measurement: Measurement, kinematics: TaskKinematics
    ) -> FilteredMotion:
        """Return regressor, velocity and acceleration as the filters have them."""
        y, a = np.empty(state.xi.size), np.empty(state.z.size)
        x = state.xi if measurement.x is None else kinematics.task.position(measurement.x)
        lambda_, lambda_a = self.task_velocity.bandwidth, self.joint_velocity.bandwidth
        kernels.filtered_rates(lambda_, x, state.xi, lambda_a, measurement.v, state.z, y, a)
        return FilteredMotion(state.W_k, y, a)

    def step(self, state: MotionState, s: Signals, dt: float) -> MotionState:
        """Return the state after dt [s] with Y_p, lambda x + y_p0 and v held: exact for any dt."""
        W_k, xi, z = np.empty(state.W_k.shape), np.empty(state.xi.shape), np.empty(state.z.shape)
        f_k, f_a = self.task_velocity.fraction(dt), self.joint_velocity.fraction(dt)
        xd_hat = s.dxd_hat + s.xd_d
        kernels.advance(
            state.W_k, s.Y_k, s.a_k, state.xi, s.filtered.y, xd_hat, f_k,
            state.z, s.v, f_a, W_k, xi, z,
        )  # fmt: skip
        return MotionState(W_k, xi, z)

    def rate(self, state: MotionState, s: Signals) -> MotionState:
        """Return the time derivative of the state."""
        m = state.xi.size
        Y_p = s.Y_k[:m]
        y_p0 = (s.dxd_hat + s.xd_d)[:m] - Y_p.dot(s.a_k)
        return MotionState(
            W_k=self.task_velocity.rate(state.W_k, Y_p),
            xi=self.task_velocity.bandwidth * (s.filtered.y + y_p0),  # the input is lambda x + y_p0
            z=self.joint_velocity.rate(state.z, s.v),
        )

    def acceleration(self, filtered: FilteredMotion) -> np.ndarray:
        """Return the filtered joint acceleration (n)."""
        return filtered.a
