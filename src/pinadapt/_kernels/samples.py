"""Checks in every step: plausible measurements, rest, torque limits, estimates."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled

MOVES, STILL, FAR, FAST = 0, 1, 2, 3


@compiled("i8(f8[:], f8[:], f8, f8[:], f8[:], f8)", fills=0)
def check_sample(
    v: np.ndarray,
    fast: np.ndarray,
    slow: float,
    x: np.ndarray,
    place: np.ndarray,
    far: float,
) -> int:
    """Return 3 + i for the first |v_i| > fast_i, 2 for |x - place| > far, 1 for a slow arm, else 0.

    Slow is |v_i| < slow in all joints. NaN is neither fast nor far. place (m_p) may be shorter than
    x, and x be empty.
    """
    resting = True
    for i in range(len(v)):
        speed = abs(v[i])
        if speed > fast[i]:
            return 3 + i
        resting &= speed < slow
    square = 0.0
    for i in range(min(len(x), len(place))):
        square += (x[i] - place[i]) ** 2
    if square > far * far:
        return 2
    return 1 if resting else 0


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


@compiled("b1(f8[:], f8[:])", fills=0)
def exceeds(torque: np.ndarray, limits: np.ndarray) -> bool:
    """Return whether a finite torque (n) exceeds one of its limits (n)."""
    beyond, effort = False, 0.0
    for i in range(len(torque)):
        beyond |= abs(torque[i]) > limits[i]
        effort += torque[i] * torque[i]
    return beyond and np.isfinite(effort)
