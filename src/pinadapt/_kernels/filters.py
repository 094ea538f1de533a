"""Low passes and what they tell."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("void(f8, f8[:], f8, f8[:], f8[:], f8[:], f8[:])", fills=2)
def filtered_rates(
    bandwidth: float,
    x: np.ndarray,
    bandwidth_a: float,
    v: np.ndarray,
    memory: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
) -> None:
    """Write y = lambda x - xi (m_p), (4), and a = lambda_a (v - z) (n); memory: W_k, xi, z."""
    at = len(memory) - len(a)
    for i in range(len(a)):
        a[i] = bandwidth_a * (v[i] - memory[at + i])
    at -= len(y)
    for i in range(len(y)):
        y[i] = bandwidth * x[i] - memory[at + i]


@compiled("void(f8[:], f8[:,:], f8[:], f8[:], f8[:], f8[:], f8, f8, f8[:])")
def advance(
    memory: np.ndarray,
    Y_k: np.ndarray,
    a_k: np.ndarray,
    y: np.ndarray,
    xd_hat: np.ndarray,
    v: np.ndarray,
    f_k: float,
    f_a: float,
    after: np.ndarray,
) -> None:
    """Move W_k (m_p, p), xi (m_p) and z (n), one after another, the shares f to their inputs.

    The inputs are the position rows Y_p of Y_k, lambda x + y_p0 and v; the way of xi is y + y_p0,
    y_p0 = J v - Y_p a_k.
    """
    m, p = len(y), len(a_k)
    for i in range(m):
        way = y[i] + xd_hat[i]
        for j in range(p):
            k = i * p + j
            after[k] = memory[k] + f_k * (Y_k[i, j] - memory[k])
            way -= Y_k[i, j] * a_k[j]
        k = m * p + i
        after[k] = memory[k] + f_k * way
    for i in range(len(v)):
        k = m * p + m + i
        after[k] = memory[k] + f_a * (v[i] - memory[k])
