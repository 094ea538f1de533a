"""What is watched in every step."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("f8(f8[:], f8[:], f8[:])", fills=0)
def size_of_estimates(a_d: np.ndarray, a_k: np.ndarray, torque: np.ndarray) -> float:
    """Return |a_d|^2 + |a_k|^2, or NaN where |torque|^2 is not finite."""
    size, effort = 0.0, 0.0
    for entry in a_d:
        size += entry * entry
    for entry in a_k:
        size += entry * entry
    for entry in torque:
        effort += entry * entry
    return size + 0.0 * effort
