"""From a sample to what the law uses: plausibility, filtered velocity, present position.

Every sample is compared with the one before: q with the integral of v, a frame with the motion of
the model, a measured torque with what the motors can give. Each channel has a residual, and a bound
from the noise of the declared sensors and from what is unknown. A sample beyond it is bridged by
what was predicted, and counted; one that lasts is refused, and so is a v that is not the rate of q.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import samples as kernels
from ..description.chain import effort_limits, is_slide, velocity_limits
from ..exceptions import ImplausibleError, InputError, MeasurementError
from ..filters import LowPass
from ..models.delay_compensation import DelayCompensator, SensedState
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..records import Desired, Measurement, SensorQuality, Sensors
from ..robot.motors import Compensation
from ..robot.robot import Robot
from .first_samples import FirstSamples, limit_margins, make_first_samples, misfit

GUARDS = ("position", "velocity", "time", "rest", "limits", "differences", "gravity")
_LASTS = 0.0149  # [s] after which what does not follow is refused; half: fewer lost messages are
# bridged, double: a wrong q or x moves the arm for twice as long
_LATEST, _PAUSE = 10.0, 0.01  # periods, and [s] that one step may bridge, whichever is longer;
# half: more pauses end a run, double: the estimates take longer steps
_MISSED = 1.5  # periods after which a sample was dropped: between one and two
_CERTAIN = 5.0  # standard deviations of what no noise explains: half: false alarms within seconds
# at 1 kHz, double: noise hides twice the fault
_WAY = 5e-3  # [rad, or of the reach for slides] by which sums of v and of dq may differ; half: a v
# off by 0.02 rad/s is refused, double: a wrong v moves the arm twice as far
_FAST, _FASTER, _LEAP = 10.0, 2.0, 0.5  # of the velocity limits: any v, one of which the change
# since the last sample is believed, and the change; half or double: no fault of the table differs
_CLEAR = 0.01  # [rad/s, or of the reach for slides] at which a joint moves; half: noise moves it,
# double: an encoder that freezes at such a speed is not found
_SLOW, _NEAR = 1e-3, 1e-4  # [1/s] and share, of a radian or the reach, of an arm that rests; half:
# friction keeps estimates moving, double: slow paths stop them
_NOISE = 4.0  # standard deviations of an arm that rests; half: noise moves it in seconds
_FRAME, _UNEXPLAINED = 0.02, 0.25  # of the reach, by which a frame may be off, and by a radian;
# half: learning trips it, double: a marker that jumps by less passes
_FAR, _FAR_BASE = 2.0, 20.0  # of the reach: x from x_hat, with the base in its place and unknown;
# millimetres are 1000 times off, so half or double change nothing
_RECENT = 0.02  # [s] in which turns are remembered; half: late frames trip it, double: jumps pass
_STRONGER = 3.0  # than a motor can be; half: gears with overload trip it, double: units pass
_DIFFERENCED = 100.0  # [1/s] bandwidth of a velocity from differences of q; half: ``safe`` brakes
# late, double: counts of an encoder shake it
_REACTION = 0.5  # of the push that a joint gives to the others if it stops at once: the middle
# between a joint that stops and an encoder that does
_BOTH, _ONLY_Q, _ONLY_V, _NEITHER = range(4)  # signals of a joint that are used
_UNSEEN = 4.0  # less than these, where a joint has been unseen for long
_BEGUN = 1e-12  # [s] since now
_NOTHING, _NO_COLUMNS = np.zeros(0), np.zeros((0, 0))
_PERFECT = SensorQuality()
_SWITCH = "limits=pa.Limits(guards={{'{}': False}}) switches this check off."


@dataclass(frozen=True, eq=False)
class Guards:
    """Bounds of plausible measurements, of one sample and of its way from the one before.

    What a sample is compared with, and by which formulas, is in the kernels ``check_joints`` and
    ``check_frame``. What does not follow is replaced: q by the integral of v, v by the last one, a
    frame or a torque by none.

    Attributes:
        bounds: (7, n) largest |v| [rad/s or m/s]; tol [rad or m]; v_max, twice the velocity limits;
            the largest change of v in a sample; lowest and highest q; v at which a joint moves.
        places: (n + 1) where each joint begins in q, and the end.
        numbers: |v| below which an arm may be resting; largest distance of x from x_hat [m]; time
            from which on a sample does not follow the one before [s]; change of the error of a
            frame [m], and for each radian that the joints turn [m]; time in which turns are
            remembered [s].
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
        numbers = np.full(kernels.RECENTLY + 1, np.inf)
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
            InputError: the period is not positive, or longer than one step may bridge.
        """
        longest = max(_LATEST * period, _PAUSE)
        try:
            fits = 0.0 < dt <= longest
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise _unfit(dt, longest)
        if not self.clock:
            return dt
        elapsed = now - before
        if elapsed < 0.0:
            raise ImplausibleError("t", now, f"is before the last sample's, {before:g} s")
        if elapsed == 0.0 and trail.size and trail[kernels.STEPPED]:
            if (trail[kernels.STALE] + 1.0) * min(dt, period) > _LASTS:
                raise ImplausibleError(
                    "t", now, f"has been the same for {trail[kernels.STALE] + 2.0:.0f} samples"
                )
            return 0.0
        if elapsed > longest:
            raise _unfit(elapsed, longest)
        return elapsed if elapsed > _MISSED * dt else dt

    def too_strong(self, tau: Any) -> bool:
        """Return whether a measured torque is one that no motor of this robot gives."""
        tau = np.asarray(tau)
        usable = tau.shape == self.torque.shape and tau.dtype.kind in "fiu"
        return usable and bool((np.abs(tau) > self.torque).any())

    def judge(
        self, q: np.ndarray, q_before: np.ndarray, v: np.ndarray, dt: float, trail: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Return what is wrong with each joint (n), the trail after, and the kernel's answer.

        Args:
            q: (nq) of the sample.
            q_before: (nq) used at the sample before.
            v: (n) of the sample [rad/s or m/s].
            dt: since then [s].
            trail: until then.
        """
        kinds, after = empty(v.size, dtype=np.int64), empty(trail.size)
        answer = kernels.check_joints(
            q, q_before, v, dt, self.bounds, self.places, self.numbers, trail, after, kinds
        )
        return kinds, after, answer

    def doubt(
        self,
        kinds: np.ndarray,
        after: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        dt: float,
        trail: np.ndarray,
        model: pin.Model,
        noise: float,
    ) -> None:
        """Tell joints that stand from encoders that do, by the momentum.

        A joint that stops at once pushes the others, M_rr dv_r = M_ri v_i. If that would be seen
        and was not, the joint is doubted until it moves; and if the motors would have moved it
        since, by the change of its torque over its inertia, its encoder is stuck.

        Args:
            kinds: (n) what is wrong with each joint: of those that have stopped at once only the
                stuck ones remain.
            after: the trail with the sample, to which the doubts are added.
            q: (nq) at the sample before.
            v: (n) of the sample [rad/s or m/s].
            dt: since then [s].
            trail: until then.
            model: of the robot.
            noise: standard deviation of v.
        """
        stopped = kinds == kernels.STOPPED
        kinds[stopped] = kernels.FOLLOWS
        if not stopped.any() and not after[kernels.DOUBT]:
            return
        M, rate = pin.crba(model, model.createData(), q), _row(trail, kernels.RATE)
        for i in np.flatnonzero(stopped).tolist():
            others = np.arange(v.size) != i
            push = M[others, i] * rate[i]
            expected = np.linalg.solve(M[np.ix_(others, others)], push)
            least = _CERTAIN * noise + self.bounds[kernels.CLEAR, i]
            if np.linalg.norm(expected) > least:
                seen = (v - rate)[others] @ push
                if seen < _REACTION * (expected @ push):
                    _row(after, kernels.AGAINST)[i] = _row(trail, kernels.TORQUE)[i]
        held, stands = _row(after, kernels.AGAINST), _row(after, kernels.STILL_Q) > 0.0
        held[~stands] = 0.0
        doubted = held != 0.0
        gained, pushed = _row(after, kernels.GAINED), _row(after, kernels.PUSHED)
        gained += dt * np.where(doubted, (_row(trail, kernels.TORQUE) - held) / np.diag(M), 0.0)
        pushed += dt * gained
        gained[~doubted], pushed[~doubted] = 0.0, 0.0
        after[kernels.DOUBT] = float(doubted.any())
        kinds[np.abs(pushed) > self.bounds[kernels.TOLERANCE]] = kernels.STOPPED
        if not kinds.any():
            after[kernels.BAD] = 0.0

    def predicted(
        self,
        kinds: np.ndarray,
        trail: np.ndarray,
        q_before: np.ndarray,
        sample: Measurement,
        dt: float,
        model: pin.Model,
    ) -> Measurement:
        """Return a sample with q and v predicted where they do not follow.

        Args:
            kinds: (n) what is wrong with each joint.
            trail: of the samples before.
            q_before: (nq) the configuration then.
            sample: whose q and v are replaced.
            dt: since then [s].
            model: of the robot.
        """
        rate = _row(trail, kernels.RATE)
        v = np.where(kinds == kernels.SPIKE, rate, sample.v)
        ahead = pin.integrate(model, q_before, 0.5 * dt * (v + rate))
        q = sample.q.copy()
        for i in np.flatnonzero(np.isin(kinds, (kernels.JUMP, kernels.OUT))).tolist():
            part = slice(self.places[i], self.places[i + 1])
            q[part] = ahead[part]
        return sample._replace(q=q, v=v)

    def implausible(
        self,
        kinds: np.ndarray,
        sample: Measurement,
        trail: np.ndarray,
        way: np.ndarray,
        dt: float,
        model: pin.Model,
    ) -> ImplausibleError:
        """Return the error for the first joint with which something is wrong.

        Args:
            kinds: (n) what is wrong with each joint.
            sample: as it was measured.
            trail: with the sample; empty if it is compared with none.
            way: (n) since the sample before [rad or m].
            dt: since the sample before [s].
            model: of the robot.
        """
        i = int(np.flatnonzero(kinds)[0])
        kind, v, tolerance = int(kinds[i]), float(sample.v[i]), self.bounds[kernels.TOLERANCE, i]
        name, unit = model.names[i + 1], "m" if is_slide(model.joints[i + 1]) else "rad"
        if kind == kernels.OUT:
            flaw = misfit(model, sample.q) or f"is out of the range of joint '{name}'"
            return ImplausibleError("q", sample.q, flaw, hint=_SWITCH.format("limits"))
        hint = f"v is dq/dt, in rad/s and m/s. {_SWITCH.format('differences')}"
        if kind == kernels.SPIKE:
            words = f"is implausible: joint '{name}' at {v:.3g} {unit}/s, limit "
            words += f"{self.bounds[kernels.MOST, i] / _FASTER:.3g}"
            if trail.size and dt:
                words += f", while q goes on at {way[i] / dt:.3g} {unit}/s"
            return ImplausibleError("v", sample.v, words, "in degrees?", hint)
        if kind == kernels.JUMP:
            words = f"has jumped: joint '{name}' by {way[i]:.3g} {unit}, but v gives "
            words += f"{v * dt:.3g} {unit} +- {tolerance:.2g}"
            guess = "a wrap at +-pi, a lost count, degrees?"
            return ImplausibleError("q", sample.q, words, guess, _SWITCH.format("differences"))
        if kind == kernels.STOPPED:
            words = (
                f"is stuck: joint '{name}' stands at once, without a push to the other joints and "
            )
            words += "against its motor"
            return ImplausibleError("q", sample.q, words, "has its encoder stopped?", hint)
        D, R = (float(_row(trail, row)[i]) for row in (kernels.WAY, kernels.RESIDUAL))
        words = f"is not the rate of q: joint '{name}' moved by {D:.3g} {unit} and v says "
        words += f"{D - R:.3g} {unit}; {abs(R):.2g} of difference are beyond {tolerance:.2g} and "
        words += "what a late v explains"
        stuck = [
            signal
            for signal, row in (("q", kernels.STILL_Q), ("v", kernels.STILL_V))
            if _row(trail, row)[i] > 3.0 * dt
        ]
        guess = f"{' and '.join(stuck)} stuck?" if stuck else "the wrong sign, unit or joint?"
        return ImplausibleError("v", sample.v, words, guess, hint)


def _row(trail: np.ndarray, row: int) -> np.ndarray:
    """Return one number a joint (n) of a trail, as a view."""
    return trail[kernels.TRAIL + row :: kernels.TRAIL_ROWS]


def _unfit(dt: Any, longest: float) -> InputError:
    """Return the error of a dt [s] that one step cannot bridge."""
    made = f" and at most {longest:g} s" if math.isfinite(longest) else ""
    return InputError(
        f"must be positive{made}, got {dt!r}.",
        where="dt",
        hint="After a longer pause start anew with `init`, from the last estimates.",
    )


Read: TypeAlias = tuple[SensedState, bool, Measurement]
Given: TypeAlias = tuple[
    SensedState, float, Measurement, Desired, TaskKinematics, np.ndarray, bool, float | None
]


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
        guards, first, model = self.guards, before.first, kinematics.robot.model
        trail, dt = (_NOTHING, 0.0) if since is None else (before.trail, since)
        kinds, after, answer = guards.judge(measurement.q, before.q, measurement.v, dt, trail)
        if answer == 2:
            measurement, after = self._bridged(kinds, after, before, measurement, since, model)
        if measurement.tau is not None and trail.size and guards.too_strong(measurement.tau):
            measurement = self._without_torque(before, measurement, dt, kinematics, after)
        if first is not None and since is not None:
            first = self._first(first, measurement, since)
        t, q, v, x, x_time, *_ = measurement
        q = q.copy()
        v = (
            v.copy()
            if self.low_pass is None
            else self.low_pass.advance_unchecked(before.v, v, t - t_before)
        )
        kinematics.update_unchecked(a_k, q, v)
        still = answer == 1 and not (desired.xd_d.any() or desired.xdd_d.any())
        if not kinematics.positions:  # a joint task
            return SensedState(
                q, v, kinematics.x_hat, kinematics.p_hat, kinematics.X_k, None, (), first, after
            ), still, measurement  # fmt: skip
        late = x_time is not None and x_time != t
        if x is not None and not late and kernels.check_frame(
            x, kinematics.p_hat, guards.numbers, after
        ):  # fmt: skip
            measurement = self._without_frame(measurement, kinematics.p_hat, since, after)
            x, x_time, late = None, None, False
        if x is None or late or self.compensator.smoothing < math.inf:
            follow = before, t_before, t, q, v
            sensed = self.compensator.update(*follow, x, x_time, kinematics)
            if late and x is not None and after.size and sensed.frame is not before.frame:
                p_hat = sensed.epsilon + x[: kinematics.positions]
                if kernels.check_frame(x, p_hat, guards.numbers, after):
                    measurement = self._without_frame(measurement, p_hat, since, after)
                    sensed = self.compensator.update(*follow, None, None, kinematics)
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

    def _bridged(
        self,
        kinds: np.ndarray,
        trail: np.ndarray,
        before: SensedState,
        sample: Measurement,
        since: float | None,
        model: pin.Model,
    ) -> tuple[Measurement, np.ndarray]:
        """Return a sample with what does not follow as predicted, and the trail with it.

        Args:
            kinds: (n) what is wrong with each joint.
            trail: with the sample as it was measured.
            before: what was known at the sample before.
            sample: the sample.
            since: time since then [s], None if the sample does not follow.
            model: of the robot.

        Raises:
            ImplausibleError: it cannot be bridged, or has lasted.
            MeasurementError: it is not finite.
        """
        for name, value in (("q", sample.q), ("v", sample.v)):
            if not np.isfinite(value).all():
                raise MeasurementError(name, value)
        guards, dt, noise = self.guards, since or 0.0, self.quality.v
        if trail.size:
            given = before.q, sample.v, dt, before.trail, model, noise
            guards.doubt(kinds, trail, *given)
            if not kinds.any():
                return sample, trail
        way = pin.difference(model, before.q, sample.q)
        error = guards.implausible(kinds, sample, trail, way, dt, model)
        follows = trail.size and dt <= guards.numbers[kernels.LONGEST]
        lasting = _lasting(trail[kernels.BAD], dt) if follows else math.inf
        if lasting > _LASTS or np.isin(kinds, (kernels.APART, kernels.STOPPED)).any():
            raise error
        bridged = guards.predicted(kinds, before.trail, before.q, sample, dt, model)
        kinds, after, _ = guards.judge(bridged.q, before.q, bridged.v, dt, before.trail)
        guards.doubt(kinds, after, before.q, bridged.v, dt, before.trail, model, noise)
        if kinds.any():
            raise error
        after[kernels.BAD], after[kernels.BRIDGED] = lasting, trail[kernels.BRIDGED] + 1.0
        _row(after, kernels.RAW)[:] = sample.q[guards.places[:-1]]
        _row(after, kernels.LEAST)[:] = _row(before.trail, kernels.LEAST)
        after[kernels.STEP] = before.trail[kernels.STEP]
        return bridged, after

    def _without_frame(
        self, sample: Measurement, p_hat: np.ndarray, since: float | None, trail: np.ndarray
    ) -> Measurement:
        """Return a sample without its frame, which does not follow, and count it in the trail.

        Raises:
            ImplausibleError: it has lasted, or there is nothing to bridge it with.
        """
        x = sample.x
        assert x is not None
        lasting = _lasting(trail[kernels.LOST], since or 0.0) if trail.size else math.inf
        if lasting > _LASTS:
            off = np.linalg.norm(p_hat - x[: p_hat.size])
            seen = trail.size and np.array_equal(
                x[: p_hat.size], trail[kernels.PLACE : kernels.PLACE + p_hat.size]
            )
            words = "has not changed while the joints moved" if seen else "has jumped"
            raise ImplausibleError(
                "x",
                x,
                f"{words}: {off:.3g} m from where the model has the frame, and more than the "
                "motion of the joints and what is unknown explain",
                "does the camera repeat its last frame?"
                if seen
                else "another marker, millimetres, a camera or a tool that was moved?",
                "A tool is announced by `announce(state, tool_translation=...)`. "
                f"{_SWITCH.format('position')}",
            )
        trail[kernels.LOST] = lasting
        trail[kernels.FRAMES] += 1.0
        return sample._replace(x=None, x_time=None, xd=None)

    def _without_torque(
        self,
        before: SensedState,
        sample: Measurement,
        since: float,
        kinematics: TaskKinematics,
        trail: np.ndarray,
    ) -> Measurement:
        """Return a sample without its torque, which no motor gives, and count it in the trail.

        Raises:
            ImplausibleError: it has lasted.
        """
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
                _SWITCH.format("gravity"),
            )
        trail[kernels.DEAF] = deaf
        trail[kernels.TORQUES] += 1.0
        return sample._replace(tau=None)

    def believed(
        self,
        before: SensedState,
        sample: Measurement | None,
        dt: float,
        decay: float,
        model: pin.Model,
        *,
        known: bool,
    ) -> SensedState:
        """Return the plausible q and v at a sample, whatever is wrong with it.

        Joint by joint: both as measured while they follow from the sample before; q and its
        differences where v does not; the integral of v where q does not, or stands; and where
        neither is plausible, or nothing was measured, the motion of an arm that is damped. Once q
        and v contradict each other, the one that is not stuck is used from then on. The way of each
        joint since then is in the trail, and which joints were unseen for 15 ms.

        Args:
            before: what was known, or estimated, at the sample before.
            sample: the sample, which may be refused or not finite; None: there is none.
            dt: since then [s].
            decay: rate at which a damped arm loses its speed [1/s].
            model: of the robot.
            known: whether the sample has the time of the one before, and may be the same.
        """
        guards, trail, v_before = self.guards, before.trail.copy(), before.v
        kept, ahead = trail.size > 0, v_before * math.exp(-decay * dt)
        used = np.full(model.nv, _NEITHER)
        latched = _row(trail, kernels.BELIEVED).copy() if kept else np.zeros(model.nv)
        latched[latched < 0.0] += _UNSEEN
        way_ahead = 0.5 * dt * (v_before + ahead)
        way, v = way_ahead, ahead
        if sample is not None:
            rate = _row(trail, kernels.RATE).copy() if kept else v_before
            q_seen = _numbers(sample.q, model.nq)
            v_seen = _numbers(sample.v, model.nv)
            parts = [slice(*ends) for ends in zip(guards.places, guards.places[1:], strict=False)]
            q_there = np.array([bool(np.isfinite(q_seen[part]).all()) for part in parts])
            v_there = np.isfinite(v_seen)
            predicted = pin.integrate(model, before.q, way_ahead)
            q = np.where(np.isfinite(q_seen), q_seen, predicted)
            v = np.where(v_there, v_seen, rate)
            used = np.where(v_there, _BOTH, _ONLY_Q)
            same = np.zeros(model.nv, bool)
            if kept:
                same = known & (q[guards.places[:-1]] == _row(trail, kernels.RAW)) & (v == rate)
                kinds, after, _ = guards.judge(q, before.q, v, dt, trail)
                guards.doubt(kinds, after, before.q, v, dt, trail, model, self.quality.v)
                kinds = np.where(same, kernels.FOLLOWS, kinds)
                stands = _row(after, kernels.STILL_Q) > 3.0 * dt
                stuck = stands & (_row(after, kernels.STILL_V) > 3.0 * dt)
                apart = (kinds == kernels.APART) & (latched == _BOTH)
                latched[apart] = np.where(stuck, _NEITHER, np.where(stands, _ONLY_V, _ONLY_Q))[
                    apart
                ]
                latched[(kinds == kernels.SPIKE) & (latched == _BOTH)] = _ONLY_Q
                used = np.where(
                    v_there & np.isin(kinds, (kernels.JUMP, kernels.OUT)), _ONLY_V, used
                )
                used = np.where(latched > 0.0, latched, used)
                frozen = _row(after, kernels.AGAINST) != 0.0
                used[frozen] = _NEITHER
                sagged = _row(trail, kernels.SAGGED).copy()
                trail[kernels.TRAIL :], trail[kernels.DOUBT] = after[kernels.TRAIL :], frozen.any()
                _row(trail, kernels.SAGGED)[:] = sagged
            used = np.where(q_there, used, np.where(used == _ONLY_Q, _NEITHER, _ONLY_V))
            used = np.where(~v_there & (used == _ONLY_V), _NEITHER, used)
            way_q = pin.difference(model, before.q, q)
            share = -math.expm1(-_DIFFERENCED * dt)
            from_q = v_before + share * (way_q / dt - v_before)
            by_q, by_v = np.isin(used, (_BOTH, _ONLY_Q)), np.isin(used, (_BOTH, _ONLY_V))
            way = np.where(by_q, way_q, np.where(by_v, 0.5 * dt * (v + v_before), way_ahead))
            v = np.where(by_v, v, np.where(by_q, from_q, ahead))
        if kept:
            _row(trail, kernels.SAGGED)[:] += way
            unseen = used == _NEITHER
            trail[kernels.BAD] = _lasting(trail[kernels.BAD], dt) if unseen.any() else 0.0
            if trail[kernels.BAD] > _LASTS:
                latched[unseen] -= _UNSEEN
            _row(trail, kernels.BELIEVED)[:] = latched
        return before._replace(q=pin.integrate(model, before.q, way), v=v, trail=trail)

    def remember(self, sensed: SensedState, torque: np.ndarray) -> None:
        """Keep the torque (n) that is held from this sample on, for the momentum."""
        if sensed.trail.size:
            _row(sensed.trail, kernels.TORQUE)[:] = torque

    def sagged(self, sensed: SensedState) -> np.ndarray:
        """Return how far the joints (n) moved since the first call of ``believed`` [rad or m]."""
        return _row(sensed.trail, kernels.SAGGED) if sensed.trail.size else np.zeros(sensed.v.size)

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


def _numbers(given: Any, size: int) -> np.ndarray:
    """Return an array of a size, NaN if it is none."""
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    return array if array.shape == (size,) else np.full(size, np.nan)


def _lasting(bad: float, since: float) -> float:
    """Return how long something has been wrong [s], from what was known at the sample before."""
    return float(bad) + since if bad else _BEGUN


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

    """
    on = dict.fromkeys(GUARDS, guards is not False)
    on |= guards if isinstance(guards, Mapping) else {}
    model, n, size = robot.model, robot.model.nv, robot.reach
    parts = kinematics.translations
    based = not kinematics.calibrated or any(part.joint == FIRST for part in parts)
    scale = size if kinematics.positions else 1.0
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    lengths = np.where(slides, min(1.0, size), 1.0)
    found = Guards.none(n)
    bounds, numbers, torque = found.bounds, found.numbers, found.torque
    fast, counts = velocity_limits(model), np.broadcast_to(np.asarray(sensors.encoder, float), n)
    noise = sensors.deviation("q") + sensors.deviation("v") * math.sqrt(dt * kernels.MEMORY)
    tolerance = _WAY * lengths + 2.0 * counts + _CERTAIN * noise
    bounds[kernels.MOST] = _FASTER * fast
    if on["velocity"]:
        bounds[kernels.FASTEST] = _FAST * fast
    if on["differences"]:
        bounds[kernels.TOLERANCE] = tolerance
        bounds[kernels.LEAP] = _LEAP * fast + 2.0 * _CERTAIN * quality.v
        bounds[kernels.CLEAR] = _CLEAR * lengths + _CERTAIN * sensors.deviation("v")
    if on["limits"]:
        bounds[kernels.LOWEST], bounds[kernels.HIGHEST] = limit_margins(model)
    if on["rest"]:
        numbers[kernels.SLOW] = (
            _SLOW * (min(1.0, size) if slides.any() else 1.0) + _NOISE * quality.v
        )
    numbers[kernels.LONGEST] = max(_LATEST * dt, _PAUSE) + 0.5 * dt
    numbers[kernels.RECENTLY] = _RECENT + 3.0 * quality.age
    if on["position"] and kinematics.positions:
        numbers[kernels.FARTHEST] = (_FAR_BASE if based else _FAR) * size
    if on["position"] and kinematics.positions and kinematics.calibrated:
        numbers[kernels.FLOOR] = _FRAME * size + 2.0 * _CERTAIN * quality.x
        numbers[kernels.UNKNOWN] = _UNEXPLAINED * size + _unknown_lengths(kinematics, box)
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
