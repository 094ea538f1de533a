"""Joint PD and PID with gravity after inverse kinematics, with a camera in an outer loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

import pinadapt as pa
from pinadapt.models import SensedState

from .inverse_kinematics import InverseKinematics
from .memory import Memory
from .nominal_robot import NominalRobot


class Integrals(NamedTuple):
    """The memory of the law.

    Attributes:
        q_r: (n) joint reference [rad or m].
        shift: (m) of the path of the nominal frame [m].
        torque: (n) integral torque [N m or N].
    """

    q_r: np.ndarray
    shift: np.ndarray
    torque: np.ndarray


@dataclass(frozen=True, eq=False)
class JointTracking(pa.laws.Law):
    """tau = g_hat(q) - K_P (q - q_r) - K_D (qd - qd_r) - z, dz/dt = k_j K_P (q - q_r).

    q_r follows x_d - shift by the nominal kinematics, d(shift)/dt = k_x (x - x_d). Without k_x the
    error of the tool remains. With k_x the shift starts at the error of the first frame. The
    integral torque z is clamped at the effort limits (anti-windup).

    Attributes:
        nominal: the nominal robot.
        w: rate of the inverse kinematics [1/s].
        K_P, K_D: (n) gains [N m/rad], [N m s/rad].
        k_j: rate of the joints' integral [1/s], zero for PD.
        k_x: rate of the outer integral [1/s], zero for none.
    """

    nominal: NominalRobot
    w: float
    K_P: np.ndarray
    K_D: np.ndarray
    k_j: float = 0.0
    k_x: float = 0.0

    name = "joint-tracking"
    adapts = False

    @cached_property
    def filters(self) -> Memory:
        """Reference and integrals."""
        return Memory(self._start, self._rates)

    @cached_property
    def _inverse_kinematics(self) -> InverseKinematics:
        return InverseKinematics(self.nominal, self.w)

    def _start(self, sensed: SensedState) -> Integrals:
        q = sensed.q
        x = sensed.x
        assert x is not None  # required at the first sample
        shift = x - self.nominal.position(q) if self.k_x else np.zeros(x.size)
        return Integrals(q.copy(), shift, np.zeros(q.size))

    def _reference_velocity(self, s: pa.laws.Signals) -> np.ndarray:
        """Return qd_r (n)."""
        q_r, shift, _ = s.filtered
        x_d = s.x - s.dx
        return self._inverse_kinematics.rate(q_r, x_d - shift, s.xd_d - self.k_x * s.dx)

    def _rates(self, s: pa.laws.Signals) -> Integrals:
        q_r, _, z = s.filtered
        z_rate = self.k_j * self.K_P * (s.q - q_r)
        full = (np.abs(z) >= self.nominal.limits) & (z * z_rate > 0.0)
        return Integrals(self._reference_velocity(s), self.k_x * s.dx, np.where(full, 0.0, z_rate))

    def command(self, s: pa.laws.Signals, model: pa.laws.EstimatedModel) -> pa.laws.Command:
        """Return the torque; nothing drives the estimates."""
        q_r, _, z = s.filtered
        feedback = self.K_P * (s.q - q_r) + self.K_D * (s.v - self._reference_velocity(s))
        torque = self.nominal.gravity(s.q) - feedback - z
        return pa.laws.Command(torque, pa.adaptation.Drives.none(s.a_d.size, s.a_k.size))

    def storage(self, s: pa.laws.Signals, truth: pa.laws.Truth) -> float:
        """Refuse: with a wrong model no V is known."""
        raise NotImplementedError

    def dissipation(self, s: pa.laws.Signals, truth: pa.laws.Truth) -> float:
        """Refuse: with a wrong model no V is known."""
        raise NotImplementedError
