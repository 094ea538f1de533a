"""Set-point control where the regressor of gravity is approximate, too."""

from __future__ import annotations

from dataclasses import dataclass

from .approximate_jacobian import ApproximateJacobian


@dataclass(frozen=True, eq=False)
class ApproximateJacobianGravity(ApproximateJacobian):
    """Set point with approximate Jacobian and gravity regressor, as link lengths are wrong.

    After H. Yazarel, C. Cheah, IEEE TAC 47 (2002) 1580-1585, whose law could not be recovered
    exactly. The torque is that of ``ApproximateJacobian`` with Z_hat, the regressor at the believed
    lengths, in place of Z: unknown lengths are not lumped with the inertias, and any adaptation
    does, natural included. What follows is proved for this form.

    Law:          tau = Z_hat(q) a_d + g_0(q) - J_hat^T K_P s(dx) - K_v qd.
    Adaptation:   da_d/dt = -Gamma_d Z_hat^T y, y = qd + weight K_v^-1 J_hat^T K_P s(dx).
    Closed loop:  M qdd + C qd = Z_hat (a_d - a) - r - J_hat^T K_P s - K_v qd - f(qd), with any a,
                  and r(q) = g(q) - Z_hat(q) a - g_0(q), what the approximate regressor leaves.
    V:            that of ``ApproximateJacobian`` with D_d(a_d) from a; dV/dt = that of
                  ``ApproximateJacobian`` - y^T r, an equality; ``dissipation`` returns the first
                  part, as it knows no r.
    Convergence:  take an a for which r vanishes where the arm is to rest, Z_hat a + g_0 = g there.
                  Then |r| <= nu |F|, F = J_hat^T K_P s, in the metric K_v^-1, nu the smaller the
                  stiffer K_P, and dV/dt <= -(1 - mu) |qd|^2 + (weight + mismatch + nu) |qd| |F| -
                  weight (1 - nu) |F|^2: nu counts as an error of the Jacobian does.
    Assumptions:  those of ``ApproximateJacobian`` but for the exact regressor; gravity at the set
                  point in the range of Z_hat, which the ten parameters of all bodies span but for
                  vertical axes, where both are zero; those of the last body alone do not.
                  Redundant arms: locally, as the set point does not fix where they rest.
    """

    name = "approximate-jacobian-gravity"
    sources = ("YazarelCheah2002",)
    approximate_regressor = True
