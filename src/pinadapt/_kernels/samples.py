"""Checks in every step: plausible measurements, rest, torque limits, estimates; of a loop."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled
from ..exceptions import ArrayError

MOVES, STILL, FAR, FRAME, TURNED, FROZEN = range(6)
JOINTS, KINDS = 8, 8  # from where on an answer names a joint: JOINTS + KINDS * joint + kind
FAST, JUMP, SPIKE, APART, CIRCLE, BEYOND, STUCK = range(7)

# Rows of bounds, one number a joint, and numbers of all joints together.
FASTEST, TOLERANCE, MOST, SHOWN, LEAP, LOWEST, HIGHEST, CLEAR = range(8)
SLOW, FARTHEST, LONGEST, LATE, FLOOR, UNKNOWN, STEADY, TURN, RECENTLY, ROUND = range(10)

# The trail: what is kept of the samples to compare the next one with. Numbers of all joints, the
# last frame's error (3) and coordinates (7), and then some of each joint.
STEPPED, BAD, BRIDGED, LOST, FRAMES, STALE, REPEATED, DEAF, TORQUES, SEEN, SINCE, RECENT = range(12)
ERROR, PLACE = 12, 15
TRAIL = 22
RATE, WAY, SAID, LONG_WAY, LONG_SAID, PATH, SAID_PATH, PEAK = range(8)
Q_STILL, V_STILL, AGREED, RAW, LEAST, BELIEVED, SAGGED, V_LEAST, V_WAY, V_SUM = range(8, 18)
Q_SAID, TRAIL_ROWS = 18, 19
SHORT, LONG = 0.05, 0.5  # [s] over which ways are summed
_SHARE, _LONG_SHARE = 0.25, 0.5  # of the way, by which q and v may differ
_SHAKEN, _SHOWN = 5.0, 10.0  # the path that v says: of that of q, and of the tolerance, at most
_TELLING = 4.0  # tolerances of a way after which an arm moves, and q and v are believed
_COUNTS = 3.0  # least changes of q, by which it clearly changes from sample to sample
_LAG = 0.2  # [s] of v before and after a reversal that the filter of a driver may leave out
HALTED = 3.0  # delays of v after which a signal that is the same to the bit may be stuck
_TIGHT = 0.5  # of tol_0, that is no motion of a joint
_LEARNED = 1.0  # of a frame's error, which learning may take away between two frames


@compiled(
    "i8(f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], f8, f8[:,::1], i8[::1], f8[::1], f8[:], f8[::1])"
)
def check_sample(
    q: np.ndarray,
    q_before: np.ndarray,
    v: np.ndarray,
    x: np.ndarray,
    place: np.ndarray,
    p_hat: np.ndarray,
    dt: float,
    bounds: np.ndarray,
    places: np.ndarray,
    numbers: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> int:
    """Return what is wrong with a sample, 1 if all joints are slow, else 0.

    What is wrong is 2 to 5 for x, and 8 + 8 i + kind for joint i. ``after`` becomes ``before`` with
    the sample added; where it is empty, the sample is compared with none before. NaN is never
    wrong. With sums that forget over T,

        D = sum dq,   W = sum v dt (trapezoid),   P = sum |dq|,   P_v = sum |v dt| above a count,
        tol = tol_0 + L min(peak |v|, v_max),

    * FAST: |v| > v_fastest.   CIRCLE: cosine^2 + sine^2 is not 1.   BEYOND: q outside its range,
      where no sample before it is known.
    * JUMP: q is not where v brings it, |dq - v dt| > tol_0 + 2 dt min(|v|, v_max).
    * SPIKE: v changed by more than a bound, and q went on as before; once the two have agreed over
      a way of four tol.
    * STUCK: q is the same to the bit, and so is v, by which q should have changed by more than
      three times its least change so far; or v has become zero at once, and not that of all joints.
    * APART: v is not the rate of q: |W - D| > share max(|W|, |D|) + tol, with a share of 1/4 over
      T = 50 ms, of 1/2 and further min(0.2 s peak |v|, 0.2 s v_max, 0.4 P) for filters over 0.5 s,
      or P_v > 5 P + 10 tol over 0.5 s. Or one of both has been the same to the bit for T > 3 L, and
      the other one says a way beyond tol_0 / 2 + 3 (least change of q) + r T, with r = v_clear +
      (least change of v), least so far: where v stands, not at zero, a T^2 / 2 of q's acceleration
      a; where q stands, min(|W|, |v| T) - 3 L min(peak |v|, v_max) - r T, as a late v decays.
    * FAR: |x - place| > far.
    * FRAME: the error e = p_hat - x of a frame has changed by more than the unknown translations,
      of at most ``unknown``, learning and noise explain: |de| > floor + unknown (sum |dq|) + |e|,
      with the turns of all joints since the last frame and shortly before.
    * FROZEN: x has not changed, and p_hat and the joints have moved by more than a bound.
    * TURNED: a measured orientation has turned by more than all joints together and a bound.

    Args:
        q: (nq) configuration, of a continuous joint cosine and sine.
        q_before: (nq) at the sample before.
        v: (n) joint velocity [rad/s or m/s].
        x: task coordinates, positions first, of a pose a quaternion last; empty without a frame.
        place: (m_p) of the last joint [m].
        p_hat: (m_p) where the model has the frame when x was taken [m]; empty: x is not compared.
        dt: since the sample before [s]; that one is forgotten where it is long ago.
        bounds: (8, n), see ``Guards``.
        places: (n + 1) where each joint begins in q, and the end.
        numbers: (10), see ``Guards``.
        before: the trail, or empty.
        after: the trail with this sample.
    """
    n, kept, follows, short, long = len(v), len(after) > 0, False, 1.0, 1.0
    if n > 0:
        if bounds.shape != (CLEAR + 1, n) or len(places) != n + 1 or len(q) != places[n]:
            raise ArrayError
        if len(q_before) != len(q) or (kept and len(after) != TRAIL + TRAIL_ROWS * n):
            raise ArrayError
    if len(numbers) != ROUND + 1 or len(before) != len(after) or (kept and len(after) < TRAIL):
        raise ArrayError
    if kept and len(p_hat) > 0 and (len(p_hat) > 3 or (len(x) > 0 and len(x) < len(p_hat))):
        raise ArrayError
    if kept and len(p_hat) > 0 and len(x) > 7:
        raise ArrayError
    if kept:
        follows = 0.0 <= dt <= numbers[LONGEST]
        for k in range(TRAIL if follows and n > 0 else len(before)):
            after[k] = before[k]
        if dt > numbers[LONGEST]:
            after[SEEN] = after[SINCE] = after[RECENT] = 0.0
            for k in range(TRAIL, len(after)):
                if (k - TRAIL) % TRAIL_ROWS not in (AGREED, LEAST, V_LEAST):
                    after[k] = 0.0
    if follows and n > 0:
        short, long = np.exp(-dt / SHORT), np.exp(-dt / LONG)
        if dt > 0.0:
            after[STALE] = 0.0
        elif before[STEPPED] != 0.0:
            after[STALE] += 1.0
            after[REPEATED] += 1.0
    halted = follows and dt > 0.0  # all joints stopped at once: by brakes, or in a simulation
    for i in range(n):
        halted = halted and v[i] == 0.0 and q[places[i]] == before[TRAIL + TRAIL_ROWS * i + RAW]
        if not halted:
            break
    resting, turned, apart, fast = True, 0.0, -1, -1
    for i in range(n):
        now, first = v[i], places[i]
        speed = abs(now)
        if speed > bounds[FASTEST, i]:
            fast = i if fast < 0 else fast
        resting &= speed < numbers[SLOW]
        plain = places[i + 1] - first == 1
        if not plain and abs(q[first] ** 2 + q[first + 1] ** 2 - 1.0) > numbers[ROUND]:
            return JOINTS + KINDS * i + CIRCLE
        at = TRAIL + TRAIL_ROWS * i
        if kept:
            after[at + RATE], after[at + RAW] = now, q[first]
        if not follows:
            if kept and plain and (q[first] < bounds[LOWEST, i] or q[first] > bounds[HIGHEST, i]):
                return JOINTS + KINDS * i + BEYOND
            continue
        if plain:
            way = q[first] - q_before[first]
        else:
            way = np.arctan2(
                q[first + 1] * q_before[first] - q[first] * q_before[first + 1],
                q[first] * q_before[first] + q[first + 1] * q_before[first + 1],
            )
        rate, agreed = before[at + RATE], before[at + AGREED]
        said = 0.5 * dt * (now + rate)  # exact for a torque that is held
        most, tolerance = bounds[MOST, i], bounds[TOLERANCE, i]
        leap, same = abs(now - rate) > bounds[LEAP, i], q[first] == before[at + RAW]
        least = before[at + LEAST]
        clear = abs(rate) > bounds[CLEAR, i] and abs(rate) * dt > _COUNTS * least > 0.0
        if same and clear and (now == rate or (now == 0.0 and not halted)):
            after[at + RATE] = rate  # for the message
            return JOINTS + KINDS * i + STUCK
        if agreed != 0.0 and fast == i:
            return JOINTS + KINDS * i + FAST
        if agreed != 0.0 and leap and abs(way - rate * dt) < abs(way - now * dt):
            return JOINTS + KINDS * i + SPIKE
        quick = max(speed, abs(rate))
        gate = tolerance + 2.0 * dt * (quick if quick < most else most)
        if abs(way - said) > gate and (agreed != 0.0 or not leap):
            return JOINTS + KINDS * i + JUMP
        step, told = abs(way), abs(said)
        change = abs(q[first] - before[at + RAW])
        change = change if plain or change > step else step  # a cosine changes by less
        after[at + LEAST] = change if change > 0.0 and not 0.0 < least < change else least
        D, W = short * before[at + WAY] + way, short * before[at + SAID] + said
        D_l, W_l = long * before[at + LONG_WAY] + way, long * before[at + LONG_SAID] + said
        P = long * before[at + PATH] + step
        P_v = long * before[at + SAID_PATH] + (told if told > bounds[SHOWN, i] else 0.0)
        peak = long * before[at + PEAK]
        peak = speed if speed > peak else peak
        after[at + WAY], after[at + SAID] = D, W
        after[at + LONG_WAY], after[at + LONG_SAID] = D_l, W_l
        after[at + PATH], after[at + SAID_PATH], after[at + PEAK] = P, P_v, peak
        change = abs(now - rate)
        finest = before[at + V_LEAST]
        after[at + V_LEAST] = change if change > 0.0 and not 0.0 < finest < change else finest
        q_still = before[at + Q_STILL] + dt if same else 0.0
        v_still = before[at + V_STILL] + dt if now == rate else 0.0
        q_said = before[at + Q_SAID] + said if same else 0.0
        v_way = before[at + V_WAY] + way if now == rate else 0.0
        v_sum = before[at + V_SUM] + dt * (v_way - 0.5 * way) if now == rate else 0.0
        after[at + Q_STILL], after[at + V_STILL] = q_still, v_still
        after[at + Q_SAID], after[at + V_WAY], after[at + V_SUM] = q_said, v_way, v_sum
        quickest = peak if peak < most else most
        stuck, lasting, unseen = 0.0, HALTED * numbers[LATE], bounds[CLEAR, i] + finest
        if v_still > lasting and least > 0.0 and finest > 0.0 and now != 0.0:
            bent = 6.0 * abs(0.5 * v_way - v_sum / v_still)
            stuck = bent - unseen * v_still
        if q_still > lasting and least > 0.0:
            told_now = min(abs(q_said), speed * q_still) - lasting * quickest
            stuck = max(stuck, told_now - 2.0 * unseen * q_still)
        turned += step
        tolerance += numbers[LATE] * quickest
        larger = max(abs(W_l), abs(D_l))
        if (
            abs(W - D) > _SHARE * max(abs(W), abs(D)) + tolerance
            or abs(W_l - D_l) > _LONG_SHARE * larger + tolerance + _LAG * min(quickest, P / LONG)
            or P_v > _SHAKEN * P + _SHOWN * tolerance
            or stuck > _TIGHT * bounds[TOLERANCE, i] + _COUNTS * least
        ):
            apart = i if apart < 0 else apart
        after[at + BELIEVED] = after[at + SAGGED] = 0.0
        after[at + AGREED] = 1.0 if larger > _TELLING * tolerance else agreed
    if apart >= 0:
        return JOINTS + KINDS * apart + APART
    if fast >= 0:
        return JOINTS + KINDS * fast + FAST
    if kept and n > 0:
        after[STEPPED], after[BAD] = 1.0, 0.0
        after[LOST] += dt if after[LOST] > 0.0 else 0.0
        after[SINCE] += turned
        after[RECENT] = np.exp(-dt / numbers[RECENTLY]) * before[RECENT] + turned
    square = 0.0
    for i in range(min(len(x), len(place))):
        square += (x[i] - place[i]) ** 2
    if square > numbers[FARTHEST] ** 2:
        return FAR
    answer = STILL if resting else MOVES
    if not kept or len(p_hat) == 0 or len(x) == 0:
        return answer
    same, change, error, m = after[SEEN] != 0.0, 0.0, 0.0, len(p_hat)
    for k in range(len(x)):
        same &= x[k] == after[PLACE + k]
    for k in range(m):
        change += (p_hat[k] - x[k] - after[ERROR + k]) ** 2
        error += after[ERROR + k] ** 2
    change, turned = np.sqrt(change), after[SINCE] + after[RECENT]
    if same:
        moved = after[SINCE] * numbers[UNKNOWN] > numbers[STEADY]  # p_hat does not only learn
        return FROZEN if moved and change > numbers[STEADY] else answer
    if after[SEEN] != 0.0:
        if change > numbers[FLOOR] + numbers[UNKNOWN] * turned + _LEARNED * np.sqrt(error):
            return FRAME
        if len(x) == m + 4:
            cosine = 0.0
            for k in range(m, len(x)):
                cosine += x[k] * after[PLACE + k]
            if 2.0 * np.arccos(min(abs(cosine), 1.0)) > turned + numbers[TURN]:
                return TURNED
    after[SEEN], after[LOST], after[SINCE] = 1.0, 0.0, 0.0
    for k in range(len(x)):
        after[PLACE + k] = x[k]
    for k in range(m):
        after[ERROR + k] = p_hat[k] - x[k]
    return answer


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
    if len(limits) != len(torque):
        raise ArrayError
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
    if len(weight) < len(dx) or len(torque) != n or len(effort_limits) != n:
        raise ArrayError
    if len(lower) != n or len(upper) != n or len(velocity_limits) != n:
        raise ArrayError
    if len(xdd_d) != m or J.shape != (m, n) or gram_inverse.shape != (m, m):
        raise ArrayError
    if len(factor) != 1:
        raise ArrayError
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
TRAVEL, HELD, DRIVE, FORMER, LATTER, OFFSET = range(6)
ROWS = 6
NOTHING, WINDOW, TOLD = 0, 1, 2
_LATEST = 2.0  # [s] after it has begun to
_LONGEST = 60.0  # [s]
_STILL = 0.02  # of tol_0, a change of way in half a window that need not be judged
_BRIEF = 1e-9  # [s]


@compiled("i8(f8[:], f8, f8[:], f8, f8, f8[:], f8[:])")
def first_samples(
    v: np.ndarray,
    dt: float,
    tolerance: np.ndarray,
    longest: float,
    half: float,
    before: np.ndarray,
    after: np.ndarray,
) -> int:
    """Add a sample to the window in which gravity is judged.

    The answer is 1 if a window is over in which the arm's speed has changed, 2 if nothing is left
    to judge, two seconds after the arm has begun to move or after a minute, and 0 if neither.
    ``after`` becomes ``before`` with the sample added.

    Args:
        v: (n) joint velocity [rad/s or m/s].
        dt: time since the sample before [s]; nothing is learned from none, or from a long one.
        tolerance: (n) tol_0 of ``check_sample`` [rad or m].
        longest: time [s] from which on a sample does not follow the one before.
        half: of the window [s].
        before: the sums over the samples before.
        after: the same with this one.
    """
    n = len(v)
    if len(tolerance) != n or len(before) != HEADER + ROWS * n or len(after) != len(before):
        raise ArrayError
    for k in range(len(before)):
        after[k] = before[k]
    if not dt > 0.0:
        return NOTHING
    if dt > longest:
        for k in range(TIME, len(after)):
            if k <= WEIGHT or k >= HEADER:
                after[k] = 0.0
        for i in range(n):
            after[HEADER + HELD * n + i] = np.nan
        return NOTHING
    after[AGE] += dt
    keep, some = np.exp(-dt / LONG), after[MOVED] > 0.0
    for i in range(n):
        at = HEADER + TRAVEL * n + i
        after[at] = keep * before[at] + dt * v[i]
        some |= abs(after[at]) > _TELLING * tolerance[i]
    if some:
        after[MOVED] += dt
    if after[MOVED] > _LATEST or after[AGE] > _LONGEST or after[JUDGED] == 0.0:
        return TOLD
    if np.isnan(after[HEADER + HELD * n]):
        return NOTHING
    if before[TIME] > 2.0 * half - _BRIEF:  # the next window
        after[TIME] = after[EARLIER] = after[WEIGHT] = 0.0
        for k in range(HEADER + DRIVE * n, HEADER + ROWS * n):
            after[k] = 0.0
    time = after[TIME] + 0.5 * dt
    weight = dt * max(min(time, 2.0 * half - time), 0.0)
    earlier = after[TIME] < half - _BRIEF
    row = FORMER if earlier else LATTER
    for i in range(n):
        after[HEADER + DRIVE * n + i] += weight * after[HEADER + HELD * n + i]
        after[HEADER + row * n + i] += dt * v[i]
    after[TIME] += dt
    after[EARLIER] += dt if earlier else 0.0
    after[WEIGHT] += weight
    if after[TIME] < 2.0 * half - _BRIEF:
        return NOTHING
    moved = after[HEARD] + after[SUSPECT] > 0.0
    for i in range(n):
        latter, former = after[HEADER + LATTER * n + i], after[HEADER + FORMER * n + i]
        change = latter / (after[TIME] - after[EARLIER]) - former / after[EARLIER]
        moved |= abs(change) * half > _STILL * tolerance[i]
    return WINDOW if moved else NOTHING
