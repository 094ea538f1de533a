"""Columns of regressors and parameters of bodies."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled

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
    for i in range(3):
        x = offset[i]
        for j in range(directions.shape[1]):
            x += directions[i, j] * theta[first + j]
        translation[i] = x


@compiled(
    "void(f8[:,:], f8[:], f8[:,:,:], f8[:,:], i8[:], f8[:,:], f8[:], f8[:,:])",
    fills=2,
)
def task_velocity(
    J: np.ndarray,
    v: np.ndarray,
    R: np.ndarray,
    w: np.ndarray,
    parent: np.ndarray,
    directions: np.ndarray,
    xd_hat: np.ndarray,
    Y_k: np.ndarray,
) -> None:
    """Write J v (m), and column by column of Y_k (m, p) R [w]x b in the position rows, else zero.

    R (N, m_p, 3) are the position rows of the joints' rotations, w (N, 3) their velocities in their
    own axes; of each parameter ``parent`` (p) is the joint and b, a column of ``directions``
    (3, p), the direction there.
    """
    m, n = J.shape
    for i in range(m):
        x = 0.0
        for t in range(n):
            x += J[i, t] * v[t]
        xd_hat[i] = x
    for j in range(len(parent)):
        k = parent[j]
        x = w[k, 1] * directions[2, j] - w[k, 2] * directions[1, j]
        y = w[k, 2] * directions[0, j] - w[k, 0] * directions[2, j]
        z = w[k, 0] * directions[1, j] - w[k, 1] * directions[0, j]
        for i in range(m):
            Y_k[i, j] = 0.0
        for i in range(R.shape[1]):
            Y_k[i, j] = R[k, i, 0] * x + R[k, i, 1] * y + R[k, i, 2] * z


@compiled("void(f8[:], f8[:], f8[:], f8[:])", fills=2)
def polarise(v: np.ndarray, v_r: np.ndarray, mean: np.ndarray, half: np.ndarray) -> None:
    """Write (v + v_r) / 2 and (v - v_r) / 2 (n)."""
    for t in range(len(mean)):
        mean[t] = 0.5 * (v[t] + v_r[t])
        half[t] = 0.5 * (v[t] - v_r[t])


@compiled("void(f8[:,:], i8[:], f8[:,:])")
def take_columns(Y: np.ndarray, columns: np.ndarray, chosen: np.ndarray) -> None:
    """Write the columns (p) of Y (n, 10 n) side by side (n, p)."""
    for i in range(len(chosen)):
        for j in range(len(columns)):
            chosen[i, j] = Y[i, columns[j]]


@compiled("f8(f8[:], f8[:], f8[:,:])")
def write_inertias(pi: np.ndarray, ballast: np.ndarray, memory: np.ndarray) -> float:
    """Write pi (10 n) and c times the ballast (10 n) as pin.Inertia keeps them (n, 10); return c.

    mass m, c = mc / m, and the inertia about it, I_O - m (c^T c 1 - c c^T), as xx xy yy xz yz zz.
    """
    bodies = len(memory)
    lightest = pi[0]
    for b in range(bodies):
        lightest = min(lightest, pi[PER_BODY * b])
    c = 1.0 - 2.0 * lightest if lightest < _LEAST_MASS else 0.0
    ten = np.empty(PER_BODY)
    for b in range(bodies):
        for i in range(PER_BODY):
            ten[i] = pi[PER_BODY * b + i] + c * ballast[PER_BODY * b + i]
        m = ten[0]
        x, y, z = ten[1] / m, ten[2] / m, ten[3] / m
        memory[b, 0], memory[b, 1], memory[b, 2], memory[b, 3] = m, x, y, z
        memory[b, 4] = ten[4] - m * (y * y + z * z)
        memory[b, 5] = ten[5] + m * x * y
        memory[b, 6] = ten[6] - m * (x * x + z * z)
        memory[b, 7] = ten[7] + m * x * z
        memory[b, 8] = ten[8] + m * y * z
        memory[b, 9] = ten[9] - m * (x * x + y * y)
    return c


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


@compiled("void(f8[:,:,:], i8[:], f8[:,:], f8[:,:])")
def rotated_directions(
    R: np.ndarray, parent: np.ndarray, directions: np.ndarray, columns: np.ndarray
) -> None:
    """Write R b (m_p, p), parameter by parameter.

    R (N, m_p, 3) are the position rows of the joints' rotations; of each parameter ``parent`` (p)
    is the joint and b, a column of ``directions`` (3, p), the direction there.
    """
    for j in range(len(parent)):
        k = parent[j]
        for i in range(len(columns)):
            x = 0.0
            for t in range(3):
                x += R[k, i, t] * directions[t, j]
            columns[i, j] = x
