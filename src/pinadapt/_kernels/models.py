"""Algebra of the models: parameters of bodies and joints, regressors, kinematics of the frame."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled

PER_BODY = 10
_LEAST_MASS = 1e-6  # [kg] pin.Inertia stores mc / m, which loses its digits below this mass


@compiled("f8(f8[:], f8[:], f8[:])")
def take(pi: np.ndarray, ballast: np.ndarray, tens: np.ndarray) -> float:
    """Write pi + c ballast (10 n); return c, which is zero where no body needs ballast.

    Else no body is much lighter than its ballast, as centres of mass far outside of the robot would
    cost digits.
    """
    lightest = pi[0]
    for k in range(0, len(pi), PER_BODY):
        lightest = min(lightest, pi[k])
    c = 1.0 - 2.0 * lightest if lightest < _LEAST_MASS else 0.0
    for k in range(len(pi)):
        tens[k] = pi[k] + c * ballast[k]
    return c


@compiled(
    "void(f8[:,:,:], f8[:,:], f8[:,:], f8[:,:], f8[:], i8[:], f8[:,:], f8[:], f8[:], "
    "f8[:], f8[:], f8[:,:,:], f8[:,:,:], f8[:,:])",
    fills=5,
)
def column_motion(
    R: np.ndarray,
    o: np.ndarray,
    S: np.ndarray,
    dS: np.ndarray,
    lever: np.ndarray,
    parent: np.ndarray,
    columns: np.ndarray,
    home: np.ndarray,
    v: np.ndarray,
    phi: np.ndarray,
    phid: np.ndarray,
    Phi: np.ndarray,
    Phid: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """Write phi - home (3 + 3 p), its rate, dphi/dq (1 + p, 3, n), and the rate of that.

    phi_0 is the position of the frame, at ``lever`` (3) from the last joint, and phi_j how it moves
    with parameter j. Of the joints, R (N, 3, 3) and o (N, 3) are rotations and origins, S (6, n)
    axes as motions at the world's origin, linear before angular, dS their rates at the velocity v
    (n). A column (s, w) is a motion at the origin and in the axes of the joint ``parent`` that
    carries it, and moves the frame, r away, by d = s + w x r. A joint before it turns d; one behind
    it moves the frame by some u, which changes d by w x u.
    """
    c, n = len(R) - 1, len(v)
    p, pd, turns = phi[:3], phid[:3], S[3:]
    w, wd, turning, u = scratch[0], scratch[1], scratch[2], scratch[3]
    for i in range(3):
        p[i], pd[i] = o[c, i], 0.0
        for k in range(3):
            p[i] += R[c, i, k] * lever[k]
    for i in range(3):
        f, h = (i + 1) % 3, (i + 2) % 3
        for t in range(n):
            Phi[0, i, t] = S[i, t] + turns[f, t] * p[h] - turns[h, t] * p[f]
            pd[i] += Phi[0, i, t] * v[t]
    for i in range(3):
        f, h = (i + 1) % 3, (i + 2) % 3
        for t in range(n):
            Phid[0, i, t] = dS[i, t] + dS[f + 3, t] * p[h] - dS[h + 3, t] * p[f]
            Phid[0, i, t] += turns[f, t] * pd[h] - turns[h, t] * pd[f]
    for j in range(len(parent)):
        at, b = 3 * (j + 1), parent[j]
        d, dd = phi[at : at + 3], phid[at : at + 3]
        for i in range(3):  # the column in world axes, and the motion before and behind it
            w[i] = d[i] = turning[i] = u[i] = 0.0
            for k in range(3):
                d[i] += R[b, i, k] * columns[k, j]
                w[i] += R[b, i, k] * columns[k + 3, j]
            for t in range(b):
                turning[i] += turns[i, t] * v[t]
            for t in range(b, n):
                u[i] += Phi[0, i, t] * v[t]
        for i in range(3):
            f, h = (i + 1) % 3, (i + 2) % 3
            d[i] += w[f] * (p[h] - o[b, h]) - w[h] * (p[f] - o[b, f])
        for i in range(3):
            f, h = (i + 1) % 3, (i + 2) % 3
            wd[i] = turning[f] * w[h] - turning[h] * w[f]
            dd[i] = turning[f] * d[h] - turning[h] * d[f] + w[f] * u[h] - w[h] * u[f]
        for i in range(3):
            f, h = (i + 1) % 3, (i + 2) % 3
            for t in range(b):
                Phi[j + 1, i, t] = turns[f, t] * d[h] - turns[h, t] * d[f]
                Phid[j + 1, i, t] = dS[f + 3, t] * d[h] - dS[h + 3, t] * d[f]
                Phid[j + 1, i, t] += turns[f, t] * dd[h] - turns[h, t] * dd[f]
            for t in range(b, n):
                Phi[j + 1, i, t] = w[f] * Phi[0, h, t] - w[h] * Phi[0, f, t]
                Phid[j + 1, i, t] = wd[f] * Phi[0, h, t] - wd[h] * Phi[0, f, t]
                Phid[j + 1, i, t] += w[f] * Phid[0, h, t] - w[h] * Phid[0, f, t]
    for i in range(len(home)):
        phi[i] -= home[i]


LEAST_DEPTH = 0.1  # of a camera, relative to that at home


@compiled(
    "void(f8[:], f8[:,:], i8[:,:], i8[:,:], f8[:], f8[:], f8[:,:], f8[:,:], f8[:], f8[:,:], "
    "f8[:,:], f8[:,:], f8[:], f8[:,:], f8[:], f8[:,:], f8[:], f8[:])",
    fills=9,
)
def output_map(
    a: np.ndarray,
    N_0: np.ndarray,
    entries: np.ndarray,
    depths: np.ndarray,
    phi: np.ndarray,
    phid: np.ndarray,
    Phi: np.ndarray,
    Phid: np.ndarray,
    v: np.ndarray,
    N: np.ndarray,
    D: np.ndarray,
    G: np.ndarray,
    z: np.ndarray,
    Jdot: np.ndarray,
    y: np.ndarray,
    J: np.ndarray,
    yd: np.ndarray,
    Jdot_v: np.ndarray,
) -> None:
    """Write y = N phi / z (m) with z = D phi, J, the rate of y, and dJ/dt v.

    N is N_0 with a_j added at the places (j, row, column) of ``entries`` (k, 3), D (0, ..., 0, 1)
    with them at those of ``depths``. G = (N - y D) / z, J = G Phi (m, n), Jdot = G dPhi/dt.
    """
    m, last = N.shape[0], N.shape[1] - 1
    for i in range(m):
        for c in range(last + 1):
            N[i, c], D[i, c] = N_0[i, c], 0.0
        D[i, last] = 1.0
    for k in range(len(entries)):
        N[entries[k, 1], entries[k, 2]] += a[entries[k, 0]]
    for k in range(len(depths)):
        D[depths[k, 1], depths[k, 2]] += a[depths[k, 0]]
    for i in range(m):
        top = depth = zd = yd[i] = Jdot_v[i] = 0.0
        for c in range(last + 1):
            top += N[i, c] * phi[c]
            depth += D[i, c] * phi[c]
            zd += D[i, c] * phid[c]
        z[i] = max(depth, LEAST_DEPTH)
        y[i] = top / z[i]
        for t in range(len(v)):
            J[i, t] = Jdot[i, t] = 0.0
        for c in range(last):
            g = G[i, c] = (N[i, c] - y[i] * D[i, c]) / z[i]
            for t in range(len(v) if g != 0.0 else 0):
                J[i, t] += g * Phi[c, t]
                Jdot[i, t] += g * Phid[c, t]
        for t in range(len(v)):
            yd[i] += J[i, t] * v[t]
            Jdot_v[i] += Jdot[i, t] * v[t]
        Jdot_v[i] -= 2.0 * yd[i] * zd / z[i]


@compiled("void(i8[:,:], i8[:,:], f8[:], f8[:], f8[:], f8[:,:])")
def map_regressor(
    entries: np.ndarray,
    depths: np.ndarray,
    phi: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    X: np.ndarray,
) -> None:
    """Write the derivative (m, p) of (N phi - y D phi) / z by the parameters of ``output_map``."""
    for i in range(len(X)):
        for j in range(X.shape[1]):
            X[i, j] = 0.0
    for k in range(len(entries)):
        i = entries[k, 1]
        X[i, entries[k, 0]] += phi[entries[k, 2]] / z[i]
    for k in range(len(depths)):
        i = depths[k, 1]
        X[i, depths[k, 0]] -= y[i] * phi[depths[k, 2]] / z[i]


@compiled("void(f8[:,:], f8[:], f8[:,:], f8[:], f8[:])")
def add_products(
    A: np.ndarray, x: np.ndarray, B: np.ndarray, y: np.ndarray, out: np.ndarray
) -> None:
    """Add A x + B y to the first entries of a vector."""
    for i in range(len(A)):
        for t in range(len(x)):
            out[i] += A[i, t] * x[t] + B[i, t] * y[t]


@compiled("void(f8[:], i8[:,:], f8[:,:], f8[:], f8[:,:])")
def add_map_rates(
    rate: np.ndarray, entries: np.ndarray, Phi: np.ndarray, z: np.ndarray, Jdot: np.ndarray
) -> None:
    """Add dN/dt Phi / z to dJ/dt (m, n), for the rates (p) of the parameters of N."""
    for k in range(len(entries)):
        i = entries[k, 1]
        for t in range(Jdot.shape[1] if entries[k, 2] < len(Phi) else 0):
            Jdot[i, t] += rate[entries[k, 0]] * Phi[entries[k, 2], t] / z[i]


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
