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
    """Write pi (10 n) and c times the ballast (10 n) as rows, n of ten parameters; return c, zero where no body needs it."""
    lightest = pi[0]
    for b in range(len(tens)):
        lightest = min(lightest, pi[PER_BODY * b])
    c = 1.0 - lightest if lightest < _LEAST_MASS else 0.0
    for b in range(len(tens)):
        for i in range(PER_BODY):
            tens[b, i] = pi[PER_BODY * b + i] + c * ballast[PER_BODY * b + i]
    return c


@compiled("void(f8[:,:], f8[:], f8[:,:], f8[:,:])")
def velocity_regressor(R: np.ndarray, w: np.ndarray, B: np.ndarray, Y: np.ndarray) -> None:
    """Write R [w]x B into the position rows of Y (m, k), R (m_p, 3) those of a rotation, w (3) in its own axes, B (3, k)."""
    for j in range(B.shape[1]):
        x = w[1] * B[2, j] - w[2] * B[1, j]
        y = w[2] * B[0, j] - w[0] * B[2, j]
        z = w[0] * B[1, j] - w[1] * B[0, j]
        for i in range(len(R)):
            Y[i, j] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z


@compiled("void(f8[:,:], i8[:], f8[:,:])")
def take_columns(Y: np.ndarray, columns: np.ndarray, chosen: np.ndarray) -> None:
    """Write the columns (p) of Y (n, 10 n) side by side (n, p)."""
    for i in range(len(chosen)):
        for j in range(len(columns)):
            chosen[i, j] = Y[i, columns[j]]
