"""What the laws without task velocity have in common: e, v, and (19) of Wang and Xie (2009)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import empty

from .._kernels import feedback as kernels
from ..adaptation.adaptation import Drive
from ..signals import Signals
from .acceleration_law import AccelerationLaw
from .law import Command, Truth

_NO_POSTURE = np.zeros((4, 0))


@dataclass(slots=True, eq=False)
class AccelerationCommand(Command):
    """A command with what it took.

    Attributes:
        kinematic: drive of the kinematic estimate, (19).
        e: (m) dxd_hat + alpha dx.
    """

    kinematic: Drive = None  # type: ignore[assignment]  # always given
    e: np.ndarray = None  # type: ignore[assignment]  # always given


class EstimatedVelocityLaw(AccelerationLaw):
    """Laws on e = dxd_hat + alpha dx that command an acceleration v, kinematics adapted by (19).

    V = e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2 + parameters,
    dV/dt = -dxd_hat^T (K_v - alpha I) dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k W_k da_k.

    For a pose v also holds -alpha delta, delta = d(dx)/dt - (xd - xd_d): de/dt = d(dxd_hat)/dt +
    alpha (xd - xd_d + delta) is then as (17) has it, and dx^T (K_P + alpha K_v - alpha^2 I) delta =
    0 leaves dV/dt; see ``PoseTask``.
    """

    def error(self, s: Signals) -> np.ndarray:
        """Return e (m)."""
        return s.dxd_hat + self.alpha * s.dx

    def errors(self, s: Signals) -> tuple[np.ndarray, Drive]:
        """Return e (m) and the drive of (19).

        g_k = -Y_k^T ((K_P + alpha K_v) dx + alpha dxd_hat) + W_k^T R_k (W_k a_k - y).
        """
        W_k, y, m = s.filtered.W_k, s.filtered.y, s.dx.size
        e, error = empty(m), empty(m)
        residual, g_k = empty(y.size), empty(s.a_k.size)
        kernels.kinematic_drive(
            self.K_PV, s.dx, self.alpha, s.xd_hat, s.xd_d, s.Y_k, W_k, self.R_k, s.a_k, y,
            e, error, residual, g_k,
        )  # fmt: skip
        return e, Drive(s.Y_k, error, W_k, residual, self.R_k, g_k)

    def commanded_acceleration(self, s: Signals, a_k_rate: np.ndarray) -> np.ndarray:
        """Return v = J^+ (xdd_d - K_v dxd_hat - K_P dx - dJ_hat/dt qd) + (I - J^+ J) psi (n).

        dJ_hat/dt qd = dJ/dt(a_k) qd + Y_k da_k/dt: the estimate moves as well. psi is that of the
        posture.
        """
        Jdot_v = s.Jdot_v if s.delta is None else s.Jdot_v + self.alpha * s.delta
        inverse, posture, v = s.inverse, self.posture, empty(s.v.size)
        q, rows, w = s.v, _NO_POSTURE, 0.0
        if not inverse.unique:
            q, rows, w = posture.coordinates(s.q), posture.rows, posture.frequency
        kernels.commanded_acceleration(
            s.xdd_d, self.K_v, s.xd_hat, s.xd_d, self.K_P, s.dx, Jdot_v, s.Y_k, a_k_rate,
            inverse.J, inverse.gram_inverse, s.v, q, rows, w, v,
        )  # fmt: skip
        return v

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2."""
        e, alpha = self.error(s), self.alpha
        return float(0.5 * e @ e + 0.5 * s.dx @ (self.K_PV @ s.dx) - 0.5 * alpha**2 * s.dx @ s.dx)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt; Wang and Xie print the bound with beta, this is the equality."""
        prediction = s.filtered.W_k @ (s.a_k - truth.a_k)
        velocity = s.dxd_hat @ (self.K_v @ s.dxd_hat) - self.alpha * s.dxd_hat @ s.dxd_hat
        position = self.alpha * s.dx @ (self.K_P @ s.dx)
        return float(-velocity - position - prediction @ (self.R_k @ prediction))
