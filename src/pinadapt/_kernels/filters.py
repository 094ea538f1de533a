"""Low passes and what they tell."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled("b1(f8[:,:], f8[:], i8, f8, f8[:], f8, f8[:], f8[:], f8[:])", fills=2)
def filtered_rates(
    W_k: np.ndarray,
    memory: np.ndarray,
    p: int,
    bandwidth: float,
    x: np.ndarray,
    bandwidth_a: float,
    v: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
) -> bool:
    """Write y = lambda x - xi (m_p), (4), and a = lambda_a (v - z) (n); memory: xi, z.

    Return False, and write nothing, if W_k is not (m_p, p) or the memory not (m_p + n).
    """
    m = len(y)
    if W_k.shape[0] != m or W_k.shape[1] != p or len(memory) != m + len(a):
        return False
    for i in range(m):
        y[i] = bandwidth * x[i] - memory[i]
    for i in range(len(a)):
        a[i] = bandwidth_a * (v[i] - memory[m + i])
    return True


@compiled("void(f8[:], f8[:], f8[:], f8[:], f8[:], f8, f8, f8[:])")
def carry(
    x_o: np.ndarray,
    xd_before: np.ndarray,
    to_come: np.ndarray,
    xd_hat: np.ndarray,
    dx_o: np.ndarray,
    bandwidth: float,
    dt: float,
    after: np.ndarray,
) -> None:
    """Write x_o + to_come (xd_hat - xd_before) + dt xd_hat - (1 - exp(-bandwidth dt)) dx_o (m_p).

    The first change is that of the last step's velocity over it, to_come (1) [s].
    """
    share = -math.expm1(-bandwidth * dt)
    for i in range(len(x_o)):
        completed = x_o[i] + to_come[0] * (xd_hat[i] - xd_before[i])
        after[i] = completed + dt * xd_hat[i] - share * dx_o[i]


@compiled(
    "void(f8[:,:], f8[:], f8[:,:], f8[:], f8[:], f8[:], f8[:], f8, f8, f8, f8[:,:], f8[:])",
    fills=2,
)
def advance(
    W_k: np.ndarray,
    memory: np.ndarray,
    Y_k: np.ndarray,
    a_k: np.ndarray,
    y: np.ndarray,
    xd_hat: np.ndarray,
    v: np.ndarray,
    bandwidth: float,
    bandwidth_a: float,
    dt: float,
    W_k_after: np.ndarray,
    memory_after: np.ndarray,
) -> None:
    """Move W_k (m_p, p), and of the memory xi (m_p) and z (n), on for dt with their inputs held.

    Each goes the share 1 - exp(-bandwidth dt) of the way to its input: the position rows Y_p of
    Y_k, lambda x + y_p0, and v. The way of xi is y + y_p0, y_p0 = J v - Y_p a_k.
    """
    m = len(y)
    share, share_a = -math.expm1(-bandwidth * dt), -math.expm1(-bandwidth_a * dt)
    for i in range(m):
        way = y[i] + xd_hat[i]
        for j in range(len(a_k)):
            W_k_after[i, j] = W_k[i, j] + share * (Y_k[i, j] - W_k[i, j])
            way -= Y_k[i, j] * a_k[j]
        memory_after[i] = memory[i] + share * way
    for i in range(len(v)):
        k = m + i
        memory_after[k] = memory[k] + share_a * (v[i] - memory[k])
