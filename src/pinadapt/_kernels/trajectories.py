"""Desired motions, once a sample."""

from __future__ import annotations

import cmath

import numpy as np

from .._compiled import compiled


@compiled("void(f8[:], c16[:,:,:], c16[:], f8, f8[:,:])")
def harmonics(
    center: np.ndarray, parts: np.ndarray, iw: np.ndarray, t: float, x: np.ndarray
) -> None:
    """Write x (3, m): Re sum_k parts (3, m, K) exp(i w_k t), the centre (m) added to the first."""
    for j in range(len(center)):
        x[0, j], x[1, j], x[2, j] = center[j], 0.0, 0.0
    for k in range(len(iw)):
        turned = cmath.exp(iw[k] * t)
        for i in range(3):
            for j in range(len(center)):
                x[i, j] += (parts[i, j, k] * turned).real
