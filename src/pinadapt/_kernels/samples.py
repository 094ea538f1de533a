"""Checks in every step: plausible measurements, rest, torque limits, estimates; of a loop."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from .._compiled import Indices, Matrix, PackedMatrix, PackedVector, Vector, compiled

# What is wrong with a joint.
FOLLOWS, MISSING, JUMP, SPIKE, APART, STOPPED, OUT = range(7)
NO_Q, NO_V = 1, 2  # what is not used of a joint

_OF_BOUNDS = "fastest", "tolerance", "leap", "clear", "slow", "lowest", "highest"
BOUNDS = np.dtype([(name, float) for name in _OF_BOUNDS])  # of a joint, see ``Guards``
_FIELDS = ", ".join(f"('{name}', f8)" for name in _OF_BOUNDS)
Bounds = Annotated[np.ndarray, f"Record.make_c_struct([{_FIELDS}])[::1]"]
# What is kept of a joint for the next sample: what is used of it and what was measured, leaky sums,
# for how long it has been the same, and what is wrong with it.
(
    RATE, RAW_Q, RAW_V, JITTER, RESIDUAL, WAY, CHANGE, STILL_Q, STILL_V,
    KIND, SIZE, BOUND, DISTRUST, UNSEEN, DISPLACED, KEPT,
) = range(16)  # fmt: skip
MEMORY = 0.2  # [s] of the leaky sums; half: v off by 0.02 rad/s passes twice; double: found later
_LATE = 0.1  # [s] by which v may come after q; half: filters of 80 ms are refused, double: a wrong
# v is found 0.1 s later where it changes
_SHARE = 0.25  # of the way, by which v may be off for good; half: 20 % is refused
_REPEATED = 0.02  # [s] for which q or v may be the same while the other goes on, as one of 50 Hz;
# half: that is refused, double: a stuck one is found as much later
_AT_ONCE = 2.0  # times the largest change of v in 0.2 s, by which a joint stops at once; half:
# stops of coarse encoders are refused, double: one that freezes soon after a start is not found
_DIFFERENCED = 100.0  # [1/s] bandwidth of a velocity from differences of q; half: ``safe`` brakes
# late, double: counts of an encoder shake it


@compiled(fills=4)
def check_joints(
    q: Vector,
    q_before: Vector,
    v: Vector,
    dt: float,
    decay: float,
    begun: bool,
    bounds: Bounds,
    places: Indices,
    before: PackedMatrix,
    after: PackedMatrix,
    shared: PackedVector,
    q_used: PackedVector,
    v_used: PackedVector,
) -> int:
    """Write q and v (n) as far as they follow; return 2 if something may not, 1 at rest, else 0.

    With the residual r = dq - v dt (trapezoid) and sums that forget over 0.2 s, R = sum r, D = sum
    dq, C = sum dv, a joint is

    * MISSING: q or v is not finite.
    * SPIKE: v changed by more than a bound, and q went on as before, not by the mean of both v;
      or |v| is beyond all bounds.
    * JUMP: |r| > tol + 2 dt |v|: q is not where v brings it; or cosine^2 + sine^2 is not 1.
    * OUT: q is out of range, before a first step.
    * APART: v is not the rate of q. A v that is late by s leaves R = s C, so R is taken relative to
      the nearest of these up to 100 ms: beyond tol + share max(|D|, |D - R|) + T (least change of
      any v, its resolution). A v that is the same to the bit is not judged for 20 ms; then, and
      after 20 ms of the same q, there is no share, and of a v that is not zero neither lateness
      nor half of tol.
    * STOPPED: q is the same to the bit and v has become zero at once. Only the momentum tells
      whether the joint did.

    What is not used is replaced: q by the integral of v, v by the rate of q, both by the velocity
    before, which decays, and adds nothing to R. Once v and q are APART, the one that is not stuck
    is used from then on.

    Args:
        q: (nq) configuration, of a continuous joint cosine and sine.
        q_before: (nq) used at the sample before.
        v: (n) joint velocity [rad/s or m/s].
        dt: since the sample before [s].
        decay: of the velocity of which nothing is used, as of an arm that is damped [1/s].
        begun: whether there was a step before.
        bounds: (n) of ``BOUNDS``, see ``Guards``.
        places: (n + 1) where each joint begins in q, and the end.
        before: (15, n) what is kept of each joint, at the sample before.
        after: (15, n) the same with this sample.
        shared: (2) least change of any v [rad/s or m/s], and the way of all joints [rad and m]; the
            sample is added.
        q_used: (nq) q, which is replaced as far as it is not used.
        v_used: (n) of the sample, as far as it is used.
    """
    for i in range(len(v)):
        change = abs(v[i] - before[RAW_V, i])
        if change > 0.0 and not 0.0 < shared[0] < change:
            shared[0] = change
    leak = math.exp(-dt / MEMORY)
    resting = True
    wrong = False
    for i in range(len(v)):
        old, new, most, k, speed = before[:, i], after[:, i], bounds[i], places[i], v[i]
        rate, way, circle, plain = old[RATE], q[k] - q_before[k], True, places[i + 1] == k + 1
        resting &= abs(speed) < most["slow"]
        if not plain:
            circle = abs(q[k] ** 2 + q[k + 1] ** 2 - 1.0) < 0.02
            way = math.atan2(
                q[k + 1] * q_before[k] - q[k] * q_before[k + 1],
                q[k] * q_before[k] + q[k + 1] * q_before[k + 1],
            )
        r = way - 0.5 * dt * (speed + rate)  # exact for a torque that is held
        R_before = leak * old[RESIDUAL]
        D_before = leak * old[WAY]
        C_before = leak * old[CHANGE]
        R = R_before + r
        D = D_before + way
        C_late = _LATE * (C_before + speed - rate)
        same = q[k] == old[RAW_Q]
        still_q = old[STILL_Q] + dt if same else 0.0
        still_v = old[STILL_V] + dt if speed == old[RAW_V] else 0.0

        tolerance = most["tolerance"]
        apart = tolerance + MEMORY * shared[0]
        if max(still_q, still_v) <= _REPEATED:
            apart += _SHARE * max(abs(D), abs(D - R))
        elif still_v > _REPEATED and speed != 0.0:
            apart = apart - 0.5 * tolerance
            C_late = 0.0
        R -= min(max(R, min(C_late, 0.0)), max(C_late, 0.0))
        jump = tolerance + 2.0 * dt * max(abs(speed), abs(rate))
        leap = abs(speed - rate) > most["leap"] and abs(way - rate * dt) < abs(r)
        inside = most["lowest"] <= q[k] <= most["highest"]
        distrust = old[DISTRUST]
        if distrust == NO_Q + NO_V and not same:  # a joint that seemed to be stuck moves again
            distrust = 0.0
        clear = max(most["clear"], _AT_ONCE * old[JITTER])
        no_q = not (math.isfinite(q[k]) and math.isfinite(way))
        no_v = not math.isfinite(speed)
        kind, size, bound = FOLLOWS, 0.0, 0.0  # the residual, and what it should be at most
        if no_q or no_v:
            kind = MISSING
        elif leap:
            kind = SPIKE
            size = speed - rate
            bound = most["leap"]
        elif abs(speed) > most["fastest"]:
            kind = SPIKE
            size = speed
            bound = most["fastest"]
        elif abs(r) > jump or not circle:
            kind = JUMP
            size = r
            bound = jump
        elif plain and not begun and not inside:
            kind = OUT
            size = q[k]
            bound = most["highest"] if q[k] > 0.0 else most["lowest"]
        elif abs(R) > apart and not 0.0 < still_v <= _REPEATED:
            kind = APART
            size = R
            bound = apart
        elif same and speed == 0.0 and abs(rate) > clear:
            kind = STOPPED
            size = rate
            bound = clear
        if (kind == APART or (kind == SPIKE and decay > 0.0)) and distrust == 0.0:
            distrust = NO_V
            if still_q > 3.0 * dt:
                distrust = NO_Q + NO_V if still_v > 3.0 * dt else NO_Q
        no_v |= distrust >= NO_V or kind == SPIKE
        no_q |= distrust % NO_V == NO_Q or (kind == JUMP and not no_v)

        used = speed
        if no_q and no_v:
            used = rate * math.exp(-decay * dt)
        elif no_v:
            used = rate + (way - dt * rate) / max(dt, 1.0 / _DIFFERENCED)
        if no_q:
            way = 0.5 * dt * (rate + used)
            q_used[k] = q_before[k] + way
            if not plain:
                q_used[k] = math.cos(way) * q_before[k] - math.sin(way) * q_before[k + 1]
                q_used[k + 1] = math.sin(way) * q_before[k] + math.cos(way) * q_before[k + 1]
        v_used[i] = used
        shared[1] += abs(way)
        wrong |= kind != FOLLOWS or distrust != 0.0
        new[RATE], new[RAW_Q], new[RAW_V] = used, q[k], speed
        new[RESIDUAL] = R_before + (0.0 if no_q or no_v else r)
        new[WAY], new[CHANGE] = D_before + way, C_before + used - rate
        new[JITTER] = old[JITTER]
        if kind != STOPPED:
            new[JITTER] = max(leak * old[JITTER], abs(speed - rate))
        new[KIND], new[SIZE], new[BOUND] = kind, size, bound
        if kind <= MISSING and distrust != 0.0:  # why it is distrusted
            new[KIND], new[SIZE], new[BOUND] = old[KIND], old[SIZE], old[BOUND]
        new[STILL_Q], new[STILL_V], new[DISTRUST] = still_q, still_v, distrust
        new[UNSEEN] = old[UNSEEN] + dt if no_q and no_v else 0.0
        new[DISPLACED] = old[DISPLACED] + way if decay > 0.0 else 0.0
    return 2 if wrong else 1 if resting else 0


@compiled(fills=0)
def size_of_estimates(a_d: Vector, a_k: Vector, torque: Vector) -> float:
    """Return |a_d|^2 + |a_k|^2, or NaN where |torque|^2 is not finite."""
    size = 0.0
    effort = 0.0
    for entry in a_d:
        size += entry * entry
    for entry in a_k:
        size += entry * entry
    for entry in torque:
        effort += entry * entry
    return size + 0.0 * effort


@compiled(fills=0)
def exceeds(torque: Vector, limits: Vector) -> bool:
    """Return whether a finite torque (n) exceeds one of its limits (n)."""
    beyond = False
    effort = 0.0
    for i in range(len(torque)):
        beyond |= abs(torque[i]) > limits[i]
        effort += torque[i] * torque[i]
    return beyond and np.isfinite(effort)


@compiled()
def path_rate(
    dx: Vector,
    weight: Vector,
    positions: int,
    slow: float,
    hold: float,
    creep: float,
    late: float,
    torque: Vector,
    effort_limits: Vector,
    effort: float,
    q: Vector,
    lower: Vector,
    upper: Vector,
    lead: float,
    xd_d: Vector,
    xdd_d: Vector,
    J: Matrix,
    gram_inverse: Matrix,
    velocity_limits: Vector,
    rate: float,
    acceleration: float,
    ahead: float,
    factors: Vector,
) -> int:
    """Fill factors (3 + 3 n) with those of the governor and return which one is the smallest.

    0: one; 1: error; 2: frames; 3 + i, 3 + n + i, 3 + 2 n + i: effort, stop and speed of joint i.
    See ``Governor``. The velocity of the joints for the path at full rate is the larger
    of J^+ x_d' and J^+ (x_d' + ahead ds/dt x_d''), with J^+ = J^T gram_inverse, x_d' = xd_d / rate
    and x_d'' (ds/dt)^2 = xdd_d - x_d' d^2s/dt^2. A factor f below the rate becomes f (f / rate)^2:
    the rate has f as its equilibrium, but follows with more than a lag (damping 1 / sqrt(3)).
    """
    n, m, place, turn, joint = len(q), len(xd_d), 0.0, 0.0, 0.0
    factors[:] = 1.0
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
    if e > slow:
        factors[1] = max(min(bound, creep * (hold - e)), 0.0)
    factors[2] = min(max(1.0 - late, 0.0), 1.0)
    moving = rate >= 1e-6
    lead_s = ahead if rate >= 1e-2 else 0.0
    for i in range(n):
        share = abs(torque[i]) / effort_limits[i]
        if share > effort:
            factors[3 + i] = max((1.0 - share) / (1.0 - effort), 0.0)
        if not moving:
            continue
        speed = 0.0
        now = 0.0
        for j in range(m):
            transposed = 0.0
            for k in range(len(J)):  # those of constraints too
                transposed += J[k, i] * gram_inverse[k, j]
            velocity = xd_d[j] / rate
            now += transposed * velocity
            speed += transposed * (velocity + lead_s * (xdd_d[j] - velocity * acceleration) / rate)
        if abs(now) > abs(speed):
            speed = now
        room = upper[i] - q[i] if speed > 0.0 else q[i] - lower[i]
        if room < lead * abs(speed):
            factors[3 + n + i] = max(room / (lead * abs(speed)), creep)
        bound = velocity_limits[i] / max(abs(speed), 1e-300)
        if bound < rate:
            bound *= (bound / rate) ** 2
        if bound < 1.0:
            factors[3 + 2 * n + i] = bound
    return int(factors.argmin())
