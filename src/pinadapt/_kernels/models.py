"""Algebra of the models: parameters of bodies and joints, regressors, kinematics of the frame."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled
from ..exceptions import ArrayError

PER_BODY = 10
_LEAST_MASS = (
    1e-6  # [kg] pin.Inertia stores the centre of mass mc/m, which loses its digits below this mass
)


@compiled("f8(f8[:], f8[:], f8[:,:])")
def take(pi: np.ndarray, ballast: np.ndarray, tens: np.ndarray) -> float:
    """Write pi (10 n) and c times the ballast (10 n) as rows (n, 10); return c.

    c is zero where no body needs ballast, else such that no body is much lighter than its ballast:
    centres of mass far outside of the robot would cost digits.
    """
    n = len(tens)
    if len(pi) != PER_BODY * n or len(ballast) != len(pi) or tens.shape[1] != PER_BODY:
        raise ArrayError
    lightest = pi[0]
    for b in range(len(tens)):
        lightest = min(lightest, pi[PER_BODY * b])
    c = 1.0 - 2.0 * lightest if lightest < _LEAST_MASS else 0.0
    for b in range(len(tens)):
        for i in range(PER_BODY):
            tens[b, i] = pi[PER_BODY * b + i] + c * ballast[PER_BODY * b + i]
    return c


@compiled("void(f8[:], i8, f8[:,:], f8[:], f8[:])")
def place(
    theta: np.ndarray,
    first: int,
    directions: np.ndarray,
    offset: np.ndarray,
    translation: np.ndarray,
) -> None:
    """Write offset + directions theta[first : first + k] (3), directions (3, k)."""
    k = directions.shape[1]
    if len(directions) != 3 or first < 0 or first + k > len(theta):
        raise ArrayError
    if len(offset) != 3 or len(translation) != 3:
        raise ArrayError
    for i in range(3):
        x = offset[i]
        for j in range(directions.shape[1]):
            x += directions[i, j] * theta[first + j]
        translation[i] = x


@compiled(
    "void(f8[:,:,:], f8[:,:], f8[:,:], f8[:,:], f8[:,:], f8[:], f8[:], i8[:], i8[:], f8[:,:], "
    "f8[:,:], f8[:,:], f8[:], f8[:], f8[:,:], f8[:], f8[:,:])",
    fills=7,
)
def frame_motion(
    R: np.ndarray,
    o: np.ndarray,
    V: np.ndarray,
    S: np.ndarray,
    dS: np.ndarray,
    qd: np.ndarray,
    lever: np.ndarray,
    rows: np.ndarray,
    parent: np.ndarray,
    directions: np.ndarray,
    J: np.ndarray,
    Jdot: np.ndarray,
    Jdot_v: np.ndarray,
    xd_hat: np.ndarray,
    Y_k: np.ndarray,
    x_hat: np.ndarray,
    X_k: np.ndarray,
) -> None:
    """Write J, dJ/dt (m, n), dJ/dt qd, J qd (m), Y_k (m, p), position (m_p), X_k (m_p, p).

    Of the joints, R (N, 3, 3) and o (N, 3) are rotations and origins, V (N, 6) velocities, linear
    before angular, in their own axes; the last one carries the frame at ``lever`` (3). S (6, n) are
    the joints' axes as motions at the world's origin, dS their rates at the joint velocity qd (n).
    ``rows`` (m) of the frame's motion are wanted, linear before angular. With the frame at x an
    axis S = (l, r) moves it by J = (l + r x x, r), and dJ/dt = (dl + dr x x + r x xd, dr). Column
    by column Y_k is R (w x b) in the linear rows, the first m_p, else zero, and X_k is R b there:
    of each parameter ``parent`` (p) is the joint and b, a column of ``directions`` (3, p), the
    direction.
    """
    c = len(R) - 1
    x, y, z = o[c, 0], o[c, 1], o[c, 2]
    for t in range(3):
        x += R[c, 0, t] * lever[t]
        y += R[c, 1, t] * lever[t]
        z += R[c, 2, t] * lever[t]
    for i in range(len(x_hat)):
        x_hat[i] = x if rows[i] == 0 else y if rows[i] == 1 else z
    ux = V[c, 0] + V[c, 4] * lever[2] - V[c, 5] * lever[1]  # V + w x lever
    uy = V[c, 1] + V[c, 5] * lever[0] - V[c, 3] * lever[2]
    uz = V[c, 2] + V[c, 3] * lever[1] - V[c, 4] * lever[0]
    xd = R[c, 0, 0] * ux + R[c, 0, 1] * uy + R[c, 0, 2] * uz
    yd = R[c, 1, 0] * ux + R[c, 1, 1] * uy + R[c, 1, 2] * uz
    zd = R[c, 2, 0] * ux + R[c, 2, 1] * uy + R[c, 2, 2] * uz
    for i in range(len(rows)):
        r = rows[i]
        if r < 3:
            xd_hat[i] = xd if r == 0 else yd if r == 1 else zd
        else:
            k = r - 3
            xd_hat[i] = R[c, k, 0] * V[c, 3] + R[c, k, 1] * V[c, 4] + R[c, k, 2] * V[c, 5]
        Jdot_v[i] = 0.0
        for t in range(J.shape[1]):
            column, rate = S[r, t], dS[r, t]
            if r == 0:
                column += S[4, t] * z - S[5, t] * y
                rate += dS[4, t] * z - dS[5, t] * y + S[4, t] * zd - S[5, t] * yd
            elif r == 1:
                column += S[5, t] * x - S[3, t] * z
                rate += dS[5, t] * x - dS[3, t] * z + S[5, t] * xd - S[3, t] * zd
            elif r == 2:
                column += S[3, t] * y - S[4, t] * x
                rate += dS[3, t] * y - dS[4, t] * x + S[3, t] * yd - S[4, t] * xd
            J[i, t], Jdot[i, t] = column, rate
            Jdot_v[i] += rate * qd[t]
    for j in range(len(parent)):
        k = parent[j]
        x = V[k, 4] * directions[2, j] - V[k, 5] * directions[1, j]
        y = V[k, 5] * directions[0, j] - V[k, 3] * directions[2, j]
        z = V[k, 3] * directions[1, j] - V[k, 4] * directions[0, j]
        for i in range(len(rows)):
            r = rows[i]
            Y_k[i, j] = R[k, r, 0] * x + R[k, r, 1] * y + R[k, r, 2] * z if r < 3 else 0.0
        for i in range(len(x_hat)):
            r = rows[i]
            X_k[i, j] = R[k, r, 0] * directions[0, j] + R[k, r, 1] * directions[1, j]
            X_k[i, j] += R[k, r, 2] * directions[2, j]


@compiled("void(f8[:], f8[:], f8[:], f8[:])", fills=2)
def polarise(v: np.ndarray, v_r: np.ndarray, mean: np.ndarray, half: np.ndarray) -> None:
    """Write (v + v_r) / 2 and (v - v_r) / 2 (n)."""
    n = len(mean)
    if len(v) != n or len(v_r) != n or len(half) != n:
        raise ArrayError
    for t in range(len(mean)):
        mean[t] = 0.5 * (v[t] + v_r[t])
        half[t] = 0.5 * (v[t] - v_r[t])


@compiled("void(f8[:,:], f8[:], f8[:,:], f8[:])", fills=2)
def polarised(Y_0: np.ndarray, pi: np.ndarray, Y: np.ndarray, tau: np.ndarray) -> None:
    """Take Y_0 off Y (n, p), and write tau = Y pi (n)."""
    if Y.shape != (len(tau), len(pi)) or Y_0.shape != Y.shape:
        raise ArrayError
    for i in range(len(tau)):
        x = 0.0
        for j in range(len(pi)):
            y = Y[i, j] - Y_0[i, j]
            Y[i, j] = y
            x += y * pi[j]
        tau[i] = x


@compiled("void(f8[:], i8[:], f8[:,:], f8[:,:,:], f8[:,:], i8[:], i8[:], f8[:,:])")
def add_translation_rates(
    a_k_rate: np.ndarray,
    parent: np.ndarray,
    directions: np.ndarray,
    R: np.ndarray,
    J: np.ndarray,
    last: np.ndarray,
    place: np.ndarray,
    Jdot: np.ndarray,
) -> None:
    """Add axis x (R b da_k/dt) to the position rows of dJ/dt (m, n), parameter by parameter.

    Of each parameter, b is a column of ``directions`` (3, p), in the axes of its parent joint,
    whose rotation is in R (N, 3, 3). Joints up to that one turn it: columns up to ``last`` (N),
    axes in the angular rows of J (6, n), zero for slides. ``place`` (m_p) are their coordinates.
    """
    p = len(a_k_rate)
    if len(parent) != p or directions.shape != (3, p):
        raise ArrayError
    for j in range(len(a_k_rate)):
        k = parent[j]
        x = y = z = 0.0
        for t in range(3):
            b = directions[t, j] * a_k_rate[j]
            x += R[k, 0, t] * b
            y += R[k, 1, t] * b
            z += R[k, 2, t] * b
        for t in range(last[k] + 1):
            for i in range(len(place)):
                if place[i] == 0:
                    Jdot[i, t] += J[4, t] * z - J[5, t] * y
                elif place[i] == 1:
                    Jdot[i, t] += J[5, t] * x - J[3, t] * z
                else:
                    Jdot[i, t] += J[3, t] * y - J[4, t] * x


@compiled(
    "void(f8[:,:,:], f8[:,:], f8[:], i8[:], i8[:], f8[:,:], f8[:], f8[:,:])",
    fills=2,
)
def positions_at(
    R: np.ndarray,
    o: np.ndarray,
    lever: np.ndarray,
    place: np.ndarray,
    parent: np.ndarray,
    directions: np.ndarray,
    x: np.ndarray,
    X_k: np.ndarray,
) -> None:
    """Write o + R lever (m_p) of the last joint, and R b (m_p, p) parameter by parameter.

    R (N, 3, 3) and o (N, 3) are rotations and origins of the joints, ``place`` (m_p) the wanted
    coordinates; of each parameter ``parent`` (p) is the joint and b, a column of ``directions``
    (3, p), the direction there.
    """
    c = len(R) - 1
    for i in range(len(place)):
        r = place[i]
        x[i] = o[c, r] + R[c, r, 0] * lever[0] + R[c, r, 1] * lever[1] + R[c, r, 2] * lever[2]
        for j in range(len(parent)):
            p = parent[j]
            X_k[i, j] = R[p, r, 0] * directions[0, j] + R[p, r, 1] * directions[1, j]
            X_k[i, j] += R[p, r, 2] * directions[2, j]


@compiled(
    "void(f8[:,:], i8[:,:], f8[:,:], f8[:,:], f8[:], f8[:], f8[:], f8, f8[:,:], f8[:], f8[:,:], "
    "f8[:])",
    fills=2,
)
def add_joint_effects(
    values: np.ndarray,
    columns: np.ndarray,
    shape: np.ndarray,
    directions: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    g: np.ndarray,
    one: float,
    Y_b: np.ndarray,
    tau_b: np.ndarray,
    Y: np.ndarray,
    tau: np.ndarray,
) -> None:
    """Write [Y_b, Y_j] (n, p) and tau_b + the joints' torque (n); Y_b and tau_b are the bodies'.

    Of each of n joints, and of the shafts along directions (k, n), the torque is values . f, and
    f = (a, v, s, g s, |s|, one) with s = tanh(v shape_0) (1 + shape_1 exp(-|v| shape_2)). An entry
    of f is column ``columns`` (6, n + k) of Y_j, where that is not negative. ``one`` is that of a
    constant torque, zero for the momentum.
    """
    n, p = Y_b.shape
    if len(v) != n or len(a) != n or len(g) != n or len(tau_b) != n or len(tau) != n:
        raise ArrayError
    if len(Y) != n or Y.shape[1] < p or values.shape[1] != columns.shape[1]:
        raise ArrayError
    for i in range(n):
        tau[i] = tau_b[i]
        for j in range(p):
            Y[i, j] = Y_b[i, j]
        for j in range(p, Y.shape[1]):
            Y[i, j] = 0.0
    for k in range(values.shape[1]):
        u, w, load = 0.0, 0.0, 0.0
        if k < n:
            u, w, load = v[k], a[k], g[k]
        else:
            for i in range(n):
                u += directions[k - n, i] * v[i]
                w += directions[k - n, i] * a[i]
        s = math.tanh(u * shape[0, k])
        if shape[1, k] != 0.0:
            s *= 1.0 + shape[1, k] * math.exp(-abs(u) * shape[2, k])
        for c, f in enumerate((w, u, s, load * s, abs(s), one)):
            j = columns[c, k]
            if k < n:
                tau[k] += values[c, k] * f
                if j >= 0:
                    Y[k, p + j] = f
            else:
                for i in range(n):
                    tau[i] += directions[k - n, i] * values[c, k] * f
                    if j >= 0:
                        Y[i, p + j] = directions[k - n, i] * f


@compiled(
    "void(f8[:,:], f8[:,:], f8[:], f8[:], f8, f8[:,:], f8[:,:], f8, f8, f8[:,::1], f8[:,::1], "
    "f8[:,::1])",
    fills=3,
)
def filtered_regressor(
    Y_M: np.ndarray,
    Y_0: np.ndarray,
    p_0: np.ndarray,
    tau_0: np.ndarray,
    bandwidth: float,
    Z: np.ndarray,
    before: np.ndarray,
    held: float,
    share: float,
    u: np.ndarray,
    Z_now: np.ndarray,
    W: np.ndarray,
) -> None:
    """Write u = lambda Y_M - Y_0, Z at its time, and W = lambda Y_M - Z (n, p + 1).

    Since the given Z it has moved by held (before - Z) + share (u - before). The last column is
    that of the known parts p_0 and tau_0 (n), in place of Y_M and Y_0 (n, p).
    """
    n, p = Y_M.shape
    if Y_0.shape != (n, p) or len(p_0) != n or len(tau_0) != n:
        raise ArrayError
    if Z.shape != (n, p + 1) or before.shape != (n, p + 1) or u.shape != (n, p + 1):
        raise ArrayError
    if Z_now.shape != (n, p + 1) or W.shape != (n, p + 1):
        raise ArrayError
    for i in range(n):
        for j in range(p):
            momentum = bandwidth * Y_M[i, j]
            u[i, j] = momentum - Y_0[i, j]
            Z_now[i, j] = Z[i, j] + held * (before[i, j] - Z[i, j])
            Z_now[i, j] += share * (u[i, j] - before[i, j])
            W[i, j] = momentum - Z_now[i, j]
        momentum = bandwidth * p_0[i]
        u[i, p] = momentum - tau_0[i]
        Z_now[i, p] = Z[i, p] + held * (before[i, p] - Z[i, p])
        Z_now[i, p] += share * (u[i, p] - before[i, p])
        W[i, p] = momentum - Z_now[i, p]


@compiled(
    "void(f8[:,:,:], f8[:,:], f8[:,:], f8[:,:], f8[:,:], i8[:], i8[:], f8[:], f8[:,:], f8[:,:])",
    fills=2,
    allocates=True,
)
def momentum_columns(
    R: np.ndarray,
    o: np.ndarray,
    V: np.ndarray,
    J: np.ndarray,
    Jdot: np.ndarray,
    bodies: np.ndarray,
    columns: np.ndarray,
    gravity: np.ndarray,
    Y_M: np.ndarray,
    Y_0: np.ndarray,
) -> None:
    """Write the regressors (n, 10 N) of J_i^T h and of -dJ_i^T h + weight, h the momenta of bodies.

    Of the N bodies, R (N, 3, 3) and o (N, 3) are rotations and origins, V (N, 6) velocities, linear
    before angular, in their own axes. J and Jdot (6, n) are the joints' axes as motions at the
    world's origin. Joint coordinate ``columns[k]`` moves body ``bodies[k]``; gravity (3) in world
    axes. With the row s = (l, r) in the body's axes and its velocity (v, w), s^T h = m l^T v +
    mc^T (l x w + v x r) + r^T I w.
    """
    for i in range(Y_M.shape[0]):
        for j in range(Y_M.shape[1]):
            Y_M[i, j] = Y_0[i, j] = 0.0
    s, d, weights = np.empty(6), np.empty(6), np.zeros((len(R), 3))
    for b in range(len(R)):
        for t in range(3):
            for e in range(3):
                weights[b, t] -= R[b, e, t] * gravity[e]
    for k in range(len(bodies)):
        b, c = bodies[k], columns[k]
        for t in range(3):  # axes of the body; the linear part at its origin
            s[t] = s[t + 3] = d[t] = d[t + 3] = 0.0
        for e in range(3):
            f, h = (e + 1) % 3, (e + 2) % 3
            moving = J[e, c] + J[f + 3, c] * o[b, h] - J[h + 3, c] * o[b, f]
            rate = Jdot[e, c] + Jdot[f + 3, c] * o[b, h] - Jdot[h + 3, c] * o[b, f]
            for t in range(3):
                s[t] += R[b, e, t] * moving
                s[t + 3] += R[b, e, t] * J[e + 3, c]
                d[t] += R[b, e, t] * rate
                d[t + 3] += R[b, e, t] * Jdot[e + 3, c]
        g = weights[b]
        v, w, i = V[b, :3], V[b, 3:], 10 * b
        Y_M[c, i] = s[0] * v[0] + s[1] * v[1] + s[2] * v[2]
        Y_0[c, i] = s[0] * g[0] + s[1] * g[1] + s[2] * g[2]
        Y_0[c, i] -= d[0] * v[0] + d[1] * v[1] + d[2] * v[2]
        for t in range(3):
            f, h = (t + 1) % 3, (t + 2) % 3
            Y_M[c, i + 1 + t] = s[f] * w[h] - s[h] * w[f] + v[f] * s[h + 3] - v[h] * s[f + 3]
            Y_0[c, i + 1 + t] = (
                g[f] * s[h + 3]
                - g[h] * s[f + 3]
                - (d[f] * w[h] - d[h] * w[f] + v[f] * d[h + 3] - v[h] * d[f + 3])
            )
        j = i + 4
        for t in range(3):  # xx, xy, yy, xz, yz, zz
            for e in range(t + 1):
                if e == t:
                    Y_M[c, j] = s[t + 3] * w[t]
                    Y_0[c, j] = -d[t + 3] * w[t]
                else:
                    Y_M[c, j] = s[t + 3] * w[e] + s[e + 3] * w[t]
                    Y_0[c, j] = -d[t + 3] * w[e] - d[e + 3] * w[t]
                j += 1
