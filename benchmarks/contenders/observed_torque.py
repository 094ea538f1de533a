"""Computed torque with a disturbance observer and an integral of the task error."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

import pinadapt as pa
from pinadapt.models import SensedState

from .memory import Memory
from .nominal_robot import NominalRobot


class Integrals(NamedTuple):
    """The memory of the law.

    Attributes:
        shift: (m) of the path [m].
        momentum: (n) predicted M_hat qd.
    """

    shift: np.ndarray
    momentum: np.ndarray


@dataclass(frozen=True, eq=False)
class ObservedTorque(pa.laws.ResolvedAcceleration):
    """tau = M_hat v + C_hat qd + g_hat - r, with the observed disturbance torque r.

    r = k_o (M_hat qd - p), dp/dt = tau + C_hat^T qd - g_hat + r, so that dr/dt = k_o (d - r) for
    the sum d of all torques that the model lacks: A. De Luca, R. Mattone, *Actuator failure
    detection and isolation using generalized momenta*, ICRA 2003. v is that of resolved
    acceleration, for the error y - x_d + shift, d(shift)/dt = k_x (x - x_d), where y is the
    measured x or x_hat(q).

    Attributes:
        nominal: the nominal robot.
        k_o: rate of the observer [1/s], zero for none.
        k_x: rate of the integral [1/s], zero for none.
        seen: whether y is the measured x; not possible with a late camera.
    """

    _: KW_ONLY
    nominal: NominalRobot
    k_o: float = 0.0
    k_x: float = 0.0
    seen: bool = True

    name = "observed-torque"

    @cached_property
    def filters(self) -> Memory:  # type: ignore[override]
        """Integral and observer."""
        return Memory(self._start, self._rates)

    def _start(self, sensed: SensedState) -> Integrals:
        q = sensed.q
        v = sensed.v
        x = sensed.x
        assert x is not None  # required at the first sample
        offset = np.zeros(x.size) if self.seen else x - self.nominal.position(q)
        return Integrals(offset, self.nominal.momentum(q, v))

    def disturbance(self, s: pa.laws.Signals) -> np.ndarray:
        """Return r (n) [N m or N]."""
        p = s.filtered.momentum
        return self.k_o * (self.nominal.momentum(s.q, s.v) - p)

    def _rates(self, s: pa.laws.Signals) -> Integrals:
        r = self.disturbance(s)
        known = self.nominal.momentum_rate(s.q, s.v)
        return Integrals(self.k_x * s.dx, self._torque(s) + known + r)

    def _torque(self, s: pa.laws.Signals) -> np.ndarray:
        """Return the torque (n) within the effort limits, which the observer assumes."""
        error = s.dx
        if not self.seen:
            error = s.dx + self.nominal.position(s.q) - s.x
        shifted = s.replaced(dx=error + s.filtered.shift)
        still = np.zeros(s.a_k.size)
        a = self._commanded_acceleration(shifted, s.xd_hat, self.alpha, still)
        return self.nominal.limited(self.nominal.torque(s.q, s.v, a) - self.disturbance(s))

    def command(self, s: pa.laws.Signals, model: pa.laws.EstimatedModel) -> pa.laws.Command:
        """Return the torque; the estimates have no drives."""
        return pa.laws.Command(self._torque(s), pa.adaptation.Drives.none(s.a_d.size, s.a_k.size))
