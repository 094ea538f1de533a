"""What is watched in every step."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("UniTuple(f8, 2)(f8[:], f8[:], f8[:])", fills=0)
def squares(a_d: np.ndarray, a_k: np.ndarray, torque: np.ndarray) -> tuple[float, float]:
    """Return |a_d|^2 + |a_k|^2 and |torque|^2."""
    size, effort = 0.0, 0.0
    for entry in a_d:
        size += entry * entry
    for entry in a_k:
        size += entry * entry
    for entry in torque:
        effort += entry * entry
    return size, effort
