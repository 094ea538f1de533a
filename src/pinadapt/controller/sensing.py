"""From a sample to what the law uses: plausibility, filtered velocity, present position.

Each channel has a residual (q against the integral of v, x against what explains all frames, the
motion against the momentum, a measured torque against the one sent) and a bound from the noise of
the declared sensors and from what is unknown. A sample beyond it is bridged by what was predicted,
and counted; one that lasts is refused, and so is a sum of residuals beyond its bound.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import samples as kernels
from ..description.chain import effort_limits, is_slide, position_limits, velocity_limits
from ..exceptions import ImplausibleError, InputError, MeasurementError
from ..filters import LowPass
from ..models.delay_compensation import DelayCompensator, Explained, SensedState
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement, SensorQuality, Sensors
from ..robot.motors import Compensation
from ..robot.robot import Robot
from .first_samples import CERTAIN, FirstSamples, make_first_samples

GUARDS = ("position", "velocity", "time", "rest", "limits", "differences", "gravity")
LASTS = 0.0149  # [s] after which what does not follow is refused; half: fewer lost messages are
# bridged, double: a wrong q or x moves the arm for twice as long
LATEST, _PAUSE = 10.0, 0.01  # periods, and [s] that one step may bridge, whichever is longer;
# half: more pauses end a run, double: the estimates take longer steps
_WAY = 5e-3  # [rad, or of the reach for slides] by which sums of v and of dq may differ; half: a v
# off by 0.02 rad/s is refused, double: a wrong v moves the arm twice as far
_BRAKED = 20.0  # [rad/s^2, or of the reach for slides] by which friction stops a joint; half: such
# a stop is refused, double: an encoder that freezes at slow speed is not found
_SLOW, _NEAR = 1e-3, 1e-4  # [1/s] and share, of a radian or the reach, of an arm that rests; half:
# friction keeps estimates moving, double: slow paths stop them
# Of the reach, by which a frame, and all of them, may be off. Half and twice: an x that freezes on
# a Panda is refused after 76 and 234 ms in place of 133, and 117 and 472; with half of the first,
# cameras with 4 mm of noise that is not declared are.
_FRAME, _OFFSET = 0.02, 0.1
_MOVING = 1.0 / 3.0  # of the residual that M dv/dt has: 1 / 2 of a wrong sign, 0 of a held joint
_STRONGER = 3.0  # than a motor can be; half: gears with overload trip it, double: units pass
_BEYOND = 0.18  # [rad or m] by which real arms stand beyond their limits; degrees are farther
_AWRY = math.radians(30.0)  # of the first orientation; another order of a quaternion is farther
_FLAWS = {
    kernels.JUMP: ("q", "has jumped", "a wrap at +-pi, a lost count, degrees?", "differences"),
    kernels.SPIKE: ("v", "is implausible", "in degrees?", "differences"),
    kernels.APART: ("v", "is not the rate of q", "the wrong sign, unit or joint?", "differences"),
    kernels.STOPPED: ("q", "is stuck", "has the encoder stopped?", "differences"),
    kernels.OUT: ("q", "is out of range", "in degrees, millimetres or another order?", "limits"),
    kernels.TURNED: ("x", "is turned", "in the order wxyz? other axes?", "position"),
    kernels.MOVED: (
        "x",
        "does not move with the joints",
        "in millimetres, repeated, in other axes? another frame, marker, tool? an encoder off?",
        "position",
    ),
    kernels.STRONG: ("tau", "is more than the motors give", "in another unit?", "gravity"),
    kernels.OTHER: ("tau", "is not what was sent", "the wrong sign, unit or joint?", "gravity"),
    kernels.AGAINST: (
        "v",
        "shows more torque beside the motors than they have",
        "a motor or encoder of the wrong sign, two joints swapped, a collision?",
        "gravity",
    ),
}  # signal, flaw, guess and guard
_CHANNELS = {"q": kernels.JOINTS, "v": kernels.JOINTS, "x": kernels.FRAME, "tau": kernels.TORQUE}


@dataclass(frozen=True, eq=False)
class FrameFit:
    """Whether x moves with the joints: what explains all frames so far explains the next one.

    The prediction error e of the estimate at the start is X da + o, with the error da of the
    unknown translations and an offset o of x, both of known covariance, and what else may be off.
    Least squares over the frames, which forget over a radian of the joints, leaves the residual
    r = e - X da - o of covariance S. It is too large where r^T S^-1 r > 25. Mirrored, turned or
    repeated frames, encoders that are off, and jumps are explained by no translation.

    Attributes:
        start: (p) the estimate at the start [m].
        prior: (p + m_p, p + m_p) inverse covariance of da and o [1/m^2].
        deviation: of a frame [m].
    """

    start: np.ndarray
    prior: np.ndarray
    deviation: float

    def after(
        self,
        fit: Explained | None,
        X: np.ndarray,
        a_k: np.ndarray,
        error: np.ndarray,
        trail: np.ndarray,
    ) -> tuple[float, float, Explained | None]:
        """Return the size of r, its bound [m], and the fit with a frame that is within it.

        Args:
            fit: to the frames before; None: there was none.
            X: (m_p, p) regressor of the frame.
            a_k: (p) the estimate [m].
            error: (m_p) the prediction error of that [m].
            trail: of the samples, in which the way of the joints begins anew with each new fit.
        """
        n, moved = len(self.prior), math.inf if fit is None else trail[kernels.SINCE]
        bound, near = CERTAIN * self.deviation, moved <= _FRAME
        if near and error.dot(error) < bound**2:  # the estimate explains the frame, too
            return 0.0, bound, fit
        value, sums = fit or (np.zeros(n), np.zeros((n, n + 1)))
        error = error - X.dot(a_k - self.start)
        r = error - X.dot(value[: a_k.size]) - value[a_k.size :]
        size = math.hypot(*r)
        if near and size < bound:
            return size, bound, fit
        if not math.isfinite(size):
            return size, bound, fit
        X, way = np.hstack([X, np.eye(r.size)]), r / max(size, bound)
        S = X @ np.linalg.solve(self.prior + sums[:, :-1], X.T)
        S += self.deviation**2 * np.eye(r.size)
        share = max(size, bound) * math.sqrt(way @ np.linalg.solve(S, way)) / CERTAIN
        if share > 1.0:
            return size, size / share, fit
        if not near:
            rows = np.column_stack([X, error]) / self.deviation
            sums = math.exp(-moved) * sums + rows[:, :-1].T @ rows
            fit = Explained(np.linalg.solve(self.prior + sums[:, :-1], sums[:, -1]), sums)
            trail[kernels.SINCE] = 0.0
        return size, math.inf, fit


@dataclass(frozen=True, eq=False)
class Guards:
    """Bounds of plausible measurements, see the kernel ``check_joints``.

    Attributes:
        model: of the robot.
        bounds: (7, n) largest |v| [rad/s or m/s]; tol [rad or m]; the largest change of v in a
            sample; v at which a joint moves; |v| below which an arm may be resting; lowest and
            highest q of the first sample.
        places: (n + 1) where each joint begins in q, and the end.
        torque: (n) that no motor gives [N m or N].
        farthest: largest distance of x in unknown axes from x_hat [m].
        frames: what may explain x in known axes; None: it is not compared.
        momentum: whether the residual of the torque is compared with the torque limits.
        clock: whether times must go forward, and the period is the time since the last sample
            where one was dropped.
        near: errors below which an arm may be resting [m or rad].
        first: the torque against the momentum, in the first samples; None: it is not compared.
    """

    model: pin.Model
    bounds: np.ndarray
    places: np.ndarray
    torque: np.ndarray
    farthest: float = math.inf
    frames: FrameFit | None = None
    momentum: bool = False
    clock: bool = False
    near: float = 0.0
    first: FirstSamples | None = None

    @classmethod
    def none(cls, model: pin.Model) -> Guards:
        """Return guards that accept everything."""
        bounds = np.full((kernels.HIGHEST + 1, model.nv), np.inf)
        bounds[kernels.SLOW], bounds[kernels.LOWEST] = 0.0, -np.inf
        places = np.array([joint.idx_q for joint in model.joints[1:]] + [model.nq], dtype=np.int64)
        return cls(model, bounds, places, np.full(model.nv, np.inf))

    def elapsed(
        self, before: float, now: float, dt: float, period: float, trail: np.ndarray
    ) -> float:
        """Return the time [s] that a sample at time ``now`` stands for.

        dt, or the time since the sample before where others were dropped in between, or none where
        that sample had the same time.

        Raises:
            ImplausibleError: the time goes back, or stands still for too long.
            InputError: the period is not positive, or longer than one step may bridge.
        """
        longest = max(LATEST * period, _PAUSE)
        elapsed = now - before if self.clock else dt
        try:
            fits = 0.0 < dt <= longest and elapsed <= longest
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise InputError(
                f"must be positive and at most {longest:g} s, got {dt!r} and {elapsed!r}.",
                where="dt",
                hint="After a longer pause start anew with `init`, from the last estimates.",
            )
        if elapsed < 0.0:
            raise ImplausibleError("t", now, f"is before the last sample's, {before:g} s")
        if elapsed == 0.0 and trail[kernels.STEPPED]:
            stood = trail[kernels.BRIDGED + kernels.TIME]
            if (stood + 1.0) * min(dt, period) > LASTS:
                raise ImplausibleError("t", now, f"has been the same for {stood + 2.0:.0f} samples")
            return 0.0
        return elapsed if elapsed > 1.5 * dt else dt  # one was dropped: between one and two


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
    quality: SensorQuality = field(default_factory=SensorQuality)
    sensors: Sensors = field(default_factory=Sensors)

    def init(
        self, measurement: Measurement, kinematics: TaskKinematics, a_k: np.ndarray
    ) -> SensedState:
        """Return what is kept of the first sample, with the kinematic estimate a_k (p) [m].

        Raises:
            ImplausibleError: this robot cannot be there.
        """
        guards, trail = self.guards, new_trail(measurement.v)
        measurement = measurement._replace(x_time=None)
        before = SensedState(measurement.q, measurement.v, trail=trail)
        given = before, measurement.t, measurement, kinematics, a_k, math.inf
        sensed, x = self.read(*given)[0], measurement.x
        if guards.frames is not None and x is not None:
            error = kinematics.task.error(x, kinematics.x_hat)[kinematics.positions :]
            turn = float(np.linalg.norm(error))
            if turn > _AWRY:
                self._bridge(kernels.TURNED, measurement, turn, _AWRY, trail.copy())
        first = None if guards.first is None else guards.first.init()
        return sensed._replace(first=first, trail=trail)

    def read(
        self,
        before: SensedState,
        t_before: float,
        measurement: Measurement,
        kinematics: TaskKinematics,
        a_k: np.ndarray,
        dt: float,
        sent: np.ndarray | None = None,
    ) -> tuple[SensedState, bool, Measurement]:
        """Return what is known at a sample, whether its joints rest, and the sample.

        The estimated kinematics are updated to the sample, which is returned without the frame and
        the torque that were bridged. What is known shares no memory with it. ``before`` and
        ``t_before`` [s] are of the sample before; dt is the time since then [s], infinite if the
        sample does not follow it; the estimate a_k is (p_k) [m]; ``sent`` (n) is the torque of the
        last period [N m or N].

        Raises:
            ImplausibleError: what the guards refuse, the last frame of the camera is too old, or
                what the first samples show is impossible.
            MeasurementError: a frame was taken later than the sample, or q or v is not finite.
        """
        first, fit = before.first, before.fit
        answer, q, v, trail = self._judged(before, measurement.q, measurement.v, dt)
        if answer == 2:
            self._bridged(measurement, trail, dt)
        if measurement.tau is not None and dt < math.inf:
            measurement = self._checked_torque(measurement, trail, dt, sent)
        if first is not None and self.guards.first is not None and dt < math.inf:
            mean = 0.5 * (v + row(before.trail, kernels.RATE))
            first = self.guards.first.after(first, q, mean, dt)
        t, _, _, x, x_time, *_ = measurement
        if self.low_pass is not None:
            v = self.low_pass.advance(before.v, v, t - t_before)
        kinematics.update(a_k, q, v)
        resting, late = answer == 1, x_time is not None and x_time != t
        if not kinematics.positions:  # x follows from q
            x, late = kinematics.x_hat, False
        follow = before, t_before, t, q, v
        sensed = self.compensator.update(*follow, x, x_time if late else None, kinematics)
        if kinematics.positions and x is not None:
            if not late or sensed.frame is not before.frame:
                given = sensed.epsilon, sensed.X_k, a_k, fit, trail, dt
                measurement, fit = self._checked_frame(measurement, *given)
            if measurement.x is None:
                sensed = self.compensator.update(*follow, None, None, kinematics)
        return SensedState(*sensed[:-3], first, trail, fit), resting, measurement

    def _judged(
        self, before: SensedState, q: np.ndarray, v: np.ndarray, dt: float, decay: float = 0.0
    ) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Return the answer of ``check_joints``, q (nq), v (n) as they are used, and the trail."""
        if dt == math.inf:  # it is compared with none
            before, dt = SensedState(q, v, trail=new_trail(v)), 0.0
        guards, trail = self.guards, empty(before.trail.size)
        q_used, v_used = empty(q.size), empty(v.size)
        answer = kernels.check_joints(
            q, before.q, v, dt, decay, guards.bounds, guards.places, before.trail, trail, q_used,
            v_used,
        )  # fmt: skip
        if answer != 2 or not (doubted := self._doubted(before, v, trail)).any():
            return answer, q_used, v_used, trail
        kept = before.trail.copy()
        row(kept, kernels.DISTRUST)[doubted] = kernels.NO_Q + kernels.NO_V
        return self._judged(before._replace(trail=kept), q, v, dt, decay)

    def _doubted(self, before: SensedState, v: np.ndarray, trail: np.ndarray) -> np.ndarray:
        """Return which joints (n) have stopped, and the others do not show it.

        Kinematics cannot tell a joint that stands from an encoder that does; the momentum can. A
        joint that stops at once pushes the others, M_rr dv_r = M_ri v_i. If that would be seen and
        less than half of it was, nothing of the joint is used until it moves.
        """
        doubted = row(trail, kernels.KIND) == kernels.STOPPED
        doubted &= (row(before.trail, kernels.DISTRUST) == 0.0) & v.any()  # not if all stop
        model = self.guards.model
        for i in np.flatnonzero(doubted).tolist():
            M, rate = pin.crba(model, model.createData(), before.q), row(before.trail, kernels.RATE)
            push, change = np.linalg.inv(M)[i], v - rate
            push *= -rate[i] / push[i]
            push[i] = change[i] = 0.0
            least = 2.0 * self.guards.bounds[kernels.CLEAR, i]
            doubted[i] = np.linalg.norm(push) > least and push @ M @ (change - 0.5 * push) < 0.0
        return doubted

    def _bridged(self, sample: Measurement, trail: np.ndarray, dt: float) -> None:
        """Count a sample of which something was replaced.

        Raises:
            ImplausibleError: something has not followed for too long.
            MeasurementError: q or v is not finite.
        """
        for name, value in (("q", sample.q), ("v", sample.v)):
            if not np.isfinite(value).all():
                raise MeasurementError(name, value)
        kinds, distrust = row(trail, kernels.KIND), row(trail, kernels.DISTRUST)
        wrong = (kinds != kernels.FOLLOWS) & (kinds != kernels.STOPPED) | (distrust != 0.0)
        apart = (kinds == kernels.APART).any()  # a sum has lasted when it is beyond its bound
        if not wrong.any():
            trail[kernels.BRIDGED + kernels.JOINTS] = 0.0
            return
        i = int(np.argmax(wrong))
        size, bound = row(trail, kernels.SIZE)[i], row(trail, kernels.BOUND)[i]
        self._bridge(int(kinds[i]), sample, size, bound, trail, math.inf if apart else dt, i)

    def _checked_torque(
        self, sample: Measurement, trail: np.ndarray, dt: float, sent: np.ndarray | None
    ) -> Measurement:
        """Return a sample without its torque where no motor gives it, and count that in the trail.

        Where the offset of the torque sensor is declared, the torque may also be off by offset,
        noise and the whole of what was sent, as of a motor that gives none, but not by more.

        Raises:
            ImplausibleError: it has lasted.
        """
        most, tau, flaw = self.guards.torque, np.asarray(sample.tau), kernels.STRONG
        if tau.shape != most.shape or tau.dtype.kind not in "fiu":
            return sample._replace(tau=None)
        if sent is not None and self.quality.tau and sent.any():
            tau, flaw = tau - sent, kernels.OTHER
            most = np.minimum(most, np.abs(sent) + CERTAIN * self.quality.tau)
        i = int(np.argmax(np.abs(tau) / most))
        if not abs(tau[i]) > most[i]:
            trail[kernels.BRIDGED + kernels.TORQUE] = 0.0
            return sample
        self._bridge(flaw, sample, tau[i], most[i], trail, dt, i)
        return sample._replace(tau=None)

    def check_momentum(
        self,
        sample: Measurement,
        residual: np.ndarray,
        torque: np.ndarray,
        limits: np.ndarray,
        trail: np.ndarray,
    ) -> None:
        """Refuse a motion that shows more torque beside the motors than they have.

        A joint whose sign is wrong accelerates against its torque, which rises to its limit: half
        of the residual is then M dv/dt. Of a joint that is held none is, whatever its motor does.

        Args:
            sample: what was measured.
            residual: (n) low-passed torque that the motion of the model needs, less the one that
                was sent [N m or N].
            torque: (n) that was sent, low-passed [N m or N].
            limits: (n) of the torque [N m or N].
            trail: of the sample.

        Raises:
            ImplausibleError: it does.
        """
        if not (self.guards.momentum and kernels.exceeds(residual, limits)):
            return
        model = self.guards.model
        gravity = pin.computeGeneralizedGravity(model, model.createData(), sample.q)
        moving = np.abs(residual) > limits
        moving &= (residual + torque - gravity) * residual > _MOVING * residual**2
        if moving.any():
            i = int(np.argmax(moving))
            self._bridge(kernels.AGAINST, sample, residual[i], limits[i], trail, joint=i)

    def _bridge(
        self,
        flaw: int,
        sample: Measurement,
        residual: float,
        bound: float,
        trail: np.ndarray,
        dt: float = math.inf,
        joint: int | None = None,
    ) -> None:
        """Count a bridged sample of a channel, and refuse what lasts; a frame grows in the kernel.

        Raises:
            ImplausibleError: with the residual and its bound.
        """
        name, words, guess, guard = _FLAWS[flaw]
        channel = kernels.BRIDGED + _CHANNELS[name]
        trail[_CHANNELS[name]] += 1.0
        trail[channel] = trail[channel] + dt if trail[channel] or dt == math.inf else 1e-12
        if trail[channel] > LASTS:
            where = f"against the model, [{'rad' if flaw == kernels.TURNED else 'm'}]"
            if joint is not None:
                where = f"joint '{self.guards.model.names[joint + 1]}',"
            words = f"{words}: {where} {residual:.3g} beyond {bound:.3g}"
            hint = f"limits=pa.Limits(guards={{'{guard}': False}}) switches this check off."
            if name == "x":
                unknown = "If the base's axes or origin are unknown: unknown=pa.Unknown(base=True)."
                hint = f"{unknown} {hint}"
            raise ImplausibleError(name, getattr(sample, name), words, guess, hint)

    def _checked_frame(
        self,
        sample: Measurement,
        error: np.ndarray,
        X_k: np.ndarray,
        a_k: np.ndarray,
        fit: Explained | None,
        trail: np.ndarray,
        dt: float,
    ) -> tuple[Measurement, Explained | None]:
        """Return a sample without a frame that does not follow, counted in the trail, and the fit.

        The prediction error (m_p) [m] is that of the estimate a_k (p) when the frame was taken, and
        X_k (m_p, p) its regressor.

        Raises:
            ImplausibleError: it has lasted, or there is nothing to bridge it with.
        """
        frames = self.guards.frames
        if frames is None:
            size, bound = float(np.linalg.norm(error)), self.guards.farthest
        else:
            size, bound, fit = frames.after(fit, X_k, a_k, error, trail)
        if size > bound:
            since = 0.0 if dt < math.inf else dt
            self._bridge(kernels.MOVED, sample, size, bound, trail, since)
            return sample._replace(x=None, x_time=None, xd=None), fit
        trail[kernels.BRIDGED + kernels.FRAME] = 0.0
        return sample, fit

    def believed(
        self, before: SensedState, sample: Measurement | None, dt: float, decay: float
    ) -> SensedState:
        """Return the plausible q and v at a sample, whatever is wrong with it; None: there is none.

        The way of each joint since the first such sample is in the trail, and for how long nothing
        of it was used. Without either, the velocity decays at a rate [1/s].
        """
        q = _numbers(None if sample is None else sample.q, before.q.size)
        v = _numbers(None if sample is None else sample.v, before.v.size)
        _, q, v, trail = self._judged(before, q, v, dt, decay)
        return before._replace(q=q, v=v, trail=trail)


def new_trail(v: np.ndarray) -> np.ndarray:
    """Return what is kept of the first sample, with its joint velocity v (n) [rad/s or m/s]."""
    trail = np.zeros(kernels.TRAIL + kernels.ROWS * v.size)
    row(trail, kernels.RATE)[:] = row(trail, kernels.RAW_V)[:] = v
    row(trail, kernels.RAW_Q)[:] = np.nan
    return trail


def row(trail: np.ndarray, which: int) -> np.ndarray:
    """Return one number a joint (n) of a trail, as a view."""
    return trail[kernels.TRAIL + which :: kernels.ROWS]


def _numbers(given: Any, size: int) -> np.ndarray:
    """Return an array of a size, NaN if it is none."""
    try:
        return np.asarray(given, dtype=float).reshape(size)
    except (TypeError, ValueError):
        return np.full(size, np.nan)


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
    """Return the guards of a controller with a period dt [s], for a robot and one without its load.

    ``guards`` is False for none, or some of ``GUARDS`` with False; the box (2, p) is that of the
    kinematic estimates [m]; the compensation is what the arm is declared to add to the command.
    """
    on = dict.fromkeys(GUARDS, guards is not False)
    on |= guards if isinstance(guards, Mapping) else {}
    model, size, guard = robot.model, robot.reach, Guards.none(robot.model)
    bounds, torque, m = guard.bounds, guard.torque, kinematics.positions
    farthest, frames, first = math.inf, None, None
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    lengths, fast = np.where(slides, min(1.0, size), 1.0), velocity_limits(model)
    if on["velocity"]:
        bounds[kernels.FASTEST] = 10.0 * fast  # half or double: the same faults are found
    if on["differences"]:
        noise = sensors.deviation("q") + sensors.deviation("v") * math.sqrt(dt * kernels.MEMORY)
        counts = 2.0 * np.asarray(sensors.encoder, float)
        bounds[kernels.TOLERANCE] = _WAY * lengths + counts + CERTAIN * noise
        bounds[kernels.LEAP] = 0.5 * fast + 2.0 * CERTAIN * quality.v  # half or double: as above
        if not robot.constraints:  # else forces that nobody measures stop joints at once
            bounds[kernels.CLEAR] = _BRAKED * dt * lengths + CERTAIN * quality.v
    if on["limits"]:
        most = 8.0 * math.pi  # [rad or m] of joints without limits
        low, high = np.clip(position_limits(model), -most, most)
        bounds[kernels.LOWEST :] = low - _BEYOND, high + _BEYOND
    if on["rest"]:
        bounds[kernels.SLOW] = _SLOW * lengths + CERTAIN * quality.v
    if on["position"] and m:
        farthest = 20.0 * size  # in unknown axes; millimetres are farther
        if kinematics.calibrated:
            span = np.zeros((2, kinematics.size)) if box is None else box
            off = np.append(0.5 * (span[1] - span[0]), np.full(m, _OFFSET * size))
            scatter = _FRAME * size / CERTAIN + 2.0 * quality.x
            prior = np.diag((CERTAIN / np.maximum(off, scatter)) ** 2)
            frames = FrameFit(kinematics.initial, prior, scatter)
    if on["gravity"]:
        deviation = np.asarray(sensors.noise.get("tau", 0.0), float)
        torque[:] = _STRONGER * effort_limits(model) + CERTAIN * deviation
        if not robot.constraints:
            first = make_first_samples(robot, unloaded, sensors, compensation, dt)
    return replace(
        guard,
        farthest=farthest,
        frames=frames,
        momentum=on["gravity"],
        clock=on["time"],
        near=_NEAR * (size if m else 1.0) + CERTAIN * quality.x,
        first=first,
    )
