"""Computed torque with a disturbance observer and an integral of the task error."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

import pinadapt as pa
from pinadapt.models import SensedState

from .believed_robot import BelievedRobot
from .memory import Memory


class Integrals(NamedTuple):
    """What the law remembers.

    Attributes:
        shift: (m) of the path [m].
        momentum: (n) predicted M_hat qd.
    """

    shift: np.ndarray
    momentum: np.ndarray


@dataclass(frozen=True, eq=False)
class ObservedTorque(pa.laws.ResolvedAcceleration):
    """tau = M_hat v + C_hat qd + g_hat - r, r what the momentum tells of a disturbing torque.

    r = k_o (M_hat qd - p), dp/dt = tau + C_hat^T qd - g_hat + r, so that dr/dt = k_o (d - r) for
    the sum d of all that the model leaves out: A. De Luca, R. Mattone, *Actuator failure detection
    and isolation using generalized momenta*, ICRA 2003. v is resolved acceleration's, of the error
    y - x_d + shift, d(shift)/dt = k_x (x - x_d), where y is the measured x or x_hat(q).

    Attributes:
        believed: the believed robot.
        k_o: rate of the observer [1/s], zero for none.
        k_x: rate of the integral [1/s], zero for none.
        seen: whether y is the measured x, which a late camera forbids.
    """

    _: KW_ONLY
    believed: BelievedRobot
    k_o: float = 0.0
    k_x: float = 0.0
    seen: bool = True

    name = "observed-torque"

    @cached_property
    def filters(self) -> Memory:  # type: ignore[override]
        """Integral and observer."""
        return Memory(self._start, self._rates)

    def _start(self, sensed: SensedState) -> Integrals:
        q, v, x = sensed.q, sensed.v, sensed.x
        assert x is not None  # every controller asks for it at first
        offset = np.zeros(x.size) if self.seen else x - self.believed.position(q)
        return Integrals(offset, self.believed.momentum(q, v))

    def disturbance(self, s: pa.laws.Signals) -> np.ndarray:
        """Return r (n) [N m or N]."""
        p = s.filtered.momentum
        return self.k_o * (self.believed.momentum(s.q, s.v) - p)

    def _rates(self, s: pa.laws.Signals) -> Integrals:
        r = self.disturbance(s)
        known = self.believed.momentum_rate(s.q, s.v)
        return Integrals(self.k_x * s.dx, self._torque(s) + known + r)

    def _torque(self, s: pa.laws.Signals) -> np.ndarray:
        """Return the torque (n) within the efforts, which the observer counts on."""
        error = s.dx
        if not self.seen:
            error = s.dx + self.believed.position(s.q) - s.x
        shifted = s.replaced(dx=error + s.filtered.shift)
        a = self.commanded_acceleration(shifted, np.zeros(s.a_k.size))
        return self.believed.limited(self.believed.torque(s.q, s.v, a) - self.disturbance(s))

    def command(self, s: pa.laws.Signals, model: pa.laws.EstimatedModel) -> pa.laws.Command:
        """Return the torque; nothing drives the estimates."""
        return pa.laws.Command(self._torque(s), pa.adaptation.Drives.none(s.a_d.size, s.a_k.size))
