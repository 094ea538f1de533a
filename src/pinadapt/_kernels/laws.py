"""Algebra of the laws: their filters, the posture, references, feedback and drives."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import Matrix, Vector, compiled


@compiled(fills=3)
def filtered_rates(
    low: Vector,
    X_k: Matrix,
    x_hat: Vector,
    a_k: Vector,
    x: Vector,
    bandwidth: float,
    v: Vector,
    bandwidth_a: float,
    W_k: Matrix,
    y: Vector,
    a: Vector,
) -> bool:
    """Write W_k = lambda (X_k - Z_k), y = lambda (x - x_0 - xi), and a = lambda_a (v - z).

    x_0 = x_hat - X_k a_k is the known part of the position; low is (Z_k, xi, z). W_k, X_k, Z_k are
    (m_p, p), y, x and x_hat (m_p), a and v (n). Return False, and write nothing, if low has
    another size.
    """
    m, p = X_k.shape
    xi = m * p
    z = xi + m
    if len(low) != z + len(a):
        return False
    for i in range(m):
        d = x[i] - x_hat[i]
        for j in range(p):
            d += X_k[i, j] * a_k[j]
            W_k[i, j] = bandwidth * (X_k[i, j] - low[i * p + j])
        y[i] = bandwidth * (d - low[xi + i])
    for i in range(len(a)):
        a[i] = bandwidth_a * (v[i] - low[z + i])
    return True


@compiled()
def observed(memory: Vector, lead: float, xd_hat: Vector, x: Vector, dx_o: Vector) -> None:
    """Write x_o + (half + lead) xd_hat - x (m_p).

    The memory is (x_o, half), half of the last step [s].
    """
    m = len(dx_o)
    for i in range(len(dx_o)):
        dx_o[i] = memory[i] + (memory[m] + lead) * xd_hat[i] - x[i]


@compiled()
def carry(
    memory: Vector,
    xd_hat: Vector,
    dx_o: Vector,
    bandwidth: float,
    dt: float,
    after: Vector,
) -> None:
    """Move (x_o, half) on for dt.

    x_o by (half + dt / 2) xd_hat - (1 - exp(-bandwidth dt)) dx_o; half becomes dt / 2, and the
    other half of this step comes with the velocity at its end.
    """
    m = len(dx_o)
    share = -math.expm1(-bandwidth * dt)
    for i in range(m):
        after[i] = memory[i] + (memory[m] + 0.5 * dt) * xd_hat[i] - share * dx_o[i]
    after[m] = 0.5 * dt


@compiled()
def advance(
    low: Vector,
    W_k: Matrix,
    y: Vector,
    a: Vector,
    bandwidth: float,
    bandwidth_a: float,
    dt: float,
    after: Vector,
) -> None:
    """Move low, (Z_k, xi, z) as in ``filtered_rates``, on for dt with its inputs held.

    Each moves by the share 1 - exp(-bandwidth dt) towards its input, X_k, d and v; W_k (m_p, p),
    y (m_p) and a (n) are these changes times the bandwidth.
    """
    m, p = W_k.shape
    way = -math.expm1(-bandwidth * dt) / bandwidth
    way_a = -math.expm1(-bandwidth_a * dt) / bandwidth_a
    for i in range(m):
        for j in range(p):
            after[i * p + j] = low[i * p + j] + way * W_k[i, j]
        after[m * p + i] = low[m * p + i] + way * y[i]
    for i in range(len(a)):
        after[m * p + m + i] = low[m * p + m + i] + way_a * a[i]


@compiled(fills=2)
def posture_velocity(
    q: Vector, posture: Matrix, v: Vector, w: float, psi: Vector, rate: Vector
) -> None:
    """Write psi = -w ``posture_offset`` and its rate -w (1 + 4 |e| / margin) v, both (n)."""
    for i in range(len(v)):
        d = q[i] - posture[0, i]
        e = max(d - posture[2, i], 0.0) + min(d - posture[1, i], 0.0)
        psi[i] = -w * (d + 2.0 * e * abs(e) / posture[3, i])
        rate[i] = -w * (1.0 + 4.0 * abs(e) / posture[3, i]) * v[i]


@compiled(fills=4)
def kinematic_drive(
    K_PV: Matrix,
    dx: Vector,
    alpha: float,
    xd_hat: Vector,
    xd_d: Vector,
    Y_k: Matrix,
    W_k: Matrix,
    R_k: Matrix,
    a_k: Vector,
    y: Vector,
    e: Vector,
    error: Vector,
    residual: Vector,
    gradient: Vector,
) -> None:
    """Write e (m), and the parts of g_k = Y_k^T error + W_k^T R_k residual (p_k), (19), and g_k.

    e = dxd_hat + alpha dx with dxd_hat = xd_hat - xd_d, error = -(K_P + alpha K_v) dx - alpha
    dxd_hat (m), residual = W_k a_k - y (m_p).
    """
    for j in range(len(a_k)):
        gradient[j] = 0.0
    for i in range(len(y)):
        x = -y[i]
        for j in range(len(a_k)):
            x += W_k[i, j] * a_k[j]
        residual[i] = x
    for i in range(len(y)):
        x = 0.0
        for t in range(len(y)):
            x += R_k[i, t] * residual[t]
        for j in range(len(a_k)):
            gradient[j] += W_k[i, j] * x
    for i in range(len(dx)):
        dxd = xd_hat[i] - xd_d[i]
        e[i] = dxd + alpha * dx[i]
        x = -alpha * dxd
        for t in range(len(dx)):
            x -= K_PV[i, t] * dx[t]
        error[i] = x
        for j in range(len(a_k)):
            gradient[j] += Y_k[i, j] * x


@compiled(fills=2)
def commanded_acceleration(
    xdd_d: Vector,
    K_v: Matrix,
    xd: Vector,
    xd_d: Vector,
    K_P: Matrix,
    dx: Vector,
    Jdot_v: Vector,
    Y_k: Matrix,
    a_k_rate: Vector,
    J: Matrix,
    gram_inverse: Matrix,
    qd: Vector,
    q: Vector,
    posture: Matrix,
    w: float,
    missed: Vector,
    v: Vector,
) -> None:
    """Write u - J psi (m), which psi misses, and v = psi + J^T G (u - J psi) (n), G as in J^+.

    psi = -2 w qd - w^2 offset, and u = xdd_d - K_v (xd - xd_d) - K_P dx - (dJ/dt(a_k) qd +
    Y_k da_k/dt) (m); offset is the ``posture_offset`` of q.
    """
    m, n = J.shape
    for t in range(n):
        d = q[t] - posture[0, t]
        e = max(d - posture[2, t], 0.0) + min(d - posture[1, t], 0.0)
        v[t] = -2.0 * w * qd[t] - w * w * (d + 2.0 * e * abs(e) / posture[3, t])
    for i in range(m):
        x = xdd_d[i] - Jdot_v[i]
        for j in range(m):
            x -= K_v[i, j] * (xd[j] - xd_d[j]) + K_P[i, j] * dx[j]
        for j in range(len(a_k_rate)):
            x -= Y_k[i, j] * a_k_rate[j]
        for t in range(n):
            x -= J[i, t] * v[t]
        missed[i] = x
    for i in range(m):
        x = 0.0
        for j in range(m):
            x += gram_inverse[i, j] * missed[j]
        for t in range(n):
            v[t] += J[i, t] * x


@compiled(fills=2)
def observation_drive(
    Y_k: Matrix,
    dx_o: Vector,
    c: float,
    X_k: Matrix,
    epsilon: Vector,
    R: Matrix,
    error: Vector,
    gradient: Vector,
) -> None:
    """Write c dx_o (m_p) and the gradient c Y_p^T dx_o + X_k^T R epsilon (p).

    Y_p are the first m_p rows of Y_k.
    """
    m = len(dx_o)
    for j in range(len(gradient)):
        gradient[j] = 0.0
    for i in range(m):
        error[i] = c * dx_o[i]
        x = 0.0
        for t in range(m):
            x += R[i, t] * epsilon[t]
        for j in range(len(gradient)):
            gradient[j] += Y_k[i, j] * error[i] + X_k[i, j] * x


@compiled(fills=2)
def reference(
    xd_d: Vector,
    dx: Vector,
    xdd_d: Vector,
    xd: Vector,
    dx_o: Vector,
    alpha: float,
    beta: float,
    u: Vector,
    ud: Vector,
) -> None:
    """Write u = xd_d - alpha (dx + dx_o) and ud = xdd_d - alpha (xd - xd_d - beta dx_o), both (m).

    dx_o (m_p) may be shorter: zeros follow.
    """
    for i in range(len(u)):
        error = dx[i]
        rate = xd[i] - xd_d[i]
        if i < len(dx_o):
            error += dx_o[i]
            rate -= beta * dx_o[i]
        u[i] = xd_d[i] - alpha * error
        ud[i] = xdd_d[i] - alpha * rate


@compiled(allocates=True)
def subtract_limited_damping(
    feedforward: Vector,
    D: Matrix,
    M: Matrix,
    rate: float,
    error: Vector,
    torque: Vector,
) -> None:
    """Write feedforward - (D^-1 + R^-1)^-1 error (n), R = rate M.

    As D e - D (D + R)^-1 D e; D and M are symmetric and positive definite.
    """
    n = len(error)
    work = np.empty((n + 1, n))
    L, z = work[:n], work[n]  # 1 / L_ii on the diagonal of L
    for i in range(n):
        x = 0.0
        for t in range(n):
            x += D[i, t] * error[t]
        z[i] = x
        torque[i] = feedforward[i] - x
        for j in range(i + 1):
            x = D[i, j] + rate * M[i, j]
            for t in range(j):
                x -= L[i, t] * L[j, t]
            L[i, j] = 1.0 / math.sqrt(x) if i == j else x * L[j, j]
    for i in range(n):
        for t in range(i):
            z[i] -= L[i, t] * z[t]
        z[i] *= L[i, i]
    for i in range(n - 1, -1, -1):
        for t in range(i + 1, n):
            z[i] -= L[t, i] * z[t]
        z[i] *= L[i, i]
    for i in range(n):
        x = 0.0
        for t in range(n):
            x += D[i, t] * z[t]
        torque[i] += x
