"""Low passes and what they tell."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled(
    "b1(f8[:], f8[:,:], f8[:], f8[:], f8[:], f8, f8[:], f8, f8[:,:], f8[:], f8[:])",
    fills=3,
)
def filtered_rates(
    low: np.ndarray,
    X_k: np.ndarray,
    x_hat: np.ndarray,
    a_k: np.ndarray,
    x: np.ndarray,
    bandwidth: float,
    v: np.ndarray,
    bandwidth_a: float,
    W_k: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
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


@compiled("void(f8[:], f8[:], f8[:], f8[:])")
def observed(memory: np.ndarray, xd_hat: np.ndarray, x: np.ndarray, dx_o: np.ndarray) -> None:
    """Write x_o + half xd_hat - x (m_p); the memory is (x_o, half), half of the last step [s]."""
    for i in range(len(dx_o)):
        dx_o[i] = memory[i] + memory[len(dx_o)] * xd_hat[i] - x[i]


@compiled("void(f8[:], f8[:], f8[:], f8, f8, f8[:])")
def carry(
    memory: np.ndarray,
    xd_hat: np.ndarray,
    dx_o: np.ndarray,
    bandwidth: float,
    dt: float,
    after: np.ndarray,
) -> None:
    """Move (x_o, half) on: x_o + (half + dt / 2) xd_hat - (1 - exp(-bandwidth dt)) dx_o, dt / 2.

    The other half of this step comes with the velocity at its end.
    """
    m, share = len(dx_o), -math.expm1(-bandwidth * dt)
    for i in range(m):
        after[i] = memory[i] + (memory[m] + 0.5 * dt) * xd_hat[i] - share * dx_o[i]
    after[m] = 0.5 * dt


@compiled("void(f8[:], f8[:,:], f8[:], f8[:], f8, f8, f8, f8[:])")
def advance(
    low: np.ndarray,
    W_k: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
    bandwidth: float,
    bandwidth_a: float,
    dt: float,
    after: np.ndarray,
) -> None:
    """Move low, (Z_k, xi, z) as in ``filtered_rates``, on for dt with its inputs held.

    Each goes the share 1 - exp(-bandwidth dt) of the way to its input, X_k, d and v; W_k (m_p, p),
    y (m_p) and a (n) are these ways times the bandwidth.
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
