"""What the laws without task velocity have in common: e, v, and the kinematic adaptation of Wang and Xie (2009)."""

from __future__ import annotations

import numpy as np

from .gains import Gains
from .law import Law, Signals, Truth
from .posture import Posture


class EstimatedVelocityLaw(Law):
    """Laws on e = dxd_hat + alpha dx that command an acceleration v and adapt the kinematics by (19).

    V = e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2 + parameters,
    dV/dt = -dxd_hat^T (K_v - alpha I) dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k W_k da_k.

    For a pose v also holds -alpha delta, delta = d(dx)/dt - (xd - xd_d): de/dt = d(dxd_hat)/dt + alpha (xd - xd_d + delta) is
    then as (17) has it, and dx^T (K_P + alpha K_v - alpha^2 I) delta = 0 leaves dV/dt; see ``PoseTask``.
    """

    needs_margin = True

    def __init__(self, gains: Gains, posture: Posture) -> None:
        """Combine the gains once."""
        super().__init__(gains, posture)
        self._K_PV = gains.K_P + gains.alpha * gains.K_v

    def error(self, s: Signals) -> np.ndarray:
        """Return e (m)."""
        return s.dxd_hat + self.gains.alpha * s.dx

    def kinematic_gradient(self, s: Signals) -> np.ndarray:
        """Return g_k (p_k) with da_k/dt = -Gamma_k g_k, (19)."""
        k = self.gains
        task = self._K_PV.dot(s.dx) + k.alpha * s.dxd_hat
        return self.prediction_gradient(s) - task.dot(s.kinematics.Y_k)  # (19)

    def commanded_acceleration(self, s: Signals, g_k: np.ndarray) -> np.ndarray:
        """Return v (n), with dJ_hat/dt qd = dJ/dt(a_k) v + Y_k da_k/dt: the estimate moves as well."""
        k, model = self.gains, s.kinematics
        Jdot_hat_v = model.Jdot_v + model.Y_k.dot(s.rate_k(g_k))
        u = s.xdd_d - k.K_v.dot(s.dxd_hat) - k.K_P.dot(s.dx) - Jdot_hat_v
        if s.delta is not None:
            u -= k.alpha * s.delta
        psi = None if s.inverse.unique else self.posture.acceleration(s.q, s.v)
        return s.inverse.solve(u, psi)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2."""
        e, alpha = self.error(s), self.gains.alpha
        return float(0.5 * e @ e + 0.5 * s.dx @ (self._K_PV @ s.dx) - 0.5 * alpha**2 * s.dx @ s.dx)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt; Wang and Xie print the bound with beta, this is the equality."""
        k, prediction = self.gains, s.W_k @ (s.a_k - truth.a_k)
        velocity = s.dxd_hat @ (k.K_v @ s.dxd_hat) - k.alpha * s.dxd_hat @ s.dxd_hat
        return float(-velocity - k.alpha * s.dx @ (k.K_P @ s.dx) - prediction @ (k.R_k @ prediction))
