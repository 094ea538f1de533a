"""From a sample to what the law uses: plausibility, filtered velocity, present position.

Every sample is compared with the one before: q with the integral of v, a frame with the motion of
the model, a measured torque with what the motors can give. One that does not follow is bridged by
what was predicted, and counted; one that lasts is refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import keywords, shown
from .._kernels import samples as kernels
from ..description.chain import effort_limits, is_slide, velocity_limits
from ..exceptions import ImplausibleError, InputError, MeasurementError, did_you_mean
from ..filters import LowPass
from ..models.delay_compensation import DelayCompensator, SensedState
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..records import Desired, Measurement, SensorQuality, Sensors
from ..robot.motors import Compensation
from ..robot.robot import Robot
from .first_samples import FirstSamples, limit_margins, make_first_samples, misfit

GUARDS = ("position", "velocity", "time", "rest", "limits", "differences", "gravity")
_FAR, _FAR_BASE = 2.0, 20.0  # of the reach: x from x_hat, with the base in its place and unknown
_FAST = 10.0  # of the description's velocity limits
_SLOW, _NEAR = 1e-3, 1e-4  # [1/s] and share, of a radian or the reach, of an arm that rests
_NOISE = 4.0  # standard deviations
_NOTHING, _NO_COLUMNS = np.zeros(0), np.zeros((0, 0))
_PERFECT = SensorQuality()
_MISSED = 1.5  # periods after which a sample was dropped
_LATEST = 10.0  # periods that one step may bridge
_LASTS = 0.0149  # [s] after which what does not follow is refused
_BEGUN = 1e-12  # [s] since now
_WAY = 5e-3  # [rad, or of the reach for slides] by which sums of v and of dq may differ
_FASTER = 2.0  # of the velocity limits
_LEAP = 0.5  # of them, from sample to sample
_CLEAR = 0.01  # [rad/s, or of the reach for slides] at which a joint moves
_CERTAIN = 5.0  # standard deviations of what no noise explains
_DELAY = 0.01  # [s] by which q and v may be late, one of the other
_FRAME = 0.02  # of the reach, by which a frame may be off
_UNEXPLAINED = 0.25  # of the reach, that no unknown explains
_RECENT = 0.02  # [s] in which turns are remembered
_TURN = 0.1  # [rad] by which a measured orientation may be off
_CIRCLE = 0.02  # of cosine^2 + sine^2
_STRONGER = 3.0  # than a motor can be
_CLEARLY = 3.0  # times further, or least changes of q
_LONG_SHARE = 0.5  # of a way, which v and q may differ by
_OTHER = 0.25  # by which a known factor may be missed
_REPEATED = 0.02  # [s] for which a v may be the same while q goes on
_COARSE = 10.0  # [1/s] times tol_0: the largest step of a v that comes in steps
_OFFSET = 0.5  # of tol_0: further ways over half a second, of a v that is off by a little
_WHOLE = 1e-3  # of a step, by which a v in steps may be off
_HELD, _SLOWED = 5.0, 0.5  # times the speed at which a joint moves, and of its last peak: a joint
# that has slowed down below both may be stopped at once by its friction
_STILL = 3.0  # samples after which a signal is stuck
_DIFFERENCED = 100.0  # [1/s] bandwidth of a velocity from differences of q
_BOTH, _ONLY_Q, _ONLY_V, _NEITHER = range(4)  # signals of a joint that are used
_UNSEEN = 4.0  # less than these, where a joint has been unseen for long
_OWN, _STILLS = kernels.TRAIL, (kernels.Q_STILL, kernels.V_STILL)  # of a joint by itself
_SWITCH = "limits=pa.Limits(guards={{'{}': False}}) switches this check off."


@dataclass(frozen=True, eq=False)
class Guards:
    """Bounds of plausible measurements, of one sample and of its way from the one before.

    What a sample is compared with, and by which formulas, is in the kernel ``check_sample``. A
    sample that does not follow from the one before is replaced: q by the integral of v, v by the
    last one, a frame or a torque by none. What has not followed for 15 ms is refused, and so is a
    v that is not the rate of q.

    Attributes:
        bounds: (8, n) largest |v| [rad/s or m/s]; tol_0 [rad or m]; v_max, twice the velocity
            limits; the smallest way that an encoder shows; the largest change of v in a sample;
            lowest and highest q; v at which q changes from sample to sample [rad/s or m/s].
        places: (n + 1) where each joint begins in q, and the end.
        numbers: |v| below which an arm may be resting; largest distance of x from the last joint
            [m]; time from which on a sample does not follow the one before [s]; L, by which v may
            be late [s]; change of the error of a frame [m], and for each radian that the joints
            turn [m]; way of the frame after which x is stuck [m]; change of an orientation [rad];
            time in which turns are remembered [s]; of cosine^2 + sine^2.
        torque: (n) that no motor gives [N m or N].
        clock: whether times must go forward, and the period is the time since the last sample
            where one was dropped.
        near: errors below which an arm may be resting [m or rad].
        follows: whether samples are compared with the one before.
        first: what the first samples are compared with; None: nothing.
    """

    bounds: np.ndarray
    places: np.ndarray
    numbers: np.ndarray
    torque: np.ndarray
    clock: bool = False
    near: float = 0.0
    follows: bool = False
    first: FirstSamples | None = None

    @classmethod
    def none(cls, nv: int) -> Guards:
        """Return guards that accept everything."""
        bounds = np.full((kernels.CLEAR + 1, nv), np.inf)
        bounds[kernels.LOWEST] = -np.inf
        numbers = np.full(kernels.ROUND + 1, np.inf)
        numbers[kernels.SLOW] = 0.0
        return cls(bounds, np.arange(nv + 1), numbers, np.full(nv, np.inf))

    def without_torque(self) -> Guards:
        """Return the guards where no torque is sent: gravity is not judged."""
        first = None if self.first is None else replace(self.first, gravity=None)
        return replace(self, first=first)

    def trail(self, v: np.ndarray) -> np.ndarray:
        """Return what is kept of the first sample, with its joint velocity v (n) [rad/s or m/s]."""
        if not self.follows:
            return _NOTHING
        trail = np.zeros(kernels.TRAIL + kernels.TRAIL_ROWS * v.size)
        _row(trail, kernels.RATE)[:], _row(trail, kernels.RAW)[:] = v, np.nan
        return trail

    def elapsed(
        self, before: float, now: float, dt: float, period: float, trail: np.ndarray = _NOTHING
    ) -> float:
        """Return the time [s] that a sample at time ``now`` stands for.

        dt, or the time since the sample before where others were dropped in between, or none where
        that sample had the same time.

        Raises:
            ImplausibleError: the time goes back, or stands still for too long.
            InputError: the period is not positive, or over ten times the one that the controller
                was made for.
        """
        try:
            fits = 0.0 < dt <= _LATEST * period
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise _unfit(dt, period)
        if not self.clock:
            return dt
        elapsed = now - before
        if elapsed < 0.0:
            raise ImplausibleError("t", now, f"is before the last sample's, {before:g} s")
        if elapsed == 0.0 and trail.size and trail[kernels.STEPPED]:
            if (trail[kernels.STALE] + 1.0) * min(dt, period) > _LASTS:
                raise ImplausibleError(
                    "t",
                    now,
                    f"has been the same for {trail[kernels.STALE] + 2.0:.0f} samples",
                    "does the driver repeat its last measurement?",
                )
            return 0.0
        if elapsed <= _MISSED * dt:
            return dt
        if elapsed > _LATEST * period:
            raise _unfit(elapsed, period)
        return elapsed

    def too_strong(self, tau: Any) -> bool:
        """Return whether a measured torque is one that no motor of this robot gives."""
        tau = np.asarray(tau)
        usable = tau.shape == self.torque.shape and tau.dtype.kind in "fiu"
        return usable and bool((np.abs(tau) > self.torque).any())

    def bridged(
        self, trail: np.ndarray, q_before: np.ndarray, sample: Measurement, dt: float, model: Any
    ) -> tuple[Measurement, np.ndarray]:
        """Return a sample with q and v replaced where they do not follow, and which joints' were.

        Args:
            trail: of the samples before.
            q_before: (nq) the configuration then.
            sample: whose q and v are checked.
            dt: since then [s].
            model: of the robot.
        """
        bounds = self.bounds
        rate, most = _row(trail, kernels.RATE), bounds[kernels.MOST]
        q, v = sample.q, sample.v
        way = pin.difference(model, q_before, q)
        wrong_v = ~(np.abs(v) <= bounds[kernels.FASTEST])
        leaps = np.abs(v - rate) > bounds[kernels.LEAP]
        wrong_v |= leaps & (np.abs(way - rate * dt) < np.abs(way - v * dt))
        stuck = self.stuck(trail, q, v, dt)
        v = np.where(wrong_v | stuck, rate, v)
        said = 0.5 * dt * (v + rate)
        speed = np.minimum(np.maximum(np.abs(v), np.abs(rate)), most)
        wrong_q = ~(np.abs(way - said) <= bounds[kernels.TOLERANCE] + 2.0 * dt * speed)
        wrong_q |= stuck
        for i, first in enumerate(self.places[:-1].tolist()):
            if self.places[i + 1] - first == 2:
                wrong_q[i] |= not abs(q[first] ** 2 + q[first + 1] ** 2 - 1.0) <= _CIRCLE
        if wrong_q.any():
            predicted = pin.integrate(model, q_before, said)
            q = q.copy()
            for i in np.flatnonzero(wrong_q).tolist():
                part = slice(self.places[i], self.places[i + 1])
                q[part] = predicted[part]
        return sample._replace(q=q, v=v), wrong_q | wrong_v

    def stuck(self, trail: np.ndarray, q: np.ndarray, v: np.ndarray, dt: float) -> np.ndarray:
        """Return which joints (n) have neither a new q nor a new v, though they have moved."""
        rate, clear = _row(trail, kernels.RATE), self.bounds[kernels.CLEAR]
        speed, same = np.abs(rate), q[self.places[:-1]] == _row(trail, kernels.RAW)
        stopped = same & (v == 0.0)
        slowed = (speed <= _HELD * clear) & (speed <= _SLOWED * _row(trail, kernels.PEAK))
        halted = stopped & ~stopped.all() & ~slowed & (speed > clear)
        stuck = halted | same & (v == rate) & (speed > clear)
        least = _row(trail, kernels.LEAST)
        return np.asarray(stuck & (least > 0.0) & (speed * dt > _CLEARLY * least))

    def eased(
        self, before: np.ndarray, after: np.ndarray, v: np.ndarray, dt: float
    ) -> tuple[Guards, np.ndarray, np.ndarray]:
        """Return guards and a trail by which a v that is not the rate of q is judged once more.

        Coarse sensors are no fault. A v may leave out: since it changed last, if that is less
        than 20 ms, all that q does; the step in which v comes, if all of v are multiples of one,
        times the duration of a sum; and if it goes on changing, a little more over half a second,
        for an offset.

        Args:
            before: the trail before the sample.
            after: the trail with it, of all joints.
            v: (n) of the sample [rad/s or m/s].
            dt: since the sample before [s].

        Returns:
            the guards, the trail before the sample, and what was added to its sums, as it is in
            the trail with the sample.
        """
        bounds, least = self.bounds.copy(), _row(after, kernels.V_LEAST)
        tolerance = self.bounds[kernels.TOLERANCE]
        seen = least[least > 0.0]
        step = _step(v, np.where(least > 0.0, least, math.inf))
        if seen.size and (shared := _step(v, np.full(v.size, seen.min()))).all():
            step = np.maximum(step, shared)
        step = np.minimum(step, _COARSE * tolerance)
        eased, added = before.copy(), np.zeros(before.size)
        since, moved = _row(after, kernels.V_STILL), _row(after, kernels.V_WAY)
        for row, way, duration, more in (
            (kernels.SAID, kernels.WAY, kernels.SHORT, 0.0),
            (kernels.LONG_SAID, kernels.LONG_WAY, kernels.LONG, _OFFSET),
        ):
            most = step * duration + more * tolerance * (since == 0.0)
            share = np.clip(_row(after, way) - _row(after, row), -most, most)
            _row(added, row)[:] = share
            _row(eased, row)[:] += share * math.exp(dt / duration)
        unseen = _row(eased, kernels.V_LEAST)
        unseen[:] = np.where(unseen > 0.0, unseen, step)
        bounds[kernels.TOLERANCE] += np.where(
            since < _REPEATED + _BEGUN, abs(moved - v * since), 0.0
        )
        return replace(self, bounds=bounds), eased, added

    def implausible(
        self,
        found: int,
        q_before: np.ndarray,
        sample: Measurement,
        kinematics: TaskKinematics,
        trail: np.ndarray,
        dt: float,
    ) -> ImplausibleError:
        """Return the error for what the kernel found.

        Args:
            found: the kernel's answer.
            q_before: (nq) configuration at the sample before.
            sample: as it was measured.
            kinematics: updated to the sample.
            trail: with the sample, as far as the kernel came; empty if it is only looked at.
            dt: since the sample before [s].
        """
        x = sample.x
        if found < kernels.JOINTS:
            assert x is not None  # else nothing is wrong with it
            return self._misplaced(found, x, kinematics)
        i, kind = divmod(found - kernels.JOINTS, kernels.KINDS)
        model, q, v = kinematics.robot.model, sample.q, sample.v
        name, unit = model.names[i + 1], "m" if is_slide(model.joints[i + 1]) else "rad"
        if kind in (kernels.CIRCLE, kernels.BEYOND):
            flaw = misfit(model, q) or f"is out of the range of joint '{name}'"
            return ImplausibleError("q", q, flaw, hint=_SWITCH.format("limits"))
        way = float(pin.difference(model, q_before, q)[i]) if trail.size else math.nan
        if kind == kernels.FAST:
            ratio = ""
            if trail.size:
                path = float(_row(trail, kernels.PATH)[i])
                said = float(_row(trail, kernels.SAID_PATH)[i])
                if said > _CLEARLY * path:
                    words, guess = _named_factor(path, said, unit)
                    ratio = f" q moved by {path:.3g} {unit} and v says {said:.3g} {unit}{words}: "
                    ratio += guess
            return ImplausibleError(
                "v",
                v,
                f"is implausible: {name} at {v[i]:.3g} rad/s or m/s, over {_FAST:g} times the "
                "limit of its description",
                f"in degrees?{ratio}",
            )
        rate = float(_row(trail, kernels.RATE)[i])
        hint = f"v is dq/dt of the joints, in rad/s and m/s. {_SWITCH.format('differences')}"
        if kind == kernels.SPIKE:
            return ImplausibleError(
                "v",
                v,
                f"has jumped: joint '{name}' at {v[i]:.3g} {unit}/s, while q goes on at "
                f"{way / dt if dt else 0.0:.3g} {unit}/s",
                "a damaged message? another joint's velocity?",
                hint,
            )
        if kind == kernels.STUCK:
            return ImplausibleError(
                "q",
                q,
                f"is stuck: joint '{name}' repeats its value to the bit since it moved at "
                f"{rate:.3g} {unit}/s",
                "has its encoder stopped, or its message? does the driver repeat a measurement?",
                f"Start anew with `init` once q follows the arm. {_SWITCH.format('differences')}",
            )
        if kind == kernels.JUMP:
            at = float(q[self.places[i]])
            came = at - way if self.places[i + 1] - self.places[i] == 1 else math.nan
            return ImplausibleError(
                "q",
                q,
                f"has jumped: joint '{name}' by {way:.3g} {unit}, but v gives {rate * dt:.3g} "
                f"{unit}",
                _why_jumped(way, at, came, float(self.bounds[kernels.TOLERANCE, i])),
                "Initialise the driver and start anew with `init`. "
                f"{_SWITCH.format('differences')}",
            )
        rows = (kernels.LONG_WAY, kernels.LONG_SAID, kernels.SAID_PATH, kernels.PATH)
        way, said, said_path, path = (float(_row(trail, row)[i]) for row in rows)
        if abs(said - way) < _LONG_SHARE * max(abs(said), abs(way)):
            short = (kernels.WAY, kernels.SAID)
            way_s, said_s = (float(_row(trail, row)[i]) for row in short)
            way, said = (
                (way_s, said_s)
                if abs(said_s - way_s) > _OTHER * max(abs(said_s), abs(way_s))
                else (path, said_path)
            )
        q_still, v_still = (float(_row(trail, row)[i]) for row in _STILLS)
        lasting = kernels.HALTED * self.numbers[kernels.LATE]
        if v_still > lasting:
            way, said = float(_row(trail, kernels.V_WAY)[i]), float(v[i]) * v_still + 0.0
        if q_still > lasting:
            way, said = 0.0, float(_row(trail, kernels.Q_SAID)[i])
        words, guess = _named_factor(way, said, unit)
        stuck = [
            signal
            for signal, still in (("q", q_still), ("v", v_still))
            if still > _STILL * max(dt, _BEGUN)
        ]
        if stuck and "stuck" not in guess:
            guess = f"{' and '.join(stuck)} stuck, the same for the last samples?"
        return ImplausibleError(
            "v",
            v,
            f"is not the rate of q: joint '{name}' moved by {way:.3g} {unit} and v says "
            f"{said:.3g} {unit}{words}",
            guess,
            hint,
        )

    def _misplaced(self, found: int, x: np.ndarray, kinematics: TaskKinematics) -> ImplausibleError:
        """Return the error of an x that the kernel found wrong."""
        hint = "Give x in metres, in the axes and from the origin of the robot's base."
        switch = _SWITCH.format("position")
        if found == kernels.FAR:
            distance = np.linalg.norm(x[: kinematics.positions] - kinematics.p_hat)
            return ImplausibleError(
                "x",
                x,
                f"is implausible: {distance:.3g} m from where the model has it, "
                f"more than {self.numbers[kernels.FARTHEST]:.3g} m",
                "in millimetres? in another frame?",
                hint,
            )
        if found == kernels.FROZEN:
            return ImplausibleError(
                "x",
                x,
                "has not changed while the joints have moved the frame by more than "
                f"{self.numbers[kernels.STEADY]:.2g} m",
                "does the camera repeat its last frame?",
                f"Give no x where there is no new frame. {switch}",
            )
        if found == kernels.TURNED:
            return ImplausibleError(
                "x",
                x,
                "has turned by more than all joints together",
                "another marker? a quaternion in another order?",
                switch,
            )
        return ImplausibleError(
            "x",
            x,
            "has jumped by more than the motion of the joints and what is unknown explain",
            "another marker or object? a camera, a base or a tool that was moved?",
            "A tool is announced by `announce(state, tool_translation=...)`; after other changes "
            f"start anew with `init`. {switch}",
        )


def _why_jumped(way: float, at: float, before: float, tolerance: float) -> str:
    """Return what may cause a jump of a joint to a position from another [rad or m]."""
    turns = way / (2.0 * math.pi)
    if round(turns) and abs(turns - round(turns)) * 2.0 * math.pi < 4.0 * tolerance:
        return "a wrap at +-pi? unwrap the angle, q counts whole turns"
    if abs(math.radians(at) - before) < 4.0 * tolerance and abs(at) > _CLEARLY * abs(before):
        return "is q in degrees? q * pi / 180 would fit"
    return "a lost count of the encoder? a damaged message?"


def _named_factor(way: float, said: float, unit: str) -> tuple[str, str]:
    """Return the ratio of a way as v says it and one as q says it, and what may cause it."""
    known = {
        180.0 / math.pi: "degrees/s{}? v * pi / 180 would fit",
        math.pi / 180.0: "is q in degrees? q * pi / 180 would fit",
        30.0 / math.pi: "turns a minute{}?",
        1.0: "the wrong sign?",
    }
    if unit == "m":
        known = {1e3: "mm/s{}? v / 1000 would fit", 1e-3: "is q in mm?", 1.0: "the wrong sign?"}
    for value, words in known.items():
        factor = said / way if way else math.inf
        if value == 1.0 and factor > 0.0:
            continue
        if abs(abs(factor) / value - 1.0) < (_OTHER if value != 1.0 else 2.0 * _OTHER):
            sign = ", and of the wrong sign" if factor < 0.0 else ""
            return f", {factor:.3g} times as far", words.format(sign)
    if abs(said) < 0.1 * abs(way):
        return "", "v stuck at zero, or of another joint?"
    if abs(way) <= 1e-3 * abs(said):
        return "", "q stuck, or v of another joint?"
    return f", {said / way:.3g} times as far", "late, or measured at the motor, before a gear?"


def _row(trail: np.ndarray, row: int) -> np.ndarray:
    """Return one number a joint (n) of a trail, as a view."""
    return trail[kernels.TRAIL + row :: kernels.TRAIL_ROWS]


def _unfit(dt: Any, period: float) -> InputError:
    """Return the error of a dt [s] that does not fit the period that the controller is made for."""
    made = f" and at most {_LATEST * period:g} s, ten periods of the controller"
    return InputError(
        f"must be positive{made if math.isfinite(period) else ''}, got {dt!r}.",
        where="dt",
        hint="After a longer pause start anew with `init`, from the last estimates.",
    )


Read: TypeAlias = tuple[SensedState, bool, Measurement]
Given: TypeAlias = tuple[
    SensedState, float, Measurement, Desired, TaskKinematics, np.ndarray, bool, float | None
]


@keywords(carrier="compensator=pa.models.DelayCompensator(...)")
@dataclass(frozen=True, eq=False)
class Senses:
    """From a measurement to joint velocity and present task position.

    Attributes:
        guards: what is refused as implausible, and when the arm rests.
        compensator: predicts the present position from late frames of a camera.
        low_pass: on the measured joint velocity, or None.
        quality: of the sensors for which all this is made.
        sensors: for which all this is made.
    """

    guards: Guards
    compensator: DelayCompensator = field(default_factory=DelayCompensator)
    low_pass: LowPass | None = None
    quality: SensorQuality = _PERFECT
    sensors: Sensors = field(default_factory=Sensors)

    def init(
        self, measurement: Measurement, kinematics: TaskKinematics, a_k: np.ndarray
    ) -> SensedState:
        """Return what is kept of the first sample, with the kinematic estimate a_k (p) [m].

        Raises:
            ImplausibleError: this robot cannot be there; see ``FirstSamples``.
        """
        _, q, v, x, *_ = measurement
        first = None
        if self.guards.first is not None:
            kinematics.update_unchecked(a_k, q, v)
            first = self.guards.first.init(q, x, kinematics)
        if not kinematics.positions:  # a joint task
            x = kinematics.task.measured_unchecked(None, q)
        return SensedState(
            q.copy(),
            v.copy(),
            None if x is None else x.copy(),
            first=first,
            trail=self.guards.trail(v),
        )

    def read(self, given: Given) -> Read:
        """Return what is known at a sample, whether joints and reference rest, and the sample.

        The kinematics are updated to the sample, which is returned with what was bridged replaced.
        What is known shares no memory with it.

        Args:
            given: what was known at the sample before; the time of that one [s]; the sample; the
                desired motion; the estimated kinematics, and their estimate a_k (p_k) [m]; whether
                the prediction error of the position is used; and the time since the sample before
                [s], None if the sample does not follow it and is only looked at.

        Raises:
            ImplausibleError: what the guards refuse, the last frame of the camera is too old, or
                what the first samples show is impossible.
            MeasurementError: a frame was taken later than the sample.
        """
        before, t_before, measurement, desired, kinematics, a_k, position_error, since = given
        t, q, v, x, x_time, _, _, tau, _ = measurement
        guards, first, trail = self.guards, before.first, _NOTHING
        late = x_time is not None and x_time != t
        if since is None:
            after = _NOTHING
        else:
            trail = before.trail
            after = empty(trail.size)
        if tau is not None and trail.size and guards.too_strong(tau):
            return self._without_torque(given)
        if first is not None and since is not None:
            first = self._first(first, measurement, since)
        q, raw = q.copy(), v
        v = (
            v.copy()
            if self.low_pass is None
            else self.low_pass.advance_unchecked(before.v, v, t - t_before)
        )
        kinematics.update_unchecked(a_k, q, v)
        found = kernels.check_sample(
            q, before.q, raw, _NOTHING if x is None else x, kinematics.p_hat,
            _NOTHING if late else kinematics.p_hat, since or 0.0,
            guards.bounds, guards.places, guards.numbers, trail, after,
        )  # fmt: skip
        if found > kernels.STILL:
            return self._bridged(found, after, given)
        still = found == kernels.STILL and not (desired.xd_d.any() or desired.xdd_d.any())
        if not kinematics.positions:  # a joint task
            return SensedState(
                q, v, kinematics.x_hat, kinematics.p_hat, kinematics.X_k, None, (), first, after
            ), still, measurement  # fmt: skip
        if x is None or late or self.compensator.smoothing < math.inf:
            sensed = self.compensator.update(before, t_before, t, q, v, x, x_time, kinematics)
            if late and x is not None and after.size and sensed.frame is not before.frame:
                found, after = self._late_frame(x, sensed.epsilon, after)
                if found > kernels.STILL:
                    return self._bridged(found, after, given)
            return sensed._replace(first=first, trail=after), still, measurement
        if not position_error:
            return SensedState(
                q, v, x.copy(), _NOTHING, _NO_COLUMNS, None, (), first, after
            ), still, measurement  # fmt: skip
        epsilon = kinematics.p_hat - x[: kinematics.positions]
        X_k = kinematics.X_k if kinematics.calibrated else kinematics.explaining_unchecked(x)
        return SensedState(
            q, v, x.copy(), epsilon, X_k, None, (), first, after
        ), still, measurement  # fmt: skip

    def _late_frame(
        self, x: np.ndarray, epsilon: np.ndarray, trail: np.ndarray
    ) -> tuple[int, np.ndarray]:
        """Return what is wrong with a frame x of its own time and error epsilon (m_p), if anything.

        The second is the trail with the frame.
        """
        guards, after = self.guards, empty(trail.size)
        found = kernels.check_sample(
            _NOTHING, _NOTHING, _NOTHING, x, _NOTHING, epsilon + x[: epsilon.size], 0.0,
            guards.bounds, guards.places, guards.numbers, trail, after,
        )  # fmt: skip
        return found, after

    def _without_torque(self, given: Given) -> Read:
        """Return what ``read`` returns, for a sample whose measured torque is none.

        Raises:
            ImplausibleError: it has lasted.
        """
        before, t_before, sample, desired, kinematics, a_k, position_error, since = given
        deaf = _lasting(before.trail[kernels.DEAF], since)
        if deaf > _LASTS:
            most = self.guards.torque
            i = int(np.argmax(np.abs(np.asarray(sample.tau)) / most))
            raise ImplausibleError(
                "tau",
                sample.tau,
                f"is more than the motors give: {kinematics.joint_names[i]} at most "
                f"{most[i] / _STRONGER:.3g} N m or N",
                "in another unit? a damaged message?",
                "Give the torques of the joints in N m or N, after the gears, or none. "
                f"{_SWITCH.format('gravity')}",
            )
        heard = before, t_before, sample._replace(tau=None)
        sensed, still, sample = self.read((*heard, desired, kinematics, a_k, position_error, since))
        sensed.trail[kernels.DEAF] = deaf
        sensed.trail[kernels.TORQUES] += 1.0
        return sensed, still, sample

    def _bridged(self, found: int, trail: np.ndarray, given: Given) -> Read:
        """Return what ``read`` returns, for a sample in which the kernel found something wrong.

        Args:
            found: the kernel's answer.
            trail: with the sample, as far as the kernel came.
            given: the arguments of ``read``.

        Raises:
            ImplausibleError: it cannot be bridged, or has lasted.
            MeasurementError: it is not finite.
        """
        before, t_before, sample, desired, kinematics, a_k, position_error, since = given
        guards, model, dt = self.guards, kinematics.robot.model, since or 0.0
        for name, value in (("q", sample.q), ("v", sample.v), ("x", sample.x)):
            if value is not None and not np.isfinite(value).all():
                raise MeasurementError(name, value)
        if dt and trail.size and (read := self._looked_at_again(found, trail, given)) is not None:
            return read
        if trail.size and found >= kernels.JOINTS:
            i, kind = divmod(found - kernels.JOINTS, kernels.KINDS)
            if kind == kernels.FAST and _row(before.trail, kernels.AGREED)[i]:
                for row in (kernels.PATH, kernels.SAID_PATH):  # the kernel did not come to them
                    _row(trail, row)[i] = _row(before.trail, row)[i]
        error = guards.implausible(found, before.q, sample, kinematics, trail, dt)
        if since is None or not trail.size:
            raise error
        if found < kernels.JOINTS:
            place, count = kernels.LOST, kernels.FRAMES
            bridged = sample._replace(x=None, x_time=None, xd=None)
        else:
            i, kind = divmod(found - kernels.JOINTS, kernels.KINDS)
            place, count = kernels.BAD, kernels.BRIDGED
            if kind in (kernels.APART, kernels.BEYOND):
                raise error
            agreed = _row(before.trail, kernels.AGREED)[i]
            if kind == kernels.FAST and (not agreed or _moves_so(model, before.q, sample, i, dt)):
                raise error
            bridged, replaced = guards.bridged(before.trail, before.q, sample, dt, model)
            if not replaced[i]:
                raise error
            if np.array_equal(bridged.q, sample.q) and np.array_equal(bridged.v, sample.v):
                raise error  # bridged already, and still impossible
        lasting = _lasting(before.trail[place], since)
        if lasting > _LASTS:
            raise error
        sensed, still, bridged = self.read(
            (before, t_before, bridged, desired, kinematics, a_k, position_error, since)
        )
        sensed.trail[place] = lasting
        sensed.trail[count] += 1.0
        if count == kernels.BRIDGED:
            _row(sensed.trail, kernels.RAW)[:] = sample.q[guards.places[:-1]]
            _row(sensed.trail, kernels.LEAST)[:] = _row(before.trail, kernels.LEAST)
        return sensed, still, bridged

    def _looked_at_again(self, found: int, trail: np.ndarray, given: Given) -> Read | None:
        """Return what ``read`` returns if a closer look at q and v finds nothing wrong, else None.

        A slow joint may stop at once, by its friction; and sensors may be coarse, see ``eased``.

        Args:
            found: the kernel's answer.
            trail: with the sample, as far as the kernel came.
            given: the arguments of ``read``.
        """
        before, t_before, sample, desired, kinematics, a_k, position_error, since = given
        guards, eased, dt = self.guards, before.trail, since or 0.0
        added = np.zeros(eased.size)
        joints = before.q, sample.v, _NOTHING, _NOTHING, _NOTHING, dt
        kind = (found - kernels.JOINTS) % kernels.KINDS if found >= kernels.JOINTS else -1
        if kind == kernels.STUCK:
            stuck = guards.stuck(eased, sample.q, sample.v, dt)
            eased, trail = eased.copy(), empty(eased.size)
            _row(eased, kernels.RATE)[~stuck & (sample.v == 0.0)] = 0.0
            found = kernels.check_sample(
                sample.q, *joints, guards.bounds, guards.places, guards.numbers, eased, trail
            )
            kind = (found - kernels.JOINTS) % kernels.KINDS if found >= kernels.JOINTS else -1
        if kind == kernels.APART:
            guards, eased, added = guards.eased(eased, trail, sample.v, dt)
            found = kernels.check_sample(
                sample.q, *joints, guards.bounds, guards.places, guards.numbers, eased, trail.copy()
            )
        if eased is before.trail or found > kernels.STILL:
            return None
        known = before._replace(trail=eased), t_before, sample, desired, kinematics, a_k
        sensed, still, sample = replace(self, guards=guards).read((*known, position_error, since))
        return sensed._replace(trail=sensed.trail - added), still, sample

    def believed(
        self,
        before: SensedState,
        sample: Measurement | None,
        dt: float,
        decay: float,
        model: Any,
        *,
        known: bool,
    ) -> SensedState:
        """Return the plausible q and v at a sample, whatever is wrong with it.

        Joint by joint: both as measured while they follow from the sample before; q and its
        differences where v does not; the integral of v where q does not, or is stuck; and where
        neither is plausible, or nothing was measured, the motion of an arm that is damped.
        Once q and v contradict each other, the one that is not stuck is used from then on. The way
        of each joint since then is in the trail, and which joints were unseen for 15 ms.

        Args:
            before: what was known, or estimated, at the sample before.
            sample: the sample, which may be refused or not finite; None: there is none.
            dt: since then [s].
            decay: rate at which a damped arm loses its speed [1/s].
            model: of the robot.
            known: whether the sample has the time of the one before, and may be the same.
        """
        n = model.nv
        q_before, v_before, trail = before.q, before.v, before.trail.copy()
        v_ahead = v_before * math.exp(-decay * dt)
        q_ahead = pin.integrate(model, q_before, 0.5 * dt * (v_before + v_ahead))
        q, v, unseen = q_ahead.copy(), v_ahead, np.ones(n, bool)
        codes = _row(trail, kernels.BELIEVED) if trail.size else np.zeros(n)
        codes[codes < 0.0] += _UNSEEN
        if sample is not None:
            rates = _row(trail, kernels.RATE) if trail.size else v_before.copy()
            q_there, v_there = _finite(sample.q, q), _finite(sample.v, v)
            measured = np.where(v_there, _numbers(sample.v, v), rates)
            q_seen = np.where(q_there, _numbers(sample.q, q), q_ahead)
            stuck = again = ~unseen
            if trail.size:
                stuck = self.guards.stuck(trail, q_seen, measured, dt)
                again = known & (q_seen[self.guards.places[:-1]] == _row(trail, kernels.RAW))
                again &= measured == rates
            for i in range(n):
                part = slice(self.guards.places[i], self.guards.places[i + 1])
                there = bool(q_there[part].all())
                believed = (_BOTH if v_there[i] else _ONLY_Q) if there else _ONLY_V
                believed = _NEITHER if not there and not v_there[i] else believed
                if believed == _BOTH and stuck[i] and not codes[i] and not again[i]:
                    believed = _NEITHER
                elif believed == _BOTH and trail.size and not again[i]:
                    believed = self._believed_joint(i, part, q_before, q_seen, measured, dt, trail)
                unseen[i] = believed == _NEITHER
                if believed in (_BOTH, _ONLY_Q):
                    q[part] = q_seen[part]
                if believed == _BOTH:
                    v[i] = measured[i]
                elif believed == _ONLY_Q:
                    way = pin.difference(model, q_before, _with(q_before, part, q_seen))[i]
                    share = -math.expm1(-_DIFFERENCED * dt)
                    v[i] = v_before[i] + share * (way / dt - v_before[i])
                elif believed == _ONLY_V:
                    v[i] = measured[i]
                    way = np.zeros(n)
                    way[i] = 0.5 * dt * (measured[i] + v_before[i])
                    q[part] = pin.integrate(model, q_before, way)[part]
        if trail.size:
            _row(trail, kernels.SAGGED)[:] += pin.difference(model, q_before, q)
            trail[kernels.BAD] = _lasting(trail[kernels.BAD], dt) if unseen.any() else 0.0
            if trail[kernels.BAD] > _LASTS:
                codes[unseen] -= _UNSEEN
        return before._replace(q=q, v=v, trail=trail)

    def sagged(self, sensed: SensedState) -> np.ndarray:
        """Return how far the joints (n) moved since the first call of ``believed`` [rad or m]."""
        return _row(sensed.trail, kernels.SAGGED) if sensed.trail.size else np.zeros(sensed.v.size)

    def _believed_joint(
        self,
        i: int,
        part: slice,
        q_before: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        dt: float,
        trail: np.ndarray,
    ) -> int:
        """Return which signals of a joint i are plausible, and add the sample to its trail.

        Args:
            i: index of the joint.
            part: where it is in q.
            q_before: (nq) used at the sample before.
            q: (nq) as measured, finite.
            v: (n) as measured, finite [rad/s or m/s].
            dt: since then [s].
            trail: until then, to be changed.
        """
        block = slice(
            kernels.TRAIL + kernels.TRAIL_ROWS * i, kernels.TRAIL + kernels.TRAIL_ROWS * (i + 1)
        )
        guards = replace(self.guards, bounds=self.guards.bounds[:, i : i + 1].copy())
        own = np.concatenate([trail[: kernels.TRAIL], trail[block]])
        after, places = own.copy(), np.array([0, part.stop - part.start])
        joint = q[part], q_before[part], v[i : i + 1], _NOTHING, _NOTHING, _NOTHING, dt
        found = kernels.check_sample(*joint, guards.bounds, places, guards.numbers, own, after)
        kind = (found - kernels.JOINTS) % kernels.KINDS if found >= kernels.JOINTS else -1
        if kind == kernels.APART:
            guards, eased, _ = guards.eased(own, after, v[i : i + 1], dt)
            bounds, numbers = guards.bounds, guards.numbers
            found = kernels.check_sample(*joint, bounds, places, numbers, eased, own.copy())
            kind = kind if found > kernels.STILL else -1
        latched, sagged = int(own[_OWN + kernels.BELIEVED]), own[_OWN + kernels.SAGGED]
        q_still, v_still = (after[_OWN + row] > _STILL * dt for row in _STILLS)
        way = (abs(v[i]) - after[_OWN + kernels.V_LEAST]) * after[_OWN + kernels.Q_STILL]
        frozen = q_still and v_still and way > _CLEARLY * after[_OWN + kernels.LEAST] > 0.0
        if kind in (-1, kernels.APART):
            own[_OWN:] = after[_OWN:]
        if not latched and kind == kernels.APART:
            latched = (_NEITHER if v_still else _ONLY_V) if q_still else _ONLY_Q
        elif not latched and kind in (kernels.FAST, kernels.SPIKE):
            latched = _ONLY_Q
        own[_OWN + kernels.BELIEVED], own[_OWN + kernels.SAGGED] = latched, sagged
        if kind in (kernels.JUMP, kernels.CIRCLE):
            own[_OWN + kernels.RATE] = v[i]
        trail[block] = own[_OWN:]
        if latched:
            return latched
        if kind == kernels.STUCK or frozen:
            return _NEITHER
        return _ONLY_V if kind in (kernels.JUMP, kernels.CIRCLE) else _BOTH

    def _first(
        self, first: np.ndarray, measurement: Measurement, elapsed: float
    ) -> np.ndarray | None:
        """Return the sums of the first samples with one more; None once their checks are complete.

        Args:
            first: their sums until then.
            measurement: the sample.
            elapsed: time since the one before [s].

        Raises:
            ImplausibleError: it is impossible.
        """
        known, after = self.guards.first, empty(first.size)
        assert known is not None  # else nothing would be remembered
        found = kernels.first_samples(
            measurement.v, elapsed, known.tolerance, known.longest, known.half, first, after
        )
        if measurement.tau is not None:
            known.hear(after, measurement.tau, elapsed)
        if found == kernels.NOTHING:
            return after
        return known.judge(found, after, measurement.q)


def _numbers(given: Any, like: np.ndarray) -> np.ndarray:
    """Return an array of the size of another one, NaN if it is none."""
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    return array if array.shape == like.shape else np.full(like.shape, np.nan)


def _step(v: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return the steps (n) in which velocities v (n) come, of 0 where they are no multiples."""
    steps = v / least
    return np.where(np.isfinite(least) & (abs(steps - np.round(steps)) < _WHOLE), least, 0.0)


def _finite(given: Any, like: np.ndarray) -> np.ndarray:
    """Return where an array of the size of another one is finite."""
    return np.isfinite(_numbers(given, like))


def _with(q: np.ndarray, part: slice, other: np.ndarray) -> np.ndarray:
    """Return q (nq) with a part of another one."""
    mixed = q.copy()
    mixed[part] = other[part]
    return mixed


def _lasting(bad: float, since: float | None) -> float:
    """Return how long something has been wrong [s], from what was known at the sample before."""
    return float(bad) + (since or 0.0) if bad else _BEGUN


def _moves_so(model: Any, q_before: np.ndarray, sample: Measurement, i: int, dt: float) -> bool:
    """Return whether q confirms the velocity of a joint i."""
    way = float(pin.difference(model, q_before, sample.q)[i])
    return bool(way * sample.v[i] * dt > 0.0 and abs(way) > 0.5 * abs(sample.v[i]) * dt)


def make_guards(
    robot: Robot,
    kinematics: TaskKinematics,
    guards: Mapping[str, bool] | bool,
    quality: SensorQuality,
    *,
    unloaded: Robot,
    box: np.ndarray | None,
    sensors: Sensors,
    compensation: Compensation | None,
    dt: float,
) -> Guards:
    """Return the guards of a controller for a robot.

    Args:
        robot: the nominal robot.
        kinematics: its kinematics.
        guards: False for none, or some of ``GUARDS`` with False.
        quality: of the sensors, whose noise an arm that rests still shows.
        unloaded: the robot without the load announced at first.
        box: (2, p) in which the kinematic estimates stay [m], or None where there are none.
        sensors: of the robot.
        compensation: torque that the arm is declared to add to the command, or None.
        dt: sampling period [s].

    Raises:
        InputError: an unknown guard.
    """
    if not isinstance(guards, bool | Mapping):
        raise InputError(f"expected True, False or a mapping, got {shown(guards)}.", where="guards")
    on = dict.fromkeys(GUARDS, guards is not False)
    for name, wanted in (guards if isinstance(guards, Mapping) else {}).items():
        if name not in GUARDS or not isinstance(wanted, bool):
            raise InputError(
                f"expected some of {list(GUARDS)} with true or false, got {name!r} = {wanted!r}."
                f"{did_you_mean(str(name), GUARDS)}",
                where="guards",
            )
        on[name] = wanted
    model, n, size = robot.model, robot.model.nv, robot.reach
    parts = kinematics.translations
    based = not kinematics.calibrated or any(part.joint == FIRST for part in parts)
    scale = size if kinematics.positions else 1.0
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    lengths = np.where(slides, min(1.0, size), 1.0)
    found = Guards.none(n)
    bounds, numbers, torque = found.bounds, found.numbers, found.torque
    fast, counts = velocity_limits(model), np.broadcast_to(np.asarray(sensors.encoder, float), n)
    noise = sensors.deviation("q") + sensors.deviation("v") * math.sqrt(dt * kernels.LONG)
    tolerance = _WAY * lengths + 2.0 * counts + _CERTAIN * noise
    bounds[kernels.MOST] = _FASTER * fast
    bounds[kernels.SHOWN] = np.maximum(2.0 * counts, 0.15 * _WAY * lengths)
    if on["velocity"]:
        bounds[kernels.FASTEST] = _FAST * fast
    if on["differences"]:
        bounds[kernels.TOLERANCE] = tolerance
        bounds[kernels.LEAP] = _LEAP * fast + 2.0 * _CERTAIN * quality.v
        bounds[kernels.CLEAR] = _CLEAR * lengths + _CLEARLY * counts / dt
        bounds[kernels.CLEAR] += _CERTAIN * sensors.deviation("v")
    if on["limits"]:
        bounds[kernels.LOWEST], bounds[kernels.HIGHEST] = limit_margins(model)
        numbers[kernels.ROUND] = _CIRCLE
    if on["rest"]:
        numbers[kernels.SLOW] = (
            _SLOW * (min(1.0, size) if slides.any() else 1.0) + _NOISE * quality.v
        )
    numbers[kernels.LONGEST] = (_LATEST + 0.5) * dt
    numbers[kernels.LATE] = max(_DELAY, dt)
    numbers[kernels.RECENTLY] = _RECENT + 3.0 * quality.age
    if on["position"] and kinematics.positions:
        numbers[kernels.FARTHEST] = (_FAR_BASE if based else _FAR) * size
    if on["position"] and kinematics.positions and kinematics.calibrated:
        x_noise = 2.0 * _CERTAIN * quality.x
        numbers[kernels.FLOOR] = numbers[kernels.STEADY] = _FRAME * size + x_noise
        numbers[kernels.UNKNOWN] = _UNEXPLAINED * size + _unknown_lengths(kinematics, box)
        numbers[kernels.TURN] = _TURN + 2.0 * _CERTAIN * sensors.deviation("angle")
    if on["gravity"]:
        deviation = np.broadcast_to(np.asarray(sensors.noise.get("tau", 0.0), float), n)
        torque = _STRONGER * effort_limits(model) + _CERTAIN * deviation
    return Guards(
        bounds=bounds,
        places=np.array([joint.idx_q for joint in model.joints[1:]] + [model.nq], dtype=np.int64),
        numbers=numbers,
        torque=torque,
        clock=on["time"],
        near=_NEAR * scale + _NOISE * quality.x,
        follows=any(on[name] for name in GUARDS if name != "rest"),
        first=make_first_samples(
            robot,
            unloaded=unloaded,
            on=on,
            tolerance=tolerance,
            box=np.zeros((2, 0)) if box is None else box,
            sensors=sensors,
            compensation=compensation,
            dt=dt,
        )
        if any(on[name] for name in ("position", "limits", "gravity"))
        else None,
    )


def _unknown_lengths(kinematics: TaskKinematics, box: np.ndarray | None) -> float:
    """Return how far the frame can be from where the model has it [m], apart from the base."""
    if box is None or not kinematics.size:
        return 0.0
    span = np.maximum(box[1] - kinematics.initial, kinematics.initial - box[0])
    total, first = 0.0, 0
    for part in kinematics.translations:
        if part.joint != FIRST:
            inside = np.linalg.norm(span[first : first + part.size])
            total += float(np.linalg.norm(part.directions, 2) * inside)
        first += part.size
    return total
