"""Adaptive inverse dynamics with measured task velocity."""

from __future__ import annotations

import numpy as np

from .gains import Gains
from .inertia import solve_inertia
from .law import Command, Gradients, Law, Signals, Truth
from .posture import Posture


class AdaptiveInverseDynamicsVelocity(Law):
    """Adaptive inverse dynamics with task velocity: Wang and Xie (2009), theorem 2.

    Law:          tau = M_hat J_hat^+ (xdd_d - K_v dxd - K_P dx - dJ_hat/dt qd) + C_hat qd + g_hat
                  (25), dJ_hat/dt at constant
                  estimate: the motion's part alone, which is what makes (26) hold.
    Adaptation:   da_d/dt = -Gamma_d Phi^T B^T P xi (29), xi = (dx, dxd), A^T P + P A = -Q (31);
                  da_k/dt = Gamma_k (Ybar_k^T B^T P xi - Y_k^T R_k (Y_k a_k - xd)) (30), Ybar_k of
                  (27).
    Closed loop:  dxi/dt = A xi + B (Phi da_d - Ybar_k da_k) (26).
    V:            xi^T P xi / 2 + D_d(a_d) + D_k(a_k), dV/dt = -xi^T Q xi / 2 - da_k^T Y_k^T R_k Y_k
                  da_k.
    Pose:         dxi/dt gains (delta, 0), delta = d(dx)/dt - (xd - xd_d); -P_22^-1 P_12^T delta
                  joins xdd_d and takes it out
                  of dV/dt, as dx^T P_11 delta = 0 and the rotation blocks of P are numbers; see
                  ``PoseTask``.
    Assumptions:  constant parameters; J_hat of full row rank; M_hat invertible; task velocity and
                  joint acceleration known.
    """

    name = "adaptive-inverse-dynamics-velocity"
    inverts_estimate = True
    needs_task_velocity = True

    def __init__(self, gains: Gains, posture: Posture) -> None:
        """Solve the Lyapunov equation (31)."""
        from scipy.linalg import solve_continuous_lyapunov  # here, because scipy is slow to import

        super().__init__(gains, posture)
        m = gains.K_P.shape[0]
        A = np.block([[np.zeros((m, m)), np.eye(m)], [-gains.K_P, -gains.K_v]])
        self.P = solve_continuous_lyapunov(A.T, -gains.Q)  # (31)
        self._B_T_P = self.P[m:]  # B^T P, B = (0, I)
        self._turning = np.linalg.solve(self.P[m:, m:], self.P[m:, :m])  # P_22^-1 P_12^T

    def _xi(self, s: Signals) -> np.ndarray:
        assert s.xd is not None  # the controller refuses measurements without it
        return np.concatenate([s.dx, s.xd - s.xd_d])

    def command(self, s: Signals) -> Command:
        """Return (25)."""
        k, xi = self.gains, self._xi(s)
        dx, dxd = xi[: s.dx.size], xi[s.dx.size :]
        u = s.xdd_d - k.K_v.dot(dxd) - k.K_P.dot(dx) - s.kinematics.Jdot_v
        if s.delta is not None:
            u -= self._turning.dot(s.delta)
        psi = None if s.inverse.unique else self.posture.acceleration(s.q, s.v)
        return Command(s.dynamics.torque(s.q, s.v, s.inverse.solve(u, psi)), memo=(xi,))  # (25)

    def gradients(self, s: Signals, command: Command, a: np.ndarray) -> Gradients:
        """Return g_d, (29), and g_k, (30)."""
        model, (xi,) = s.kinematics, command.memo
        z = self._B_T_P.dot(xi)
        force = solve_inertia(
            s.dynamics.mass_matrix(s.q), z.dot(model.J), s.watch
        )  # M_hat^-1 J_hat^T B^T P xi
        g_d = force.dot(s.dynamics.regressor(s.q, s.v, a))  # (29)
        g_k = self.prediction_gradient(s) - z.dot(model.acceleration_regressor(a))  # (30)
        return Gradients(g_d, g_k)

    def prediction_gradient(self, s: Signals) -> np.ndarray:
        """Return Y_k^T R_k (Y_k a_k - xd) (p_k): this law has no filter between the velocity and its prediction."""
        assert s.xd is not None  # the controller refuses measurements without it
        model = s.kinematics
        return self.gains.R_k.dot(
            model.Y_p.dot(s.a_k) + model.y_p0 - model.task.position(s.xd)
        ).dot(model.Y_p)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return xi^T P xi / 2."""
        xi = self._xi(s)
        return float(0.5 * xi @ (self.P @ xi))

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return -xi^T Q xi / 2 - da_k^T Y_k^T R_k Y_k da_k."""
        xi, prediction = self._xi(s), s.kinematics.Y_p @ (s.a_k - truth.a_k)
        return float(-0.5 * xi @ (self.gains.Q @ xi) - prediction @ (self.gains.R_k @ prediction))
