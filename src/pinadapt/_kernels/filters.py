"""Low passes and what they tell."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled(
    "b1(f8[:,:], f8[:], f8[:,:], f8[:], f8[:], f8[:,:], f8[:], f8[:], f8[:], f8, f8, "
    "f8[:,:], f8[:], f8[:], f8[:], f8[:])",
    fills=5,
)
def filtered_rates(
    W_k: np.ndarray,
    memory: np.ndarray,
    Y_before: np.ndarray,
    before: np.ndarray,
    shares: np.ndarray,
    Y_k: np.ndarray,
    y_p0: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    bandwidth: float,
    bandwidth_a: float,
    W_now: np.ndarray,
    memory_now: np.ndarray,
    now: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
) -> bool:
    """Write W_k (m_p, p), the memory (m_p + n) and its inputs now, and y (m_p), (4), and a (n).

    The inputs are lambda x + y_p0 and v; what has changed of them, and of the position rows of Y_k,
    since the sample before, goes in with its share (2). Then y = lambda x - xi and a = lambda_a (v
    - z), memory: xi, z. Return False, and write nothing, if W_k is not (m_p, p) or the memory not
    (m_p + n).
    """
    m, n, p = len(y), len(a), Y_k.shape[1]
    if W_k.shape[0] != m or W_k.shape[1] != p or len(memory) != m + n or len(y_p0) != m:
        return False
    for i in range(m):
        for j in range(p):
            W_now[i, j] = W_k[i, j] + shares[0] * (Y_k[i, j] - Y_before[i, j])
        now[i] = bandwidth * x[i] + y_p0[i]
        memory_now[i] = memory[i] + shares[0] * (now[i] - before[i])
        y[i] = bandwidth * x[i] - memory_now[i]
    for i in range(n):
        k = m + i
        now[k] = v[i]
        memory_now[k] = memory[k] + shares[1] * (v[i] - before[k])
        a[i] = bandwidth_a * (v[i] - memory_now[k])
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


@compiled("void(f8[:,:], f8[:], f8[:,:], f8[:], f8, f8, f8, f8[:,:], f8[:])", fills=2)
def advance(
    W_k: np.ndarray,
    memory: np.ndarray,
    Y_k: np.ndarray,
    inputs: np.ndarray,
    bandwidth: float,
    bandwidth_a: float,
    dt: float,
    W_k_after: np.ndarray,
    memory_after: np.ndarray,
) -> None:
    """Move W_k (m_p, p), and of the memory xi (m_p) and z (n), on for dt with their inputs held.

    Each goes the share 1 - exp(-bandwidth dt) of the way to its input, W_k to the first rows of
    Y_k.
    """
    m, p = W_k.shape
    share, share_a = -math.expm1(-bandwidth * dt), -math.expm1(-bandwidth_a * dt)
    for i in range(m):
        for j in range(p):
            W_k_after[i, j] = W_k[i, j] + share * (Y_k[i, j] - W_k[i, j])
    for i in range(len(memory)):
        part = share if i < m else share_a
        memory_after[i] = memory[i] + part * (inputs[i] - memory[i])
