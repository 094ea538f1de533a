"""Checks in every step: plausible measurements, rest, torque limits, estimates; of a loop."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled

FOLLOWS, JUMP, SPIKE, STOPPED, APART, OUT = range(6)  # what is wrong with a joint

# Rows of bounds, one number a joint, and numbers of all joints together; see ``Guards``.
FASTEST, TOLERANCE, LEAP, LOWEST, HIGHEST, CLEAR = range(6)
SLOW, FARTHEST, LONGEST, FLOOR, UNKNOWN, RECENTLY = range(6)

# The trail: what is kept of the samples to compare the next one with. Numbers of all joints, the
# last frame's error (3) and position (3), and then some of each joint.
STEPPED, BAD, BRIDGED, LOST, FRAMES, STALE, REPEATED, DEAF, TORQUES, STEP, SEEN = range(11)
SINCE, RECENT, ERROR, PLACE, DOUBT, TRAIL = 11, 12, 13, 16, 19, 20
RATE, RAW, LEAST, RESIDUAL, WAY, CHANGE, STILL_Q, STILL_V, DISTRUST, UNSEEN = range(10)
DISPLACED, TORQUE, AGAINST, GAINED, PUSHED, SAME, TRAIL_ROWS = range(10, 17)
MEMORY = 0.2  # [s] of the leaky sums; half: v off by 0.02 rad/s passes twice; double: found later
LATE, EARLY = 0.1, 0.01  # [s] by which v may come after q, and q after v; half: filters of 80 ms
# are refused, double: a wrong v is found 0.1 s later where it changes
_SHARE = 0.25  # of the way, by which v may be off for good; half: 20 % is refused
_REPEATED = 0.02  # [s] for which a v may be the same while q goes on, as one of 50 Hz; half: that
# is refused, double: a stuck v is found as much later
_TIGHT = 0.5  # of the tolerance, which a v that is the same to the bit has less; half: a stuck one
# is found 20 ms later, double: one in steps is refused
_CIRCLE = 0.02  # of cosine^2 + sine^2: half or double change nothing, rounding is below 1e-6
_COARSE = 10.0  # [1/s] times the tolerance: largest step of a v that is taken for its resolution
_COUNTS = 3.0  # least changes of q, by which a joint clearly moves from sample to sample


@compiled(
    "i8(f8[:], f8[:], f8[:], f8, f8[:,::1], i8[::1], f8[::1], f8[:], f8[::1], i8[::1])", fills=2
)
def check_joints(
    q: np.ndarray,
    q_before: np.ndarray,
    v: np.ndarray,
    dt: float,
    bounds: np.ndarray,
    places: np.ndarray,
    numbers: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    kinds: np.ndarray,
) -> int:
    """Write what is wrong with each joint (n) of a sample; return 2 if something may be, 1 at rest.

    ``after`` becomes ``before`` with the sample added; where it is empty, the sample is compared
    with none before. NaN is never wrong. With the residual r = dq - v dt (trapezoid) and sums that
    forget over T, R = sum r, D = sum dq, W = D - R, C = sum dv,

    * JUMP: |r| > tol + 2 dt min(|v|, the bound of v): q is not where v brings it.
    * SPIKE: v changed by more than a bound, and q went on as before, not by the mean of both v;
      or |v| is beyond all bounds.
    * STOPPED: q is the same to the bit and v has become zero at once, but not that of all joints.
    * APART: v is not the rate of q. A v that is late by s leaves R = s C, so R is taken relative to
      the nearest of these between -10 and 100 ms: beyond tol + share max(|D|, |W|) + T (least
      change of any v, its resolution). There is no share of a v that is the same to the
      bit, half of tol for r since then, and for 20 ms it is not judged.
    * OUT: cosine^2 + sine^2 is not 1; or q is outside its range, and no sample before it is known.

    Args:
        q: (nq) configuration, of a continuous joint cosine and sine.
        q_before: (nq) at the sample before.
        v: (n) joint velocity [rad/s or m/s].
        dt: since the sample before [s]; that one is forgotten where it is long ago.
        bounds: (6, n), see ``Guards``.
        places: (n + 1) where each joint begins in q, and the end.
        numbers: (6), see ``Guards``.
        before: the trail, or empty.
        after: the trail with this sample.
        kinds: (n) what is wrong.
    """
    n, kept, leak, recent = len(v), len(after) > 0, 1.0, 1.0
    follows = kept and 0.0 <= dt <= numbers[LONGEST]
    for k in range(len(after)):
        after[k] = before[k]
    if kept and not follows:
        after[SEEN] = after[SINCE] = after[RECENT] = 0.0
        for k in range(TRAIL, len(after)):
            if (k - TRAIL) % TRAIL_ROWS != LEAST:
                after[k] = 0.0
    halted = follows and dt > 0.0  # all joints stopped at once: by brakes, or in a simulation
    for i in range(n):
        halted = halted and v[i] == 0.0 and q[places[i]] == before[TRAIL + TRAIL_ROWS * i + RAW]
    if follows:
        leak, recent = np.exp(-dt / MEMORY), np.exp(-dt / numbers[RECENTLY])
        if dt > 0.0:
            after[STALE] = 0.0
        elif before[STEPPED] != 0.0:
            after[STALE] += 1.0
            after[REPEATED] += 1.0
        for i in range(n):
            change = abs(v[i] - before[TRAIL + TRAIL_ROWS * i + RATE])
            if change > 0.0 and not 0.0 < after[STEP] < change:
                after[STEP] = change
    resting, wrong, turned = True, False, 0.0
    for i in range(n):
        now, first, at = v[i], places[i], TRAIL + TRAIL_ROWS * i
        speed, plain = abs(now), places[i + 1] - first == 1
        resting &= speed < numbers[SLOW]
        kinds[i] = SPIKE if speed > bounds[FASTEST, i] else FOLLOWS
        if kept:
            after[at + RATE], after[at + RAW] = now, q[first]
        off = 0.0 if plain else abs(q[first] ** 2 + q[first + 1] ** 2 - 1.0)
        if not follows:
            outside = plain and (q[first] < bounds[LOWEST, i] or q[first] > bounds[HIGHEST, i])
            if off > _CIRCLE or (kept and outside):
                kinds[i] = OUT
            wrong |= kinds[i] != FOLLOWS
            continue
        if plain:
            way = q[first] - q_before[first]
        else:
            way = np.arctan2(
                q[first + 1] * q_before[first] - q[first] * q_before[first + 1],
                q[first] * q_before[first] + q[first + 1] * q_before[first + 1],
            )
        rate, least, tolerance = before[at + RATE], before[at + LEAST], bounds[TOLERANCE, i]
        r = way - 0.5 * dt * (now + rate)  # exact for a torque that is held
        same, quick = q[first] == before[at + RAW], max(speed, abs(rate))
        step = abs(way)
        turned += step
        after[at + LEAST] = step if step > 0.0 and not 0.0 < least < step else least
        R, D = leak * before[at + RESIDUAL] + r, leak * before[at + WAY] + way
        C = leak * before[at + CHANGE] + now - rate
        after[at + RESIDUAL], after[at + WAY], after[at + CHANGE] = R, D, C
        after[at + STILL_Q] = before[at + STILL_Q] + dt if same else 0.0
        after[at + STILL_V] = before[at + STILL_V] + dt if now == rate else 0.0
        after[at + DISTRUST] = after[at + UNSEEN] = after[at + DISPLACED] = 0.0
        low, high = min(-EARLY * C, LATE * C), max(-EARLY * C, LATE * C)
        off_R = R - min(max(R, low), high)
        still, bound = after[at + STILL_V], tolerance
        if still == 0.0:
            bound += _SHARE * max(abs(D), abs(D - R))
        bound += MEMORY * min(after[STEP], _COARSE * tolerance)
        leap = abs(now - rate) > bounds[LEAP, i]
        if leap and abs(way - rate * dt) < abs(r):
            kinds[i] = SPIKE
        elif abs(r) > tolerance + 2.0 * dt * min(quick, bounds[FASTEST, i]):
            kinds[i] = JUMP
        elif kinds[i] == FOLLOWS and same and now == 0.0 and not halted:
            clear = abs(rate) > bounds[CLEAR, i] and abs(rate) * dt > _COUNTS * least > 0.0
            kinds[i] = STOPPED if clear else FOLLOWS
        S = leak * before[at + SAME] + r if now == rate else 0.0
        after[at + SAME] = S
        told = still == 0.0 or still > _REPEATED  # else v may come less often than q
        tight = bound - (0.0 if now == 0.0 else _TIGHT * tolerance)  # zero: a dead band
        if kinds[i] == FOLLOWS and told and (abs(off_R) > bound or abs(S) > tight):
            kinds[i] = APART
        if off > _CIRCLE:
            kinds[i] = OUT
        wrong |= kinds[i] != FOLLOWS
    if kept:
        after[STEPPED], after[BAD] = 1.0, before[BAD] if wrong else 0.0
        after[LOST] += dt if after[LOST] > 0.0 else 0.0
        after[SINCE] += turned
        after[RECENT] = recent * before[RECENT] + turned
    doubted = kept and after[DOUBT] != 0.0
    return 2 if wrong or doubted else 1 if resting else 0


@compiled("b1(f8[:], f8[:], f8[::1], f8[::1])", fills=1)
def check_frame(x: np.ndarray, p_hat: np.ndarray, numbers: np.ndarray, trail: np.ndarray) -> bool:
    """Return whether a frame x cannot be one of the arm; else keep it in the trail.

    The residual is the change of e = p_hat - x since the last frame. Learning explains |e|, and
    unknown translations ``unknown`` times the turns of all joints since then and shortly before.
    A frame that is the same to the bit while the joints move explains nothing.
    """
    m, error, change, far = len(p_hat), 0.0, 0.0, 0.0
    for k in range(m):
        far += (p_hat[k] - x[k]) ** 2
    if far > numbers[FARTHEST] ** 2:
        return True
    if len(trail) == 0:
        return False
    same, moved = trail[SEEN] != 0.0, trail[SINCE] * numbers[UNKNOWN]
    for k in range(m):
        same &= x[k] == trail[PLACE + k]
        change += (p_hat[k] - x[k] - trail[ERROR + k]) ** 2
        error += trail[ERROR + k] ** 2
    if same:
        return moved > numbers[FLOOR] and change > numbers[FLOOR] ** 2
    bound = numbers[FLOOR] + numbers[UNKNOWN] * (trail[SINCE] + trail[RECENT]) + np.sqrt(error)
    if trail[SEEN] != 0.0 and change > bound**2:
        return True
    trail[SEEN], trail[LOST], trail[SINCE] = 1.0, 0.0, 0.0
    for k in range(m):
        trail[PLACE + k], trail[ERROR + k] = x[k], p_hat[k] - x[k]
    return False


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
