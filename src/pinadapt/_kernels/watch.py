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


@compiled("b1(f8[:], f8[:], f8[:])")
def hold(torque: np.ndarray, limits: np.ndarray, held: np.ndarray) -> bool:
    """Write the torque (n) held within its limits (n); return whether it was beyond one of them.

    A torque that is not finite is not held: it is to be told of.
    """
    beyond, effort = False, 0.0
    for i in range(len(torque)):
        held[i] = min(max(torque[i], -limits[i]), limits[i])
        beyond |= abs(torque[i]) > limits[i]
        effort += torque[i] * torque[i]
    return beyond and np.isfinite(effort)
