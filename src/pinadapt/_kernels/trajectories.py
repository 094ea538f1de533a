"""Desired motions, once a sample."""

from __future__ import annotations

from math import cos, sin

from .._compiled import Matrices, Matrix, Vector, compiled


@compiled()
def harmonics(parts: Matrices, w: Vector, t: float, x: Matrix) -> None:
    """Write x (l, m): Re sum_k c_k exp(i w_k t); parts (l, m, 2 K) are Re c_k, Im c_k in turn."""
    rows, columns = x.shape
    for i in range(rows):
        for j in range(columns):
            x[i, j] = 0.0
    for k in range(len(w)):
        c, s = cos(w[k] * t), sin(w[k] * t)
        for i in range(rows):
            for j in range(columns):
                x[i, j] += c * parts[i, j, 2 * k] - s * parts[i, j, 2 * k + 1]
