"""Low passes and what they tell."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled(
    "b1(f8[:,:], f8[:], f8[:,:], f8[:], f8[:], f8[:], f8, f8[:], f8, f8[:,:], f8[:], f8[:])",
    fills=3,
)
def filtered_rates(
    Z_k: np.ndarray,
    memory: np.ndarray,
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

    x_0 = x_hat - X_k a_k is the known part of the position; the memory is (xi, z). W_k, X_k, Z_k
    are (m_p, p), y, x and x_hat (m_p), a and v (n). Return False, and write nothing, if Z_k
    is not (m_p, p) or the memory not (m_p + n).
    """
    m, p = X_k.shape
    if Z_k.shape[0] != m or Z_k.shape[1] != p or len(memory) != m + len(a):
        return False
    for i in range(m):
        d = x[i] - x_hat[i]
        for j in range(p):
            d += X_k[i, j] * a_k[j]
        y[i] = bandwidth * (d - memory[i])
        for j in range(p):
            W_k[i, j] = bandwidth * (X_k[i, j] - Z_k[i, j])
    for i in range(len(a)):
        a[i] = bandwidth_a * (v[i] - memory[m + i])
    return True


@compiled("void(f8[:], f8[:], f8[:], f8[:], f8[:])")
def observed(
    x_o: np.ndarray, half: np.ndarray, xd_hat: np.ndarray, x: np.ndarray, dx_o: np.ndarray
) -> None:
    """Write x_o + half xd_hat - x (m_p), half (1) of the last step [s]."""
    for i in range(len(dx_o)):
        dx_o[i] = x_o[i] + half[0] * xd_hat[i] - x[i]


@compiled("void(f8[:], f8[:], f8[:], f8[:], f8, f8, f8[:], f8[:])", fills=2)
def carry(
    x_o: np.ndarray,
    half: np.ndarray,
    xd_hat: np.ndarray,
    dx_o: np.ndarray,
    bandwidth: float,
    dt: float,
    after: np.ndarray,
    half_after: np.ndarray,
) -> None:
    """Write x_o + (half + dt / 2) xd_hat - (1 - exp(-bandwidth dt)) dx_o (m_p), and dt / 2 (1).

    The other half of this step comes with the velocity at its end.
    """
    share = -math.expm1(-bandwidth * dt)
    half_after[0] = 0.5 * dt
    for i in range(len(x_o)):
        after[i] = x_o[i] + (half[0] + 0.5 * dt) * xd_hat[i] - share * dx_o[i]


@compiled(
    "void(f8[:,:], f8[:], f8[:,:], f8[:], f8[:], f8, f8, f8, f8[:,:], f8[:])",
    fills=2,
)
def advance(
    Z_k: np.ndarray,
    memory: np.ndarray,
    W_k: np.ndarray,
    y: np.ndarray,
    v: np.ndarray,
    bandwidth: float,
    bandwidth_a: float,
    dt: float,
    Z_k_after: np.ndarray,
    memory_after: np.ndarray,
) -> None:
    """Move Z_k (m_p, p), and of the memory xi (m_p) and z (n), on for dt with their inputs held.

    Each goes the share 1 - exp(-bandwidth dt) of the way to its input, X_k, d and v; W_k and y are
    these ways times the bandwidth.
    """
    m = len(y)
    share, share_a = -math.expm1(-bandwidth * dt), -math.expm1(-bandwidth_a * dt)
    for i in range(m):
        for j in range(Z_k.shape[1]):
            Z_k_after[i, j] = Z_k[i, j] + share / bandwidth * W_k[i, j]
        memory_after[i] = memory[i] + share / bandwidth * y[i]
    for i in range(len(v)):
        k = m + i
        memory_after[k] = memory[k] + share_a * (v[i] - memory[k])
