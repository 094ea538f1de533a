"""From a sample to what the law uses: plausibility, filtered velocity, present position.

Every sample is compared with the one before: q with the integral of v, a frame with the motion of
the model, a joint that stands with the momentum, a measured torque with what the motors can give.
Each channel has a residual, and a bound from the noise of the declared sensors and from what is
unknown. A sample beyond it is bridged by what was predicted, and counted; one that lasts is
refused, and so is a v that is not the rate of q.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import samples as kernels
from ..description.chain import effort_limits, is_slide, position_limits, velocity_limits
from ..exceptions import ImplausibleError, InputError, MeasurementError
from ..filters import LowPass
from ..models.delay_compensation import DelayCompensator, SensedState
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..records import Measurement, SensorQuality, Sensors
from ..robot.motors import Compensation
from ..robot.robot import Robot
from .first_samples import FirstSamples, make_first_samples

GUARDS = ("position", "velocity", "time", "rest", "limits", "differences", "gravity")
LASTS = 0.0149  # [s] after which what does not follow is refused; half: fewer lost messages are
# bridged, double: a wrong q or x moves the arm for twice as long
LATEST, _PAUSE = 10.0, 0.01  # periods, and [s] that one step may bridge, whichever is longer;
# half: more pauses end a run, double: the estimates take longer steps
_MISSED = 1.5  # periods after which a sample was dropped: between one and two
_CERTAIN = 5.0  # standard deviations of what no noise explains: half: false alarms within seconds
# at 1 kHz, double: noise hides twice the fault
_WAY = 5e-3  # [rad, or of the reach for slides] by which sums of v and of dq may differ; half: a v
# off by 0.02 rad/s is refused, double: a wrong v moves the arm twice as far
_FAST, _LEAP = 10.0, 0.5  # of the velocity limits: any v, and a change of v that needs q to confirm
# it; half or double: no fault of the table differs
_CLEAR = 0.01  # [rad/s, or of the reach for slides] at which a joint moves; half: noise moves it,
# double: an encoder that freezes at such a speed is not found
_SLOW, _NEAR = 1e-3, 1e-4  # [1/s] and share, of a radian or the reach, of an arm that rests; half:
# friction keeps estimates moving, double: slow paths stop them
_NOISE = 4.0  # standard deviations of an arm that rests; half: noise moves it in seconds
_FRAME, _UNEXPLAINED = 0.02, 0.25  # of the reach, by which a frame may be off, and by a radian;
# half: learning trips it, double: a marker that jumps by less passes
_FAR_BASE = 20.0  # of the reach: x from x_hat in unknown axes; millimetres are 1000 times off
_TURNED = math.radians(30.0)  # of a measured orientation against the model's; a wrong order of the
# quaternion's numbers is farther off
_RECENT = 0.02  # [s] in which turns are remembered; half: late frames trip it, double: jumps pass
_STRONGER = 3.0  # than a motor can be; half: gears with overload trip it, double: units pass
_DIFFERENCED = 100.0  # [1/s] bandwidth of a velocity from differences of q; half: ``safe`` brakes
# late, double: counts of an encoder shake it
_REACTION = 0.5  # of the push that a joint gives to the others if it stops at once: the middle
# between a joint that stops and an encoder that does
_BEYOND, _BEYOND_RANGE = 0.18, 0.05  # [rad or m] and of the range, by which real arms stand
# beyond their limits; degrees and millimetres are farther
_MOST = 8.0 * math.pi  # [rad or m] of joints without limits
_BEGUN = 1e-12  # [s] since now
_NOTHING, _NO_COLUMNS = np.zeros(0), np.zeros((0, 0))
_PERFECT = SensorQuality()
_NO_Q, _NO_V = 1, 2  # what is not used of a joint
_SWITCH = "limits=pa.Limits(guards={{'{}': False}}) switches this check off."


_FLAWS = {
    kernels.JUMP: ("q", "has jumped", "a wrap at +-pi, a lost count, degrees?", "differences"),
    kernels.SPIKE: ("v", "is implausible", "in degrees?", "differences"),
    kernels.STOPPED: ("q", "is stuck, against its motor", "the encoder stopped?", "differences"),
    kernels.APART: ("v", "is not the rate of q", "the wrong sign, unit or joint?", "differences"),
    kernels.OUT: ("q", "is out of range", "in degrees, millimetres or another order?", "limits"),
}  # by what is wrong with a joint: channel, flaw, guess and guard


@dataclass(frozen=True, eq=False)
class Guards:
    """Bounds of plausible measurements, of one sample and of its way from the one before.

    What a sample is compared with, and by which formulas, is in the kernels ``check_joints`` and
    ``check_frame``. What does not follow is replaced: q by the integral of v, v by the rate of q, a
    frame or a torque by none.

    Attributes:
        bounds: (6, n) largest |v| [rad/s or m/s]; tol [rad or m]; the largest change of v in a
            sample; lowest and highest q; v at which a joint moves.
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
        first: the torque against the momentum, in the first samples; None: it is not compared.
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

    def trail(self, v: np.ndarray) -> np.ndarray:
        """Return what is kept of the first sample, with its joint velocity v (n) [rad/s or m/s]."""
        if not self.follows:
            return _NOTHING
        trail = np.zeros(kernels.TRAIL + kernels.TRAIL_ROWS * v.size)
        row(trail, kernels.RATE)[:] = v
        row(trail, kernels.RAW)[:], row(trail, kernels.TORQUE)[:] = np.nan, np.nan
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
        longest = max(LATEST * period, _PAUSE)
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
            if (trail[kernels.STALE] + 1.0) * min(dt, period) > LASTS:
                raise ImplausibleError(
                    "t", now, f"has been the same for {trail[kernels.STALE] + 2.0:.0f} samples"
                )
            return 0.0
        if elapsed > longest:
            raise _unfit(elapsed, longest)
        return elapsed if elapsed > _MISSED * dt else dt

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

    def stopped(
        self, q: np.ndarray, before: SensedState, v: np.ndarray, dt: float, noise: float, model: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what is wrong with each joint (n) by all channels, and the trail with the sample.

        Kinematics cannot tell a joint that stands from an encoder that does; the momentum can. A
        joint that stops at once pushes the others, M_rr dv_r = M_ri v_i. If that would be seen and
        was not, the joint is doubted until it moves; and if the motors would have moved it since,
        by the change of its torque over its inertia, its encoder is stuck.

        Args:
            q: (nq) of the sample.
            before: what was known at the sample before.
            v: (n) of the sample [rad/s or m/s].
            dt: since then [s].
            noise: standard deviation of v.
            model: of the robot.
        """
        trail = before.trail
        kinds, after, _ = self.judge(q, before.q, v, dt, trail)
        stopped = kinds == kernels.STOPPED
        kinds[stopped] = kernels.FOLLOWS
        if not (trail.size and (stopped.any() or after[kernels.DOUBT])):
            return kinds, after
        M, rate = pin.crba(model, model.createData(), before.q), row(trail, kernels.RATE)
        torque, held = row(trail, kernels.TORQUE), row(after, kernels.AGAINST)
        for i in np.flatnonzero(stopped).tolist():
            others = np.arange(v.size) != i
            push = M[others, i] * rate[i]
            expected = np.linalg.solve(M[np.ix_(others, others)], push)
            seen = (v - rate)[others] @ push
            visible = np.linalg.norm(expected) > _CERTAIN * noise + self.bounds[kernels.CLEAR, i]
            if visible and seen < _REACTION * (expected @ push):
                held[i] = torque[i]
        held[row(after, kernels.STILL_Q) == 0.0] = 0.0
        doubted = held != 0.0
        gained, pushed = row(after, kernels.GAINED), row(after, kernels.PUSHED)
        gained[:] = np.where(doubted, gained + dt * (torque - held) / np.diag(M), 0.0)
        pushed[:] = np.where(doubted, pushed + dt * gained, 0.0)
        after[kernels.DOUBT] = float(doubted.any())
        kinds[np.abs(pushed) > self.bounds[kernels.TOLERANCE]] = kernels.STOPPED
        if not kinds.any():
            after[kernels.BAD] = 0.0
        return kinds, after

    def implausible(
        self, kinds: np.ndarray, sample: Measurement, trail: np.ndarray, way: np.ndarray, model: Any
    ) -> ImplausibleError:
        """Return the error for the first joint with which something is wrong.

        Args:
            kinds: (n) what is wrong with each joint.
            sample: as it was measured.
            trail: with the sample; empty if it is compared with none.
            way: (n) since the sample before [rad or m].
            model: of the robot.
        """
        i = int(np.flatnonzero(kinds)[0])
        joint, bounds, row_i = model.joints[i + 1], self.bounds[:, i], trail[kernels.TRAIL :]
        row_i = row_i[i * kernels.TRAIL_ROWS : (i + 1) * kernels.TRAIL_ROWS]
        channel, flaw, guess, switch = _FLAWS[int(kinds[i])]
        residual, bound = float(way[i]), float(bounds[kernels.TOLERANCE])
        if kinds[i] == kernels.OUT:
            residual = float(sample.q[self.places[i]])
            bound = float(bounds[kernels.LOWEST if residual < 0.0 else kernels.HIGHEST])
            if joint.nq == 2:
                flaw, guess = "does not hold the cosine and the sine of an angle", ""
        elif kinds[i] == kernels.SPIKE:
            residual, bound = float(sample.v[i]), float(bounds[kernels.LEAP])
        elif kinds[i] != kernels.JUMP:
            residual = float(row_i[kernels.RESIDUAL])
            still = (("q", kernels.STILL_Q), ("v", kernels.STILL_V))
            stuck = " and ".join(name for name, each in still if row_i[each] > LASTS)
            guess = f"{stuck} stuck?" if stuck and kinds[i] == kernels.APART else guess
        unit = "m" if is_slide(joint) else "rad"
        words = f"{flaw}: joint '{model.names[i + 1]}', {residual:.3g} {unit}"
        words += (
            f"{'/s' if channel == 'v' and kinds[i] == kernels.SPIKE else ''} beyond {bound:.3g}"
        )
        hint = f"v is dq/dt, in rad/s and m/s. {_SWITCH.format(switch)}"
        return ImplausibleError(channel, getattr(sample, channel), words, guess, hint)

    def check_start(self, sample: Measurement, kinematics: TaskKinematics) -> None:
        """Refuse a first sample at which the robot cannot be, with kinematics updated to it.

        Raises:
            ImplausibleError: q is out of the joint limits, or x is not where the model has it.
        """
        _, q, v, x, *_ = sample
        kinds, *_ = self.judge(q, q, v, math.inf, self.trail(v))
        if kinds.any():
            raise self.implausible(kinds, sample, _NOTHING, 0.0 * v, kinematics.robot.model)
        if x is None or not kinematics.positions:
            return
        hint = "Give x in metres, quaternions as xyzw, in the axes and from the origin of the "
        hint += "robot's base; if that is unknown, take unknown=pa.Unknown(base=True). "
        hint += _SWITCH.format("position")
        if kernels.check_frame(x, kinematics.p_hat, self.numbers, _NOTHING):
            off = np.linalg.norm(kinematics.p_hat - x[: kinematics.positions])
            words = f"is implausible: {off:.3g} m from where the model has the frame at this q, "
            words += f"more than the {self.numbers[kernels.FARTHEST]:.3g} m that what is unknown "
            words += "can explain"
            guess = "in millimetres? another frame or origin? q in another order?"
            raise ImplausibleError("x", x, words, guess, hint)
        turned = kinematics.calibrated and kinematics.task.size > kinematics.positions
        if turned and np.isfinite(self.numbers[kernels.FLOOR]):
            angle = float(np.linalg.norm(kinematics.task.error(x, kinematics.x_hat)[3:]))
            if angle > _TURNED:
                words = f"is implausible: turned by {math.degrees(angle):.0f} degrees from the "
                words += "model's orientation at this q"
                raise ImplausibleError("x", x, words, "in the order wxyz? other axes?", hint)


def row(trail: np.ndarray, which: int) -> np.ndarray:
    """Return one number a joint (n) of a trail, as a view."""
    return trail[kernels.TRAIL + which :: kernels.TRAIL_ROWS]


def _unfit(dt: Any, longest: float) -> InputError:
    """Return the error of a dt [s] that one step cannot bridge."""
    made = f" and at most {longest:g} s" if math.isfinite(longest) else ""
    return InputError(
        f"must be positive{made}, got {dt!r}.",
        where="dt",
        hint="After a longer pause start anew with `init`, from the last estimates.",
    )


Read: TypeAlias = tuple[SensedState, bool, Measurement]


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
            ImplausibleError: this robot cannot be there.
        """
        _, q, v, x, *_ = measurement
        guards = self.guards
        if guards.follows:
            kinematics.update(a_k, q, v)
            guards.check_start(measurement, kinematics)
        if not kinematics.positions:  # a joint task
            x = kinematics.task.measured(None, q)
        return SensedState(
            q.copy(),
            v.copy(),
            None if x is None else x.copy(),
            first=None if guards.first is None else guards.first.init(),
            trail=guards.trail(v),
        )

    def read(
        self,
        before: SensedState,
        t_before: float,
        measurement: Measurement,
        kinematics: TaskKinematics,
        a_k: np.ndarray,
        since: float | None,
        position_error: bool = True,
    ) -> Read:
        """Return what is known at a sample, whether its joints rest, and the sample.

        The kinematics are updated to the sample, which is returned with what was bridged replaced.
        What is known shares no memory with it.

        Args:
            before: what was known at the sample before.
            t_before: the time of that one [s].
            measurement: the sample.
            kinematics: the estimated ones.
            a_k: (p_k) their estimate [m].
            since: time since the sample before [s]; None if the sample does not follow it and is
                only looked at.
            position_error: whether the prediction error of the position is used.

        Raises:
            ImplausibleError: what the guards refuse, the last frame of the camera is too old, or
                what the first samples show is impossible.
            MeasurementError: a frame was taken later than the sample.
        """
        guards, first, model = self.guards, before.first, kinematics.robot.model
        trail, dt = (_NOTHING, 0.0) if since is None else (before.trail, since)
        _, after, answer = guards.judge(measurement.q, before.q, measurement.v, dt, trail)
        if answer == 2:
            measurement, after = self._bridged(before._replace(trail=trail), measurement, dt, model)
        if measurement.tau is not None and trail.size:
            measurement = self._checked_torque(measurement, dt, kinematics, after)
        t, q, v, x, x_time, *_, tau, _ = measurement
        if first is not None and since is not None and guards.first is not None:
            mean, sent = 0.5 * (v + row(trail, kernels.RATE)), row(trail, kernels.TORQUE)
            first = guards.first.after(first, q, mean, sent, tau, dt)
        q = q.copy()
        v = v.copy() if self.low_pass is None else self.low_pass.advance(before.v, v, t - t_before)
        kinematics.update(a_k, q, v)
        resting = answer == 1
        if not kinematics.positions:  # a joint task
            x, epsilon, X_k = kinematics.x_hat, kinematics.p_hat, kinematics.X_k
            return SensedState(q, v, x, epsilon, X_k, None, (), first, after), resting, measurement
        late = x_time is not None and x_time != t
        if x is not None and not late and kernels.check_frame(
            x, kinematics.p_hat, guards.numbers, after
        ):  # fmt: skip
            measurement = self._without_frame(measurement, kinematics.p_hat, after)
            x, x_time, late = None, None, False
        if x is None or late or self.compensator.smoothing < math.inf:
            follow = before, t_before, t, q, v
            sensed = self.compensator.update(*follow, x, x_time, kinematics)
            if late and x is not None and after.size and sensed.frame is not before.frame:
                p_hat = sensed.epsilon + x[: kinematics.positions]
                if kernels.check_frame(x, p_hat, guards.numbers, after):
                    measurement = self._without_frame(measurement, p_hat, after)
                    sensed = self.compensator.update(*follow, None, None, kinematics)
            return sensed._replace(first=first, trail=after), resting, measurement
        epsilon, X_k = _NOTHING, _NO_COLUMNS
        if position_error:
            epsilon = kinematics.p_hat - x[: kinematics.positions]
            X_k = kinematics.X_k if kinematics.calibrated else kinematics.explaining(x)
        x = x.copy()
        return SensedState(q, v, x, epsilon, X_k, None, (), first, after), resting, measurement

    def _plausible(
        self,
        before: SensedState,
        q: np.ndarray,
        v: np.ndarray,
        use: tuple[np.ndarray, np.ndarray],
        dt: float,
        decay: float,
        model: pin.Model,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return q (nq) and v (n) joint by joint, as far as they follow from the sample before.

        Both as measured; q and its differences where v does not follow; the integral of v where q
        does not; and the motion of an arm that is damped where neither is used.

        Args:
            before: what was known at the sample before.
            q: (nq) of the sample.
            v: (n) of the sample [rad/s or m/s].
            use: (n) whether that is used of q and of v.
            dt: since the sample before [s].
            decay: rate at which a joint slows of which nothing is used [1/s].
            model: of the robot.

        Returns:
            q and v, what was wrong with each joint (n), what still is (n), and the trail after.
        """
        guards, noise, bridged = self.guards, self.quality.v, (kernels.JUMP, kernels.OUT)
        kinds, after = guards.stopped(q, before, v, dt, noise, model)
        use_q, use_v = use
        use_q = use_q & (~np.isin(kinds, bridged) | ~use_v)
        use_v = use_v & (kinds != kernels.SPIKE)
        if use_q.all() and use_v.all():
            return q, v, kinds, kinds, after
        way, ahead = pin.difference(model, before.q, q), before.v * math.exp(-decay * dt)
        differenced = before.v + (way - dt * before.v) / max(dt, 1.0 / _DIFFERENCED)
        v = np.where(use_v, v, np.where(use_q, differenced, ahead))
        way = np.where(use_q, way, 0.5 * dt * (before.v + v))
        q = pin.integrate(model, before.q, way)
        left, again = guards.stopped(q, before, v, dt, noise, model)
        for each in (kernels.RATE, kernels.RESIDUAL, kernels.WAY, kernels.CHANGE, kernels.SAME):
            row(after, each)[:] = np.where(kinds, row(again, each), row(after, each))
        return q, v, kinds, left, after

    def _bridged(
        self, before: SensedState, sample: Measurement, dt: float, model: pin.Model
    ) -> tuple[Measurement, np.ndarray]:
        """Return a sample with what does not follow as predicted, and the trail with it.

        Raises:
            ImplausibleError: it cannot be bridged, or has lasted.
            MeasurementError: it is not finite.
        """
        for name, value in (("q", sample.q), ("v", sample.v)):
            if not np.isfinite(value).all():
                raise MeasurementError(name, value)
        every = np.ones(model.nv, dtype=bool)
        q, v, kinds, left, after = self._plausible(
            before, sample.q, sample.v, (every, every), dt, 0.0, model
        )
        if not kinds.any():
            return sample, after
        way = pin.difference(model, before.q, sample.q)
        error = self.guards.implausible(kinds, sample, after, way, model)
        if left.any() or not dt <= self.guards.numbers[kernels.LONGEST]:
            raise error
        _count(after, kernels.BAD, kernels.BRIDGED, dt, error)
        return sample._replace(q=q, v=v), after

    def _without_frame(
        self, sample: Measurement, p_hat: np.ndarray, trail: np.ndarray
    ) -> Measurement:
        """Return a sample without its frame, which does not follow, and count it in the trail.

        Raises:
            ImplausibleError: it has lasted, or there is nothing to bridge it with.
        """
        x = sample.x
        assert x is not None
        off = np.linalg.norm(p_hat - x[: p_hat.size])
        seen = trail.size and np.array_equal(
            x[: p_hat.size], trail[kernels.PLACE : kernels.PLACE + p_hat.size]
        )
        words = "has not changed while the joints moved" if seen else "has jumped"
        words += f": {off:.3g} m from where the model has the frame, and more than the motion of "
        words += "the joints and what is unknown explain"
        guess = "another marker, millimetres, a camera or a tool that was moved?"
        guess = "does the camera repeat its last frame?" if seen else guess
        hint = "A tool is announced by `announce(state, tool_translation=...)`. "
        error = ImplausibleError("x", x, words, guess, hint + _SWITCH.format("position"))
        _count(trail, kernels.LOST, kernels.FRAMES, 0.0, error)  # the kernel lets it grow
        return sample._replace(x=None, x_time=None, xd=None)

    def _checked_torque(
        self, sample: Measurement, dt: float, kinematics: TaskKinematics, trail: np.ndarray
    ) -> Measurement:
        """Return a sample without its torque where no motor gives it, and count that in the trail.

        Raises:
            ImplausibleError: it has lasted.
        """
        most, tau = self.guards.torque, np.asarray(sample.tau)
        usable = tau.shape == most.shape and tau.dtype.kind in "fiu"
        if not usable or not (np.abs(tau) > most).any():
            trail[kernels.DEAF] = 0.0
            return sample if usable else sample._replace(tau=None)
        i = int(np.argmax(np.abs(tau) / most))
        words = f"is more than the motors give: {kinematics.joint_names[i]} at most "
        words += f"{most[i] / _STRONGER:.3g} N m or N"
        hint = _SWITCH.format("gravity")
        error = ImplausibleError("tau", tau, words, "in another unit? a damaged message?", hint)
        _count(trail, kernels.DEAF, kernels.TORQUES, dt, error)
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

        As ``_plausible``; and once q and v contradict each other, the one that is not stuck is used
        from then on. The way of each joint since then is in the trail, and for how long it has been
        unseen.

        Args:
            before: what was known, or estimated, at the sample before.
            sample: the sample, which may be refused or not finite; None: there is none.
            dt: since then [s].
            decay: rate at which a damped arm loses its speed [1/s].
            model: of the robot.
            known: whether the sample has the time of the one before, and may be the same.
        """
        trail, places = before.trail, self.guards.places[:-1]
        q = _numbers(None if sample is None else sample.q, model.nq)
        v = _numbers(None if sample is None else sample.v, model.nv)
        use_q, use_v = np.logical_and.reduceat(np.isfinite(q), places), np.isfinite(v)
        if not trail.size:
            trail = np.zeros(kernels.TRAIL + kernels.TRAIL_ROWS * model.nv)
        distrust = row(trail, kernels.DISTRUST).astype(int)
        distrust[row(trail, kernels.AGAINST) != 0.0] = _NO_Q + _NO_V
        use_q, use_v = use_q & (distrust & _NO_Q == 0), use_v & (distrust & _NO_V == 0)
        ahead = pin.integrate(model, before.q, dt * before.v)
        q = np.where(np.isfinite(q), q, ahead)
        v = np.where(np.isfinite(v), v, before.v)
        repeated = known & (q[places] == row(trail, kernels.RAW)) & (v == row(trail, kernels.RATE))
        q, v, kinds, _, after = self._plausible(before, q, v, (use_q, use_v), dt, decay, model)
        if before.trail.size:
            stands = row(after, kernels.STILL_Q) > 3.0 * dt
            apart = np.where(stands, _NO_Q, _NO_V)
            apart[stands & (row(after, kernels.STILL_V) > 3.0 * dt)] = _NO_Q + _NO_V
            apart[kinds == kernels.SPIKE] = _NO_V
            wrong = np.isin(kinds, (kernels.APART, kernels.SPIKE))
            new = wrong & (distrust == 0) & ~repeated
            unseen, way = row(trail, kernels.UNSEEN), pin.difference(model, before.q, q)
            row(after, kernels.DISTRUST)[:] = np.where(new, apart, row(trail, kernels.DISTRUST))
            row(after, kernels.UNSEEN)[:] = np.where(use_q | use_v, 0.0, unseen + dt)
            row(after, kernels.DISPLACED)[:] = row(trail, kernels.DISPLACED) + way
        return before._replace(q=q, v=v, trail=after)

    def remember(self, sensed: SensedState, torque: np.ndarray) -> None:
        """Keep the torque (n) that is held from this sample on, for the momentum."""
        if sensed.trail.size:
            row(sensed.trail, kernels.TORQUE)[:] = torque


def _count(trail: np.ndarray, timer: int, counter: int, dt: float, error: ImplausibleError) -> None:
    """Count a reading that is left out in a trail, or refuse it: it has lasted, or none is kept."""
    if not trail.size:
        raise error
    trail[timer] = trail[timer] + dt if trail[timer] else _BEGUN
    trail[counter] += 1.0
    if trail[timer] > LASTS:
        raise error


def _numbers(given: Any, size: int) -> np.ndarray:
    """Return an array of a size, NaN if it is none."""
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    return array if array.shape == (size,) else np.full(size, np.nan)


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
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    lengths = np.where(slides, min(1.0, size), 1.0)
    found = Guards.none(n)
    bounds, numbers, torque = found.bounds, found.numbers, found.torque
    fast, counts = velocity_limits(model), np.broadcast_to(np.asarray(sensors.encoder, float), n)
    if on["velocity"]:
        bounds[kernels.FASTEST] = _FAST * fast
    if on["differences"]:
        noise = sensors.deviation("q") + sensors.deviation("v") * math.sqrt(dt * kernels.MEMORY)
        bounds[kernels.TOLERANCE] = _WAY * lengths + 2.0 * counts + _CERTAIN * noise
        bounds[kernels.LEAP] = _LEAP * fast + 2.0 * _CERTAIN * quality.v
        bounds[kernels.CLEAR] = _CLEAR * lengths + _CERTAIN * sensors.deviation("v")
    if on["limits"]:
        low, high = position_limits(model)
        low, high = np.where(np.isfinite([low, high]), [low, high], [[-_MOST], [_MOST]])
        margin = _BEYOND + _BEYOND_RANGE * (high - low)
        bounds[kernels.LOWEST], bounds[kernels.HIGHEST] = low - margin, high + margin
    if on["rest"]:
        numbers[kernels.SLOW] = (
            _SLOW * (min(1.0, size) if slides.any() else 1.0) + _NOISE * quality.v
        )
    numbers[kernels.LONGEST] = max(LATEST * dt, _PAUSE) + 0.5 * dt
    numbers[kernels.RECENTLY] = _RECENT + 3.0 * quality.age
    if on["position"] and kinematics.positions:
        numbers[kernels.FARTHEST] = _FAR_BASE * size
    if on["position"] and kinematics.positions and kinematics.calibrated:
        span = np.zeros(0) if box is None else box[1] - box[0]
        off, first = [0.0, 0.0], 0  # by the base, and by the others
        for part in kinematics.translations:
            inside = np.linalg.norm(span[first : first + part.size])
            off[part.joint != FIRST] += float(np.linalg.norm(part.directions, 2) * inside)
            first += part.size
        numbers[kernels.FLOOR] = _FRAME * size + 2.0 * _CERTAIN * quality.x
        numbers[kernels.UNKNOWN] = _UNEXPLAINED * size + 0.5 * off[1]
        numbers[kernels.FARTHEST] = _UNEXPLAINED * size + sum(off) + _CERTAIN * quality.x
    if on["gravity"]:
        deviation = np.broadcast_to(np.asarray(sensors.noise.get("tau", 0.0), float), n)
        torque = _STRONGER * effort_limits(model) + _CERTAIN * deviation
    return Guards(
        bounds=bounds,
        places=np.array([joint.idx_q for joint in model.joints[1:]] + [model.nq], dtype=np.int64),
        numbers=numbers,
        torque=torque,
        clock=on["time"],
        near=_NEAR * (size if kinematics.positions else 1.0) + _NOISE * quality.x,
        follows=any(on[name] for name in GUARDS if name != "rest"),
        first=make_first_samples(robot, unloaded, sensors, compensation, dt)
        if on["gravity"]
        else None,
    )
