"""Algebra of the models: parameters of bodies and joints, regressors, kinematics of the frame."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import IndexTable, Indices, Matrices, Matrix, Vector, compiled

PER_BODY = 10
# [kg] pin.Inertia stores mc / m, which loses its digits below this mass; half, twice: the same
_LEAST_MASS = 1e-6


@compiled()
def take(pi: Vector, inertial: Vector) -> float:
    """Write pi (10 n) with c added to all masses; return c, which is zero where none needs it.

    Else no body is much lighter than its ballast c, as centres of mass far outside of the robot
    would cost digits.
    """
    lightest = pi[0]
    for k in range(0, len(pi), PER_BODY):
        lightest = min(lightest, pi[k])
    c = 1.0 - 2.0 * lightest if lightest < _LEAST_MASS else 0.0
    for k in range(len(pi)):
        inertial[k] = pi[k] + (c if k % PER_BODY == 0 else 0.0)
    return c


# of a camera, relative to that at home; half, twice: the same errors in pictures
LEAST_DEPTH = 0.1


@compiled(fills=11)
def observed_motion(
    R: Matrices,
    o: Matrix,
    S: Matrix,
    dS: Matrix,
    links: IndexTable,
    columns: Matrix,
    v: Vector,
    a: Vector,
    constants: Matrices,
    entries: IndexTable,
    scratch: Matrix,
    motion: Matrices,
    maps: Matrices,
    G: Matrix,
    Jdot: Matrix,
    y: Vector,
    J: Matrix,
    yd: Vector,
    Jdot_v: Vector,
    X: Matrix,
    Y: Matrix,
) -> None:
    """Write what the columns of a chain move its frames by, and what a sensor sees of them.

    Of the joints, R (N, 3, 3) and o (N, 3) are rotations and origins, S (6, n) axes as motions at
    the world's origin, linear before angular, dS their rates at the velocity v (n). A column (s, w)
    is a motion at the origin and in the axes of the joint that carries it, and moves its frame at p
    by d = s + w x (p - o). A joint before it turns d; another one moves the frame by some u, which
    changes d by w x u. The first columns are the frames themselves, s away from their last joints.
    ``columns`` (9, f + p) has s, w, and what is subtracted from d; ``links`` (f + p, 2 + n) the
    joint that carries it, its frame, and whether each joint is before it.

    ``motion`` (2, k, n + 1) becomes [dphi/dq, phi] and its rate, phi (k) the d one after the other,
    a one, and for poses zeros whose rates are the angular velocities. y = N phi / z (m) with z =
    D phi. ``maps`` are N and D (m, k): ``constants``, which they contain, with a_j added at the
    ``entries`` (j, 0 for N or 1 for D, row, column). G (m, k) is (N - y D) / z but z in the column
    of the one; J = G dphi/dq and dJ/dt at constant maps, y's rate and dJ/dt v; X (m, p) the
    derivative by a, Y that of the rate.
    """

    def cross(a: Vector, b: Vector, i: int) -> float:
        """Return entry i of a x b."""
        f = (i + 1) % 3
        h = (i + 2) % 3
        return a[f] * b[h] - a[h] * b[f]

    n = len(v)
    one = 3 * len(links)
    width = maps.shape[2]
    Phi = motion[0]
    Phid = motion[1]
    turns = S[3:]
    turn_rates = dS[3:]
    w, wd, turning, lever = scratch[0], scratch[1], scratch[2], scratch[3]
    for j in range(len(links)):
        b, first, at, before = links[j, 0], 3 * links[j, 1], slice(3 * j, 3 * j + 3), links[j, 2:]
        placed = first == 3 * j
        p = Phi[first : first + 3]
        pd = Phid[first : first + 3]
        D = Phi[at]
        Dd = Phid[at]
        d = D[:, n]
        dd = Dd[:, n]
        for i in range(3):
            d[i] = o[b, i] if placed else 0.0
            w[i] = turning[i] = dd[i] = 0.0
            lever[i] = 0.0 if placed else p[i, n] - o[b, i]
            for k in range(3):
                d[i] += R[b, i, k] * columns[k, j]
                w[i] += R[b, i, k] * columns[k + 3, j]
            for t in range(b):
                turning[i] += turns[i, t] * v[t] if before[t] else 0.0
        for i in range(3):
            d[i] += cross(w, lever, i)
            wd[i] = cross(turning, w, i)
        for t in range(n):
            e, f = (turns[:, t], d) if before[t] else (w, p[:, t])
            for i in range(3):
                D[i, t] = cross(e, f, i) + (S[i, t] if placed and before[t] else 0.0)
                dd[i] += D[i, t] * v[t]
        for t in range(n):
            e, f = (turns[:, t], d) if before[t] else (w, p[:, t])
            ed, fd = (turn_rates[:, t], dd) if before[t] else (wd, pd[:, t])
            for i in range(3):
                rate = dS[i, t] if placed and before[t] else 0.0
                Dd[i, t] = cross(ed, f, i) + cross(e, fd, i) + rate
    for j in range(len(links)):
        for i in range(3):
            Phi[3 * j + i, n] -= columns[i + 6, j]
    for c in range(one + 1, width):
        j, i, Phid[c, n] = (c - one - 1) // 3, (c - one - 1) % 3, 0.0
        for t in range(n):
            Phi[c, t] = turns[i, t] if links[j, 2 + t] else 0.0
            Phid[c, t] = turn_rates[i, t] if links[j, 2 + t] else 0.0
            Phid[c, n] += Phi[c, t] * v[t]

    for k in range(len(entries)):
        j, of, i, c = entries[k, 0], entries[k, 1], entries[k, 2], entries[k, 3]
        maps[of, i, c] = constants[of, i, c] + a[j]
    for i in range(len(y)):
        N = maps[0, i]
        D = maps[1, i]
        top = depth = zd = yd[i] = Jdot_v[i] = 0.0
        for c in range(width):
            top += N[c] * Phi[c, n]
            depth += D[c] * Phi[c, n]
            zd += D[c] * Phid[c, n]
        z = max(depth, LEAST_DEPTH)
        y[i] = top / z
        for t in range(n):
            J[i, t] = Jdot[i, t] = 0.0
        for c in range(width):
            g = (N[c] - y[i] * D[c]) / z
            G[i, c] = g if c != one else z
            for t in range(n if g != 0.0 else 0):
                J[i, t] += g * Phi[c, t]
                Jdot[i, t] += g * Phid[c, t]
        for t in range(n):
            yd[i] += J[i, t] * v[t]
            Jdot_v[i] += Jdot[i, t] * v[t]
        Jdot_v[i] -= 2.0 * yd[i] * zd / z
        for j in range(len(a)):
            X[i, j] = Y[i, j] = 0.0
    for k in range(len(entries)):
        j = entries[k, 0]
        i = entries[k, 2]
        c = entries[k, 3]
        share = (1.0 if entries[k, 1] == 0 else -y[i]) / G[i, one]
        X[i, j], Y[i, j] = share * Phi[c, n], share * Phid[c, n]


@compiled()
def add_map_rates(
    rate: Vector,
    entries: IndexTable,
    motion: Matrices,
    maps: Matrices,
    G: Matrix,
    z: Vector,
    y: Vector,
    yd: Vector,
    Jdot: Matrix,
) -> None:
    """Add what the rates (p) of the parameters change of dJ/dt (m, n), and of y and z by any rate.

    It is (dN/dt - y dD/dt - dy/dt D - dz/dt G) / z dphi/dq. yd (m) is the rate of y at constant
    parameters; the others are as in ``observed_motion``.
    """
    Phi = motion[0]
    Phid = motion[1]
    n = Jdot.shape[1]
    for i in range(len(z)):
        D = maps[1, i]
        total = yd[i]
        zd = 0.0
        for c in range(len(D)):
            zd += D[c] * Phid[c, n]
        for k in range(len(entries)):
            if entries[k, 2] != i:
                continue
            change = rate[entries[k, 0]]
            c = entries[k, 3]
            if entries[k, 1] == 1:
                zd += change * Phi[c, n]
                change *= -y[i]
            change /= z[i]
            total += change * Phi[c, n]
            for t in range(n):
                Jdot[i, t] += change * Phi[c, t]
        total = total / z[i]
        zd = zd / z[i]
        for c in range(len(D)):
            less = total * D[c] + zd * G[i, c]
            for t in range(n if less != 0.0 else 0):
                Jdot[i, t] -= less * Phi[c, t]


@compiled(fills=2)
def add_joint_effects(
    values: Matrix,
    columns: IndexTable,
    shape: Matrix,
    directions: Matrix,
    v: Vector,
    a: Vector,
    g: Vector,
    one: float,
    Y_b: Matrix,
    tau_b: Vector,
    Y: Matrix,
    tau: Vector,
) -> None:
    """Write [Y_b, Y_j] (n, p) and tau_b + the joints' torque (n); Y_b and tau_b are the bodies'.

    Of each of m shafts along directions (m, n), the joints and then others, the torque is values .
    f, and f = (a, v, s, g s, |s|, one) with s = tanh(v shape_0) (1 + shape_1 exp(-|v| shape_2)). An
    entry of f is column ``columns`` (6, m) of Y_j, where that is not negative. ``one`` is that of a
    constant torque, zero for the momentum; g (n) is that of the joints alone.
    """
    n, p = Y_b.shape
    for i in range(n):
        tau[i] = tau_b[i]
        for j in range(Y.shape[1]):
            Y[i, j] = Y_b[i, j] if j < p else 0.0
    for k in range(values.shape[1]):
        u = 0.0
        w = 0.0
        load = g[k] if k < n else 0.0
        for i in range(n):
            u += directions[k, i] * v[i]
            w += directions[k, i] * a[i]
        s = math.tanh(u * shape[0, k])
        if shape[1, k] != 0.0:
            s *= 1.0 + shape[1, k] * math.exp(-abs(u) * shape[2, k])
        for i in range(n):
            if directions[k, i] == 0.0:
                continue
            for c, f in enumerate((w, u, s, load * s, abs(s), one)):
                tau[i] += directions[k, i] * values[c, k] * f
                if columns[c, k] >= 0:
                    Y[i, p + columns[c, k]] = directions[k, i] * f


@compiled(fills=2, allocates=True)
def momentum_columns(
    R: Matrices,
    o: Matrix,
    V: Matrix,
    J: Matrix,
    Jdot: Matrix,
    bodies: Indices,
    columns: Indices,
    gravity: Vector,
    Y_M: Matrix,
    Y_0: Matrix,
) -> None:
    """Write the regressors (n, 10 N) of J_i^T h and of -dJ_i^T h + weight, h the momenta of bodies.

    Of the N bodies, R (N, 3, 3) and o (N, 3) are rotations and origins, V (N, 6) velocities, linear
    before angular, in their own axes. J and Jdot (6, n) are the joints' axes as motions at the
    world's origin. Joint coordinate ``columns[k]`` moves body ``bodies[k]``; gravity (3) in world
    axes. With the row s = (l, r) in the body's axes and its velocity (v, w), s^T h = m l^T v +
    mc^T (l x w + v x r) + r^T I w; the weight is that with -gravity for v.
    """

    def turn_into(b: int, axes: Matrix, c: int, s: Vector) -> None:
        """Write column c of axes (6, n) as a motion at the origin of body b, in its axes."""
        for t in range(3):
            s[t] = s[t + 3] = 0.0
            for e in range(3):
                f = (e + 1) % 3
                h = (e + 2) % 3
                moving = axes[e, c] + axes[f + 3, c] * o[b, h] - axes[h + 3, c] * o[b, f]
                s[t] += R[b, e, t] * moving
                s[t + 3] += R[b, e, t] * axes[e + 3, c]

    def add(Y: Vector, s: Vector, v: Vector, sign: float) -> None:
        """Add sign s^T h of a body with velocity v (6) to the columns Y (10) of its parameters."""
        Y[0] += sign * (s[0] * v[0] + s[1] * v[1] + s[2] * v[2])
        j = 4
        for t in range(3):
            f = (t + 1) % 3
            h = (t + 2) % 3
            Y[1 + t] += sign * (s[f] * v[h + 3] - s[h] * v[f + 3])
            Y[1 + t] += sign * (v[f] * s[h + 3] - v[h] * s[f + 3])
            for e in range(t + 1):  # xx, xy, yy, xz, yz, zz
                Y[j] += sign * s[t + 3] * v[e + 3]
                if e != t:
                    Y[j] += sign * s[e + 3] * v[t + 3]
                j += 1

    Y_M[:], Y_0[:] = 0.0, 0.0
    s = np.empty(6)
    d = np.empty(6)
    g = np.zeros(6)
    for k in range(len(bodies)):
        b = bodies[k]
        c = columns[k]
        turn_into(b, J, c, s)
        turn_into(b, Jdot, c, d)
        for t in range(3):
            g[t] = -(R[b, 0, t] * gravity[0] + R[b, 1, t] * gravity[1] + R[b, 2, t] * gravity[2])
        own = slice(PER_BODY * b, PER_BODY * (b + 1))
        add(Y_M[c, own], s, V[b], 1.0)
        add(Y_0[c, own], s, g, 1.0)
        add(Y_0[c, own], d, V[b], -1.0)
