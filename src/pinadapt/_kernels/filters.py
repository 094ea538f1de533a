"""Low passes and what they tell."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("void(f8, f8[:], f8[:], f8, f8[:], f8[:], f8[:], f8[:])", fills=2)
def filtered_rates(
    bandwidth: float,
    x: np.ndarray,
    xi: np.ndarray,
    bandwidth_a: float,
    v: np.ndarray,
    z: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
) -> None:
    """Write y = lambda x - xi (m_p), (4), and a = lambda_a (v - z) (n)."""
    for i in range(len(y)):
        y[i] = bandwidth * x[i] - xi[i]
    for i in range(len(a)):
        a[i] = bandwidth_a * (v[i] - z[i])


@compiled(
    "void(f8[:,:], f8[:,:], f8[:], f8[:], f8[:], f8[:], f8, f8[:], f8[:], f8, f8[:,:], f8[:], f8[:])",
    fills=3,
)
def advance(
    W_k: np.ndarray,
    Y_p: np.ndarray,
    a_k: np.ndarray,
    xi: np.ndarray,
    y: np.ndarray,
    xd_hat: np.ndarray,
    f_k: float,
    z: np.ndarray,
    v: np.ndarray,
    f_a: float,
    W_k_after: np.ndarray,
    xi_after: np.ndarray,
    z_after: np.ndarray,
) -> None:
    """Move each state the fraction f of its way to its input.

    The way of xi is y + y_p0, y_p0 = J v - Y_p a_k.
    """
    for i in range(len(xi)):
        way = y[i] + xd_hat[i]
        for j in range(len(a_k)):
            W_k_after[i, j] = W_k[i, j] + f_k * (Y_p[i, j] - W_k[i, j])
            way -= Y_p[i, j] * a_k[j]
        xi_after[i] = xi[i] + f_k * way
    for i in range(len(z)):
        z_after[i] = z[i] + f_a * (v[i] - z[i])
