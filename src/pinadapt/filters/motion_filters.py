"""Filters of Wang and Xie (2009): task velocity and joint acceleration without their sensors."""

from __future__ import annotations

import math
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

_NOTHING_TO_COME = np.zeros(2)


class MotionState(NamedTuple):
    """What the filters remember.

    Attributes:
        W_k: (m_p, p_k) filtered kinematic regressor of the m_p positions, (3).
        memory: (m_p + n) the low-passed lambda x + y_p0, xi, from which y = lambda x - xi comes,
            (4) [m/s]; the low-passed joint velocity z, from which the joint acceleration comes.
        Y_p: (m_p, p_k) regressor that was held over the last step.
        inputs: (m_p + n) of the memory, held over it.
        shares: (2) of a change of both over it that are still to come, position and joint.
    """

    W_k: np.ndarray
    memory: np.ndarray
    Y_p: np.ndarray
    inputs: np.ndarray
    shares: np.ndarray


@dataclass(slots=True, eq=False)
class FilteredMotion:
    """What the filters tell.

    Attributes:
        W_k, y: (m_p, p_k) and (m_p) filtered regressor and velocity, (3)-(4), the known part taken
            off y; positions only.
        a: (n) filtered joint acceleration.
        state: the filters' memory at this instant.
    """

    W_k: np.ndarray
    y: np.ndarray
    a: np.ndarray
    state: MotionState


@dataclass(frozen=True, eq=False)
class MotionFilters(Filters):
    """lambda / (lambda + p) on the task velocity and its regressor, p / (lambda_a p + 1) on v.

    Sampled, what is filtered counts as piecewise linear, its later end as soon as it is known: held
    over each period instead, W_k and y would differ by half of one, y by lambda dt / 2 of itself,
    and an estimate of a tool by two millimetres at lambda = 14 /s and 1 kHz.

    Attributes:
        task_velocity: low pass lambda of (3)-(4).
        joint_velocity: low pass behind the acceleration, of bandwidth 1 / lambda_a.
    """

    task_velocity: LowPass
    joint_velocity: LowPass

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> MotionState:
        """Return the filters at rest."""
        m, p, v = kinematics.task.positions, kinematics.size, measurement.v
        xi = np.zeros(0)
        if m and measurement.x is not None:
            xi = self.task_velocity.bandwidth * kinematics.task.position(measurement.x)
        memory = np.concatenate([xi, v])
        return MotionState(np.zeros((m, p)), memory, np.zeros((m, p)), memory, np.zeros(2))

    def observe(
        self, state: MotionState, measurement: Measurement, kinematics: TaskKinematics
    ) -> FilteredMotion:
        """Return regressor, velocity and acceleration as the filters have them.

        Raises:
            InputError: the state of other filters.
        """
        if state.__class__ is MotionState:
            W_k, memory, Y_p, before, shares = state
            m, n, Y_k = kinematics.positions, kinematics.nv, kinematics.Y_k
            x = memory if measurement.x is None else measurement.x  # not read without positions
            W_now, memory_now, now = empty((m, Y_k.shape[1])), empty(m + n), empty(m + n)
            y, a = empty(m), empty(n)
            if kernels.filtered_rates(
                W_k, memory, Y_p, before, shares, Y_k, kinematics.y_p0, x, measurement.v,
                self.task_velocity.bandwidth, self.joint_velocity.bandwidth,
                W_now, memory_now, now, y, a,
            ):  # fmt: skip
                reached = MotionState(W_now, memory_now, Y_k[:m], now, _NOTHING_TO_COME)
                return FilteredMotion(W_now, y, a, reached)
        raise InputError("the filters are those of another controller.", where="state")

    def step(self, state: MotionState, s: Signals, dt: float) -> MotionState:
        """Return the state after dt [s]."""
        W_k, memory, Y_p, inputs, _ = s.filtered.state
        W_k_after, memory_after = empty(W_k.shape), empty(memory.size)
        bandwidths = self.task_velocity.bandwidth, self.joint_velocity.bandwidth
        kernels.advance(W_k, memory, Y_p, inputs, *bandwidths, dt, W_k_after, memory_after)
        shares = np.array([_to_come(bandwidth * dt) for bandwidth in bandwidths])
        return named(MotionState, (W_k_after, memory_after, Y_p, inputs, shares))

    def rate(self, state: MotionState, s: Signals) -> MotionState:
        """Return the time derivative of the state."""
        W_k, memory, Y_p, inputs, shares = s.filtered.state
        m = len(W_k)
        xi = self.task_velocity.rate(memory[:m], inputs[:m])
        moved = np.concatenate([xi, s.filtered.a])  # z to v
        rest = np.zeros(Y_p.shape), np.zeros(inputs.size), np.zeros(shares.size)
        return MotionState(self.task_velocity.rate(W_k, Y_p), moved, *rest)

    def acceleration(self, filtered: FilteredMotion) -> np.ndarray:
        """Return the filtered joint acceleration (n)."""
        return filtered.a


def _to_come(x: float) -> float:
    """Return the share of a change over a step of which the later end is not known yet.

    A low pass of bandwidth x per step goes 1 - (1 - exp(-x)) / x of a ramp of one.
    """
    return 1.0 + math.expm1(-x) / x if x > 0.0 else 0.0
