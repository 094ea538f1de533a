"""What the laws without task velocity have in common: e, v, and the kinematic adaptation of Wang and Xie (2009)."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled
from .gains import Gains
from .law import Law, Signals, Truth
from .posture import Posture


class EstimatedVelocityLaw(Law):
    """Laws on e = dxd_hat + alpha dx that command an acceleration v and adapt the kinematics by (19).

    V = e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2 + parameters,
    dV/dt = -dxd_hat^T (K_v - alpha I) dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k W_k da_k.

    For a pose v also holds -alpha delta, delta = d(dx)/dt - (xd - xd_d): de/dt = d(dxd_hat)/dt +
    alpha (xd - xd_d + delta) is then as (17) has it, and dx^T (K_P + alpha K_v - alpha^2 I) delta =
    0 leaves dV/dt; see ``PoseTask``.
    """

    needs_margin = True

    def __init__(self, gains: Gains, posture: Posture) -> None:
        """Combine the gains once."""
        super().__init__(gains, posture)
        self._K_PV = gains.K_P + gains.alpha * gains.K_v

    def error(self, s: Signals) -> np.ndarray:
        """Return e (m)."""
        return s.dxd_hat + self.gains.alpha * s.dx

    def error_force(self, s: Signals) -> np.ndarray:
        """Return J_hat^T e (n)."""
        force = np.empty(s.v.size)
        _error_force(s.kinematics.J, s.dxd_hat, self.gains.alpha, s.dx, force)
        return force

    def kinematic_gradient(self, s: Signals) -> np.ndarray:
        """Return g_k (p_k) with da_k/dt = -Gamma_k g_k, (19)."""
        k, g_k = self.gains, np.empty(s.a_k.size)
        _kinematic_gradient(
            self._K_PV, s.dx, k.alpha, s.dxd_hat, s.kinematics.Y_k, s.W_k, k.R_k, s.a_k, s.y, g_k
        )
        return g_k

    def commanded_acceleration(self, s: Signals, g_k: np.ndarray) -> np.ndarray:
        """Return v = J^+ u + (I - J^+ J) psi (n), u = xdd_d - K_v dxd_hat - K_P dx - dJ_hat/dt qd, psi the posture's.

        dJ_hat/dt qd = dJ/dt(a_k) v + Y_k da_k/dt: the estimate moves as well.
        """
        k, model, inverse, v = self.gains, s.kinematics, s.inverse, np.empty(s.v.size)
        Jdot_v = model.Jdot_v if s.delta is None else model.Jdot_v + k.alpha * s.delta
        w = 0.0 if inverse.unique else self.posture.frequency
        _commanded_acceleration(
            s.xdd_d, k.K_v, s.dxd_hat, k.K_P, s.dx, Jdot_v, model.Y_k, s.rate_k(g_k),
            inverse.J, inverse.gram_inverse, s.v, self.posture.offset(s.q), w, v,
        )  # fmt: skip
        return v

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return e^T e / 2 + dx^T (K_P + alpha K_v - alpha^2 I) dx / 2."""
        e, alpha = self.error(s), self.gains.alpha
        return float(0.5 * e @ e + 0.5 * s.dx @ (self._K_PV @ s.dx) - 0.5 * alpha**2 * s.dx @ s.dx)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt; Wang and Xie print the bound with beta, this is the equality."""
        k, prediction = self.gains, s.W_k @ (s.a_k - truth.a_k)
        velocity = s.dxd_hat @ (k.K_v @ s.dxd_hat) - k.alpha * s.dxd_hat @ s.dxd_hat
        return float(
            -velocity - k.alpha * s.dx @ (k.K_P @ s.dx) - prediction @ (k.R_k @ prediction)
        )


@compiled("void(f8[:,:], f8[:], f8, f8[:], f8[:,:], f8[:,:], f8[:,:], f8[:], f8[:], f8[:])")
def _kinematic_gradient(
    K_PV: np.ndarray,
    dx: np.ndarray,
    alpha: float,
    dxd_hat: np.ndarray,
    Y_k: np.ndarray,
    W_k: np.ndarray,
    R_k: np.ndarray,
    a_k: np.ndarray,
    y: np.ndarray,
    g_k: np.ndarray,
) -> None:
    """Write g_k = W_k^T R_k (W_k a_k - y) - Y_k^T ((K_P + alpha K_v) dx + alpha dxd_hat) (p_k), (19)."""
    residual = np.empty(len(y))
    for i in range(len(y)):
        residual[i] = -y[i]
        for j in range(len(a_k)):
            residual[i] += W_k[i, j] * a_k[j]
    for j in range(len(a_k)):
        g_k[j] = 0.0
    for i in range(len(y)):
        weighted = 0.0
        for t in range(len(y)):
            weighted += R_k[i, t] * residual[t]
        for j in range(len(a_k)):
            g_k[j] += W_k[i, j] * weighted
    for i in range(len(dx)):
        task = alpha * dxd_hat[i]
        for t in range(len(dx)):
            task += K_PV[i, t] * dx[t]
        for j in range(len(a_k)):
            g_k[j] -= Y_k[i, j] * task


@compiled(
    "void(f8[:], f8[:,:], f8[:], f8[:,:], f8[:], f8[:], f8[:,:], f8[:], f8[:,:], f8[:,:], f8[:], f8[:], f8, f8[:])"
)
def _commanded_acceleration(
    xdd_d: np.ndarray,
    K_v: np.ndarray,
    dxd_hat: np.ndarray,
    K_P: np.ndarray,
    dx: np.ndarray,
    Jdot_v: np.ndarray,
    Y_k: np.ndarray,
    a_k_rate: np.ndarray,
    J: np.ndarray,
    gram_inverse: np.ndarray,
    qd: np.ndarray,
    offset: np.ndarray,
    w: float,
    v: np.ndarray,
) -> None:
    """Write v = psi + J^T (J J^T)^-1 (u - J psi) (n) with psi = -2 w qd - w^2 offset.

    u = xdd_d - K_v dxd_hat - K_P dx - (dJ/dt(a_k) qd + Y_k da_k/dt) (m).
    """
    m, n = J.shape
    for t in range(n):
        v[t] = -2.0 * w * qd[t] - w * w * offset[t]
    rest = np.empty(m)  # u - J psi
    for i in range(m):
        x = xdd_d[i] - Jdot_v[i]
        for j in range(m):
            x -= K_v[i, j] * dxd_hat[j] + K_P[i, j] * dx[j]
        for j in range(len(a_k_rate)):
            x -= Y_k[i, j] * a_k_rate[j]
        for t in range(n):
            x -= J[i, t] * v[t]
        rest[i] = x
    for i in range(m):
        x = 0.0
        for j in range(m):
            x += gram_inverse[i, j] * rest[j]
        for t in range(n):
            v[t] += J[i, t] * x


@compiled("void(f8[:,:], f8[:], f8, f8[:], f8[:])")
def _error_force(
    J: np.ndarray, dxd_hat: np.ndarray, alpha: float, dx: np.ndarray, force: np.ndarray
) -> None:
    """Write J^T (dxd_hat + alpha dx) (n)."""
    for j in range(len(force)):
        force[j] = 0.0
    for i in range(len(dx)):
        e = dxd_hat[i] + alpha * dx[i]
        for j in range(len(force)):
            force[j] += J[i, j] * e
