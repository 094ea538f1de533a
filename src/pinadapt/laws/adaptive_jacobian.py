"""The passivity-based adaptive Jacobian law."""

from __future__ import annotations

import numpy as np

from .gains import Gains
from .law import Command, Gradients, Law, Signals, Truth
from .posture import Posture


class AdaptiveJacobian(Law):
    """Passivity-based adaptive Jacobian tracking: C. Cheah, C. Liu, J.-J. Slotine, IEEE TAC 51 (2006) 1024-1029.

    Law:          tau = -J_hat^T (K_v dxd_hat + K_P dx) + Y(q, qd, qd_r, qdd_r) a_d - N D N s,
                  qd_r = J_hat^+ (xd_d - alpha dx) + N psi, s = qd - qd_r, N = I - J_hat^+ J_hat
                  (zero for a square J_hat).
    Adaptation:   da_d/dt = -Gamma_d Y_r^T s; da_k/dt = Gamma_k (Y_k^T (K_P + alpha K_v) dx - W_k^T
                  R_k (W_k a_k - y)).
    Closed loop:  M ds/dt + C s = -J_hat^T (K_v dxd_hat + K_P dx) + Y_r da_d - N D N s.
    V:            s^T M s / 2 + dx^T (K_P + alpha K_v) dx / 2 + D_d(a_d) + D_k(a_k),
                  dV/dt = -dxd_hat^T K_v dxd_hat - alpha dx^T K_P dx - da_k^T W_k^T R_k W_k da_k -
                  (N s)^T D (N s)
                  - s^T (f(qd) - f(qd_r)), f the true friction of the joints: monotone, so the last
                  term is at most zero.
    Pose:         qdd_r takes the true d(dx)/dt = xd - xd_d + delta, and dx^T (K_P + alpha K_v)
                  delta = 0; see ``PoseTask``.
    Assumptions:  constant parameters; J_hat of full row rank; task velocity known (it enters
                  qdd_r).
                  Neither acceleration nor M_hat^-1 is needed.
    """

    name = "adaptive-jacobian"
    needs_task_velocity = True
    energy_based = True

    def __init__(self, gains: Gains, posture: Posture) -> None:
        """Combine the gains once."""
        super().__init__(gains, posture)
        self._K_PV = gains.K_P + gains.alpha * gains.K_v

    def _reference_velocity(self, s: Signals) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Return xd_d - alpha dx (m), the null-space motion psi (n) and qd_r (n)."""
        u = s.xd_d - self.gains.alpha * s.dx
        psi = None if s.inverse.unique else self.posture.velocity(s.q)
        return u, psi, s.inverse.solve(u, psi)

    def command(self, s: Signals) -> Command:
        """Return the torque, with g_k and the regressor kept for the adaptation."""
        k, model = self.gains, s.kinematics
        g_k = self.prediction_gradient(s) - self._K_PV.dot(s.dx).dot(model.Y_k)
        u, psi, qd_r = self._reference_velocity(s)
        qdd_r = self._reference_acceleration(s, u, psi, model.jacobian_rate(s.rate_k(g_k)))
        Y_r, feedforward = s.dynamics.slotine_li(s.q, s.v, qd_r, qdd_r)
        error = s.v - qd_r
        torque = feedforward - (k.K_v.dot(s.dxd_hat) + k.K_P.dot(s.dx)).dot(model.J)
        if not s.inverse.unique:
            torque -= s.inverse.null(self.posture.damping * s.inverse.null(error))
        return Command(torque, memo=(g_k, Y_r, error))

    def _reference_acceleration(
        self, s: Signals, u: np.ndarray, psi: np.ndarray | None, Jdot: np.ndarray
    ) -> np.ndarray:
        """Return the time derivative of qd_r (n)."""
        assert s.xd is not None  # the controller refuses measurements without it
        ud = s.xdd_d - self.gains.alpha * (s.xd - s.xd_d)
        if s.delta is not None:
            ud -= self.gains.alpha * s.delta
        return s.inverse.solve_rate(u, psi, ud, self.posture.velocity_rate(s.v), Jdot)

    def gradients(self, s: Signals, command: Command, a: np.ndarray) -> Gradients:
        """Return g_d = Y_r^T s and g_k."""
        g_k, Y_r, error = command.memo
        return Gradients(error.dot(Y_r), g_k)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return s^T M s / 2 + dx^T (K_P + alpha K_v) dx / 2, M the true mass matrix."""
        error = s.v - self._reference_velocity(s)[2]
        return float(0.5 * error @ (truth.M @ error) + 0.5 * s.dx @ (self._K_PV @ s.dx))

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt."""
        k, prediction = self.gains, s.W_k @ (s.a_k - truth.a_k)
        qd_r = self._reference_velocity(s)[2]
        null, braking = (
            s.inverse.null(s.v - qd_r),
            truth.friction.torque(s.v) - truth.friction.torque(qd_r),
        )
        task = s.dxd_hat @ (k.K_v @ s.dxd_hat) + k.alpha * s.dx @ (k.K_P @ s.dx)
        joints = null @ (self.posture.damping * null) + (s.v - qd_r) @ braking
        return float(-task - prediction @ (k.R_k @ prediction) - joints)
