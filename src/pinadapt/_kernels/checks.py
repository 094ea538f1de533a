"""Checks in every step: plausible measurements, rest, torque limits, estimates."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled

MOVES, STILL, FAR, FAST = 0, 1, 2, 3


@compiled("i8(f8[:], f8[:], f8, f8[:], f8[:], f8, f8[:], f8[:])", fills=0)
def look(
    v: np.ndarray,
    fast: np.ndarray,
    slow: float,
    x: np.ndarray,
    place: np.ndarray,
    far: float,
    xd_d: np.ndarray,
    xdd_d: np.ndarray,
) -> int:
    """Return 3 + i for the first |v_i| > fast_i, 2 for |x - place| > far, 1 for an arm that rests.

    It rests where |v| < slow in all joints and nothing is asked to move; else 0. NaN is neither
    fast nor far. place (m_p) may be shorter than x, and x be empty.
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
    for i in range(len(xd_d)):
        resting &= xd_d[i] == 0.0 and xdd_d[i] == 0.0
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
