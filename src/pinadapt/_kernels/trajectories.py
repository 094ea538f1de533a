"""Desired motions, once a sample."""

from __future__ import annotations

import cmath

import numpy as np

from .._compiled import compiled


@compiled("void(c16[:,:,:], c16[:], f8, f8[:,:])")
def harmonics(parts: np.ndarray, iw: np.ndarray, t: float, x: np.ndarray) -> None:
    """Write x (l, m): Re sum_k parts (l, m, K) exp(i w_k t)."""
    rows, columns = x.shape
    for i in range(rows):
        for j in range(columns):
            x[i, j] = 0.0
    for k in range(len(iw)):
        turned = cmath.exp(iw[k] * t)
        for i in range(rows):
            for j in range(columns):
                x[i, j] += (parts[i, j, k] * turned).real
