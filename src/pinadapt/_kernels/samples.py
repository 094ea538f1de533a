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


@compiled("f8(f8[:], f8[:], i8)", fills=0)
def stop_errors(dx: np.ndarray, weight: np.ndarray, positions: int) -> float:
    """Return the error dx (m) in stop errors, one over ``weight`` (m); the largest of the groups.

    The groups are the norm of the positions, the first rows, and that of the other rows, a
    rotation; or each joint by itself, where ``positions`` is negative.
    """
    place, turn, joint = 0.0, 0.0, 0.0
    for i in range(len(dx)):
        share = abs(dx[i] * weight[i])
        if positions < 0:
            joint = max(joint, share)
        elif i < positions:
            place += share * share
        else:
            turn += share * share
    return max(joint, np.sqrt(max(place, turn)))


@compiled(
    "i8(f8[:], f8[:], i8, f8, f8, f8, f8, f8[:], f8[:], f8, f8[:], f8[:], f8[:], f8, f8[:], f8[:],"
    " f8[:,:], f8[:,:], f8[:], f8, f8, f8, f8[:])"
)
def path_rate(
    dx: np.ndarray,
    weight: np.ndarray,
    positions: int,
    slow: float,
    hold: float,
    creep: float,
    late: float,
    torque: np.ndarray,
    effort_limits: np.ndarray,
    effort: float,
    q: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    lead: float,
    xd_d: np.ndarray,
    xdd_d: np.ndarray,
    J: np.ndarray,
    gram_inverse: np.ndarray,
    velocity_limits: np.ndarray,
    rate: float,
    acceleration: float,
    ahead: float,
    factor: np.ndarray,
) -> int:
    """Fill factor (1) with the smallest of the governor's factors and return which one it is.

    0: none is below 1; 1: error; 2: frames; 3 + i, 3 + n + i, 3 + 2 n + i: effort, stop and speed
    of joint i. See ``Governor``. The velocity of the joints for the path at full rate is J^+ (x_d'
    + ahead ds/dt x_d''), with J^+ = J^T gram_inverse, x_d' = xd_d / rate and x_d'' (ds/dt)^2 =
    xdd_d - x_d' d^2s/dt^2.
    """
    n, m, found, least = len(q), len(xd_d), 0, 1.0
    place, turn, joint = 0.0, 0.0, 0.0
    for i in range(len(dx)):
        share = abs(dx[i] * weight[i])
        if positions < 0:
            joint = max(joint, share)
        elif i < positions:
            place += share * share
        else:
            turn += share * share
    e = max(joint, np.sqrt(max(place, turn)))
    # 1 up to slow, creep from 1 to hold - 1, 0 from hold on
    bound = max(creep, 1.0 - (1.0 - creep) * (e - slow) / (1.0 - slow))
    bound = min(bound, creep * (hold - e))
    if e > slow and bound < least:
        found, least = 1, max(bound, 0.0)
    if late > 0.0 and 1.0 - late < least:
        found, least = 2, max(1.0 - late, 0.0)
    moving = rate >= 1e-6
    lead_s = ahead if rate >= 1e-2 else 0.0
    for i in range(n):
        share = abs(torque[i]) / effort_limits[i]
        bound = max((1.0 - share) / (1.0 - effort), 0.0)
        if share > effort and bound < least:
            found, least = 3 + i, bound
        if not moving:
            continue
        speed = 0.0
        for j in range(m):
            transposed = 0.0
            for k in range(m):
                transposed += J[k, i] * gram_inverse[k, j]
            velocity = xd_d[j] / rate
            speed += transposed * (velocity + lead_s * (xdd_d[j] - velocity * acceleration) / rate)
        room = upper[i] - q[i] if speed > 0.0 else q[i] - lower[i]
        if room < lead * abs(speed):
            bound = max(room / (lead * abs(speed)), creep)
            if bound < least:
                found, least = 3 + n + i, bound
        if abs(speed) > velocity_limits[i] and velocity_limits[i] / abs(speed) < least:
            found, least = 3 + 2 * n + i, velocity_limits[i] / abs(speed)
    factor[0] = least
    return found
