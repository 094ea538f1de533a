"""Columns of the momentum and of what its derivative leaves of the torque."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled(
    "void(f8[:,:,:], f8[:,:], f8[:,:], f8[:,:], f8[:,:], i8[:], i8[:], f8[:], f8[:,:], f8[:,:])",
    fills=2,
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
    s, d, g = np.empty(6), np.empty(6), np.empty(3)
    for k in range(len(bodies)):
        b, c = bodies[k], columns[k]
        for t in range(3):  # axes of the body; the linear part at its origin
            s[t] = s[t + 3] = d[t] = d[t + 3] = g[t] = 0.0
            for e in range(3):
                f, h = (e + 1) % 3, (e + 2) % 3
                s[t] += R[b, e, t] * (J[e, c] + J[f + 3, c] * o[b, h] - J[h + 3, c] * o[b, f])
                s[t + 3] += R[b, e, t] * J[e + 3, c]
                rate = Jdot[e, c] + Jdot[f + 3, c] * o[b, h] - Jdot[h + 3, c] * o[b, f]
                d[t] += R[b, e, t] * rate
                d[t + 3] += R[b, e, t] * Jdot[e + 3, c]
                g[t] -= R[b, e, t] * gravity[e]
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
