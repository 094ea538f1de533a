"""What the joints add to a torque and its regressor."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import compiled


@compiled("void(f8[:], i8[:], f8[:,:])")
def take_coefficients(a: np.ndarray, kinds: np.ndarray, values: np.ndarray) -> None:
    """Write a, one row a kind after the other, into the rows ``kinds`` of the values (3, n)."""
    n = values.shape[1]
    for k in range(len(kinds)):
        for i in range(n):
            values[kinds[k], i] = a[k * n + i]


@compiled("void(f8[:,:], f8[:], f8[:], f8, f8[:], f8[:])")
def joint_torque(
    values: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    threshold: float,
    inertial: np.ndarray,
    tau: np.ndarray,
) -> None:
    """Write inertial + armature a + viscous v + coulomb tanh(v / threshold) (n)."""
    for i in range(len(tau)):
        friction = values[1, i] * v[i] + values[2, i] * math.tanh(v[i] / threshold)
        tau[i] = inertial[i] + values[0, i] * a[i] + friction


@compiled("void(f8[:,:], i8[:], f8[:], f8[:], f8, f8[:,:])")
def joint_columns(
    inertial: np.ndarray,
    kinds: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    threshold: float,
    Y: np.ndarray,
) -> None:
    """Write [inertial, diag of each kind] (n, p); kinds 0, 1, 2: a, v, tanh(v / threshold)."""
    n, p = inertial.shape
    for i in range(n):
        for j in range(p):
            Y[i, j] = inertial[i, j]
        for j in range(p, Y.shape[1]):
            Y[i, j] = 0.0
        for k in range(len(kinds)):
            if kinds[k] == 0:
                x = a[i]
            elif kinds[k] == 1:
                x = v[i]
            else:
                x = math.tanh(v[i] / threshold)
            Y[i, p + k * n + i] = x
