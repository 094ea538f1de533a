"""Checks in every step: plausible measurements, rest, torque limits, estimates; of a loop."""

from __future__ import annotations

import math

import numpy as np

from .._compiled import WRONG_SIZE, compiled

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
    if len(fast) != len(v):
        raise ValueError(WRONG_SIZE)
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


@compiled("void(f8[:,:], f8[:], f8[:], f8[:])")
def prediction_error(W: np.ndarray, a: np.ndarray, y: np.ndarray, residual: np.ndarray) -> None:
    """Write W a - y (n), W (n, p)."""
    if W.shape != (len(y), len(a)) or len(residual) != len(y):
        raise ValueError(WRONG_SIZE)
    for i in range(len(y)):
        x = -y[i]
        for j in range(len(a)):
            x += W[i, j] * a[j]
        residual[i] = x


@compiled("b1(f8[:], f8[:])", fills=0)
def exceeds(torque: np.ndarray, limits: np.ndarray) -> bool:
    """Return whether a finite torque (n) exceeds one of its limits (n)."""
    if len(limits) != len(torque):
        raise ValueError(WRONG_SIZE)
    beyond, effort = False, 0.0
    for i in range(len(torque)):
        beyond |= abs(torque[i]) > limits[i]
        effort += torque[i] * torque[i]
    return beyond and np.isfinite(effort)


@compiled("i8(f8[:], f8[:])", fills=0)
def first_beyond(values: np.ndarray, limits: np.ndarray) -> int:
    """Return the first i with |values_i| > limits_i, or -1; NaN is not beyond."""
    if len(limits) != len(values):
        raise ValueError(WRONG_SIZE)
    for i in range(len(values)):
        if abs(values[i]) > limits[i]:
            return i
    return -1


@compiled("i8(f8[:], f8[:], f8[:], f8[:], f8[:], f8)", fills=0)
def first_near_stop(
    q: np.ndarray,
    v: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    brake: np.ndarray,
    damping: float,
) -> int:
    """Return the first joint that moves towards a stop and cannot brake before it, or -1.

    It needs 1.5 |v| / damping or v^2 / (2 brake), whichever is longer; slower than 0.01 it rests.
    """
    n = len(v)
    if len(q) != n or len(lower) != n or len(upper) != n or len(brake) != n:
        raise ValueError(WRONG_SIZE)
    for i in range(len(v)):
        speed = abs(v[i])
        if speed <= 0.01:
            continue
        way = max(1.5 * speed / damping, speed * speed / (2.0 * brake[i]))
        if (v[i] > 0.0 and q[i] + way > upper[i]) or (v[i] < 0.0 and q[i] - way < lower[i]):
            return i
    return -1


@compiled("b1(f8[:], f8[:], f8[:], f8[:], f8, f8[:])")
def limit_torque(
    torque: np.ndarray,
    limit: np.ndarray,
    before: np.ndarray,
    rate: np.ndarray,
    dt: float,
    limited: np.ndarray,
) -> bool:
    """Write a torque within its limits, then within rate dt of the one before; tell if it changed.

    All are of n joints.
    """
    n = len(torque)
    if len(limit) != n or len(before) != n or len(rate) != n or len(limited) != n:
        raise ValueError(WRONG_SIZE)
    changed = False
    for i in range(len(torque)):
        x = min(max(torque[i], -limit[i]), limit[i])
        x = min(max(x, before[i] - rate[i] * dt), before[i] + rate[i] * dt)
        changed |= x != torque[i]
        limited[i] = x
    return changed


@compiled(
    "void(f8[:,:], f8[:,:], f8[:], f8[:], f8[:], f8[:], f8, f8, f8, f8[:,:], f8[:,:], f8[:])",
    fills=2,
)
def explain_torque(
    Y_M: np.ndarray,
    Y_0: np.ndarray,
    p_0: np.ndarray,
    tau_0: np.ndarray,
    a: np.ndarray,
    tau: np.ndarray,
    bandwidth: float,
    dt: float,
    slow: float,
    memory: np.ndarray,
    after: np.ndarray,
    residual: np.ndarray,
) -> None:
    """Write the memory (3, n) after dt [s], low pass, mean and smoothed rest, and the last (n).

    The rest is smoothed at twice the bandwidth, as its noise is white. The mean is what it is now
    if ``slow``, its bandwidth, is infinite. A memory of NaN begins at the present momentum.
    """
    n, m = len(tau), len(a)
    if Y_M.shape != (n, m) or Y_0.shape != (n, m) or len(p_0) != n or len(tau_0) != n:
        raise ValueError(WRONG_SIZE)
    if memory.shape != (3, n) or after.shape != (3, n) or len(residual) != n:
        raise ValueError(WRONG_SIZE)
    share, mean_share = -math.expm1(-bandwidth * dt), -math.expm1(-slow * dt)
    smooth = -math.expm1(-2.0 * bandwidth * dt)
    for i in range(len(tau)):
        p, beta = p_0[i], tau_0[i]
        for j in range(len(a)):
            p += Y_M[i, j] * a[j]
            beta += Y_0[i, j] * a[j]
        low = memory[0, i] if memory[0, i] == memory[0, i] else bandwidth * p
        after[0, i] = low + share * (tau[i] + bandwidth * p - beta - low)
        r = after[0, i] - bandwidth * p
        after[1, i] = r if mean_share == 1.0 else memory[1, i] + mean_share * (r - memory[1, i])
        rest = memory[2, i] if memory[2, i] == memory[2, i] else 0.0
        residual[i] = after[2, i] = rest + smooth * (r - after[1, i] - rest)


@compiled("f8(f8[:], f8[:], i8)", fills=0)
def stop_errors(dx: np.ndarray, weight: np.ndarray, positions: int) -> float:
    """Return the error dx (m) in stop errors, one over ``weight`` (m); the largest of the groups.

    The groups are the norm of the positions, the first rows, and that of the other rows, a
    rotation; or each joint by itself, where ``positions`` is negative.
    """
    if len(weight) < len(dx):
        raise ValueError(WRONG_SIZE)
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
    of joint i. See ``Governor``. The velocity of the joints for the path at full rate is the larger
    of J^+ x_d' and J^+ (x_d' + ahead ds/dt x_d''), with J^+ = J^T gram_inverse, x_d' = xd_d / rate
    and x_d'' (ds/dt)^2 = xdd_d - x_d' d^2s/dt^2. A factor f below the rate becomes f (f / rate)^2:
    the rate has f as its equilibrium, but follows with more than a lag (damping 1 / sqrt(3)).
    """
    n, m, found, least = len(q), len(xd_d), 0, 1.0
    if len(weight) < len(dx) or len(torque) != n or len(effort_limits) != n:
        raise ValueError(WRONG_SIZE)
    if len(lower) != n or len(upper) != n or len(velocity_limits) != n:
        raise ValueError(WRONG_SIZE)
    if len(xdd_d) != m or J.shape != (m, n) or gram_inverse.shape != (m, m):
        raise ValueError(WRONG_SIZE)
    if len(factor) != 1:
        raise ValueError(WRONG_SIZE)
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
        speed, now = 0.0, 0.0
        for j in range(m):
            transposed = 0.0
            for k in range(m):
                transposed += J[k, i] * gram_inverse[k, j]
            velocity = xd_d[j] / rate
            now += transposed * velocity
            speed += transposed * (velocity + lead_s * (xdd_d[j] - velocity * acceleration) / rate)
        if abs(now) > abs(speed):
            speed = now
        room = upper[i] - q[i] if speed > 0.0 else q[i] - lower[i]
        if room < lead * abs(speed):
            bound = max(room / (lead * abs(speed)), creep)
            if bound < least:
                found, least = 3 + n + i, bound
        bound = velocity_limits[i] / max(abs(speed), 1e-300)
        if bound < rate:
            bound *= (bound / rate) ** 2
        if bound < least:
            found, least = 3 + 2 * n + i, bound
    factor[0] = least
    return found


# What is kept of the first samples: numbers of the window in which the arm's gravity is judged, and
# then rows of n, one number a joint.
JUDGED, TIME, EARLIER, WEIGHT, HEALTHY, MOVED, AGE, HEARD, SUSPECT = range(9)
HEADER = 9
WAY, SAID, SAID_PATH, PATH, PEAK, AGREED, HELD, DRIVE, FORMER, LATTER, OFFSET, SPEED = range(12)
ROWS = 12
NOTHING, WINDOW, TOLD, APART = 0, 1, 2, 3
MEMORY = 0.5  # [s] over which ways are summed
LAG = 0.01  # [s] by which q and v may be late, one of the other
_SHARE = 0.5  # of the way, by which the two may differ
_SHAKEN, _SHOWN = 5.0, 10.0  # the path that v says: of that of q, and of the tolerance, at most
_TELLING = 4.0  # tolerances after which a way that agrees is believed
_LATEST = 2.0  # [s] after the first joint that agrees
_LONGEST = 60.0  # [s]
_STILL = 0.02  # of tol_0, a change of way in half a window that need not be judged
_ROUND = 1e-9  # [s]


@compiled("i8(f8[:], f8[:], f8[:], f8, f8[:,:], i8[:], f8, f8, f8[:], f8[:])")
def first_samples(
    q: np.ndarray,
    q_before: np.ndarray,
    v: np.ndarray,
    dt: float,
    bounds: np.ndarray,
    places: np.ndarray,
    longest: float,
    half: float,
    before: np.ndarray,
    after: np.ndarray,
) -> int:
    """Compare v with the rate of q, joint by joint, and add the sample to the sums.

    The answer is 3 + i if the v of joint i is not the rate of its q; else 1 if a window is over in
    which the arm's speed has changed, 2 if nothing is left to check, and 0 if neither. ``after``
    becomes ``before`` with the sample added. For each joint, with sums that forget over 0.5 s,

        D = sum dq,   W = sum v dt,   P = sum |dq|,   P_v = sum |v dt| of what a count shows.

    A v that is the rate of q, both late by up to L = 10 ms, and up to a half too large or small,
    has |W - D| <= max(|W|, |D|) / 2 + tol, with tol = tol_0 + L min(|v|, v_max), and
    P_v <= 5 P + 10 tol.

    Args:
        q: (nq) configuration, of a continuous joint cosine and sine.
        q_before: (nq) at the sample before.
        v: (n) joint velocity [rad/s or m/s].
        dt: time since that sample [s]; nothing is learned from none, or from a long one.
        bounds: (3, n) tol_0 [rad or m], v_max [rad/s or m/s], and the smallest way that an encoder
            shows [rad or m].
        places: (n + 1) where each joint begins in q, and the end.
        longest: time [s] from which on a sample does not follow the one before.
        half: of the window [s].
        before: what the samples before have told.
        after: the same with this one.
    """
    n = len(v)
    if len(places) != n + 1 or len(q) != places[n] or len(q_before) != len(q):
        raise ValueError(WRONG_SIZE)
    if bounds.shape != (3, n) or len(before) != HEADER + ROWS * n:
        raise ValueError(WRONG_SIZE)
    if len(after) != len(before):
        raise ValueError(WRONG_SIZE)
    for k in range(len(before)):
        after[k] = before[k]
    if not dt > 0.0:
        return NOTHING
    if dt > longest:
        for k in range(len(after)):
            row = (k - HEADER) // n
            if TIME <= k <= WEIGHT or (k >= HEADER and row != AGREED):
                after[k] = 0.0
        for i in range(n):
            after[HEADER + SPEED * n + i] = v[i]
            after[HEADER + HELD * n + i] = np.nan
        return NOTHING
    after[AGE] += dt
    keep = np.exp(-dt / MEMORY)
    apart, agreed, some = -1, True, False
    for i in range(n):
        first = places[i]
        if places[i + 1] - first == 1:
            way = q[first] - q_before[first]
        else:
            way = np.arctan2(
                q[first + 1] * q_before[first] - q[first] * q_before[first + 1],
                q[first] * q_before[first] + q[first + 1] * q_before[first + 1],
            )
        at = HEADER + i
        said = 0.5 * dt * (v[i] + before[at + SPEED * n])  # exact for a torque that is held
        after[at + SPEED * n] = v[i]
        after[at + WAY * n] = D = keep * before[at + WAY * n] + way
        after[at + SAID * n] = W = keep * before[at + SAID * n] + said
        shown = abs(said) if abs(said) > bounds[2, i] else 0.0
        after[at + SAID_PATH * n] = P_v = keep * before[at + SAID_PATH * n] + shown
        after[at + PATH * n] = P = keep * before[at + PATH * n] + abs(way)
        after[at + PEAK * n] = peak = max(keep * before[at + PEAK * n], abs(v[i]))
        if before[at + AGREED * n] == 0.0:
            tolerance = bounds[0, i] + LAG * min(peak, bounds[1, i])
            most = max(abs(W), abs(D))
            if abs(W - D) > _SHARE * most + tolerance or P_v > _SHAKEN * P + _SHOWN * tolerance:
                apart = i if apart < 0 else apart
            elif most > _TELLING * tolerance:
                after[at + AGREED * n] = 1.0
        told = after[at + AGREED * n] != 0.0
        agreed &= told
        some |= told
    if apart >= 0:
        return APART + apart
    if some:
        after[MOVED] += dt
    if after[MOVED] > _LATEST:
        after[JUDGED] = 0.0
        for i in range(n):
            after[HEADER + AGREED * n + i] = 1.0
        agreed = True
    if after[AGE] > _LONGEST or (agreed and after[JUDGED] == 0.0):
        return TOLD
    if after[JUDGED] == 0.0 or np.isnan(after[HEADER + HELD * n]):
        return NOTHING
    if before[TIME] > 2.0 * half - _ROUND:  # the next window
        after[TIME] = after[EARLIER] = after[WEIGHT] = 0.0
        for k in range(HEADER + DRIVE * n, HEADER + SPEED * n):
            after[k] = 0.0
    time = after[TIME] + 0.5 * dt
    weight = dt * max(min(time, 2.0 * half - time), 0.0)
    earlier = after[TIME] < half - _ROUND
    row = FORMER if earlier else LATTER
    for i in range(n):
        after[HEADER + DRIVE * n + i] += weight * after[HEADER + HELD * n + i]
        after[HEADER + row * n + i] += dt * v[i]
    after[TIME] += dt
    after[EARLIER] += dt if earlier else 0.0
    after[WEIGHT] += weight
    if after[TIME] < 2.0 * half - _ROUND:
        return NOTHING
    moved = after[HEARD] + after[SUSPECT] > 0.0
    for i in range(n):
        latter, former = after[HEADER + LATTER * n + i], after[HEADER + FORMER * n + i]
        change = latter / (after[TIME] - after[EARLIER]) - former / after[EARLIER]
        moved |= abs(change) * half > _STILL * bounds[0, i]
    return WINDOW if moved else NOTHING
