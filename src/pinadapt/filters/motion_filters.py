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
        low: (m_p p_k + m_p + n) what the low passes let through, one after the other: Z_k (m_p,
            p_k) of X_k, dx/da_k of the m_p positions, from which the filtered kinematic regressor
            W_k = lambda (X_k - Z_k) comes, (3); xi (m_p) of the position less its known part, from
            which y = lambda (x - x_0 - xi) comes, (4) [m]; z (n) of the joint velocity, from which
            the joint acceleration comes.
    """

    low: np.ndarray


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

    The position is affine in the parameters, x = X_k a_k + x_0, so its velocity need not be: with
    the same low pass F on both sides, lambda (1 - F) X_k a_k = lambda (1 - F) (x - x_0) holds for
    samples of any period, as F is linear whatever it makes of them between. In continuous time
    lambda (1 - F) X_k is Y_k through lambda / (lambda + p), as Wang and Xie have it; sampled, that
    would lag behind the difference of positions, by millimetres of a tool.

    Attributes:
        task_velocity: low pass lambda of (3)-(4).
        joint_velocity: low pass behind the acceleration, of bandwidth 1 / lambda_a.
    """

    task_velocity: LowPass
    joint_velocity: LowPass

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> MotionState:
        """Return the filters at rest, in the middle of what they pass: W_k and y are zero."""
        m, p = kinematics.positions, kinematics.size
        X_k, d = np.zeros((m, p)), np.zeros(m)
        if m and measurement.x is not None:
            kinematics.update(kinematics.initial, measurement.q, measurement.v)
            x_hat, X_k = kinematics.prediction()
            d = kinematics.task.position(measurement.x) - x_hat + X_k.dot(kinematics.a_k)
        return MotionState(np.concatenate([X_k.ravel(), d, measurement.v]))

    def observe(
        self, state: MotionState, measurement: Measurement, kinematics: TaskKinematics
    ) -> FilteredMotion:
        """Return regressor, velocity and acceleration as the filters have them.

        Raises:
            InputError: the state of other filters.
        """
        if state.__class__ is MotionState:
            x, (x_hat, X_k) = measurement.x, kinematics.prediction()
            x = kinematics.task.position(x) if x is not None and x_hat.size else x_hat
            W_k, y, a = empty(X_k.shape), empty(x_hat.size), empty(kinematics.nv)
            if kernels.filtered_rates(
                state.low, X_k, x_hat, kinematics.a_k, x, self.task_velocity.bandwidth,
                measurement.v, self.joint_velocity.bandwidth, W_k, y, a,
            ):  # fmt: skip
                return FilteredMotion(W_k, y, a)
        raise InputError("the filters are those of another controller.", where="state")

    def step(self, state: MotionState, s: Signals, dt: float) -> MotionState:
        """Return the state after dt [s] with X_k, x - x_0 and v held: exact for any dt."""
        low, filtered = state.low, s.filtered
        after = empty(low.size)
        kernels.advance(
            low, filtered.W_k, filtered.y, filtered.a,
            self.task_velocity.bandwidth, self.joint_velocity.bandwidth, dt, after,
        )  # fmt: skip
        return named(MotionState, (after,))

    def rate(self, state: MotionState, s: Signals) -> MotionState:
        """Return the time derivative of the state."""
        filtered = s.filtered
        return MotionState(np.concatenate([filtered.W_k.ravel(), filtered.y, filtered.a]))

    def acceleration(self, filtered: FilteredMotion) -> np.ndarray:
        """Return the filtered joint acceleration (n)."""
        return filtered.a
