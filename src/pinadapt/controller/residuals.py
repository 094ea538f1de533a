"""The residual test: what a sample says against what follows from the samples before it.

Each channel has a residual, and a bound from the noise of the declared sensors and from what is
unknown:

    joints   dq less the integral of v, and its leaky sum          bridged by the other of the two
    frame    x less what explains all frames so far                bridged by no frame
    torque   a measured torque, less the one that was sent         bridged by the one that was sent
    time     none has passed                                       bridged by a step of no duration
    motion   the torque beside the motors that the momentum shows

A sample beyond its bound is bridged and counted; one that lasts is refused, and so are a leaky sum
and a motion beyond theirs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import samples as kernels
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..exceptions import ImplausibleError, MeasurementError
from ..models.delay_compensation import SensedState
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement, SensorQuality, Sensors
from ..robot.robot import Robot
from .first_samples import CERTAIN

LASTS = 0.0149  # [s] after which what does not follow is refused; half: fewer lost messages are
# bridged, double: a wrong q or x moves the arm for twice as long
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
# of the residual that M dv/dt has: 1 / 2 of a wrong sign, 0 of a held joint; half: pushes of an arm
# are taken for a wrong sign, 2 of 90; twice: a wrong sign and swapped joints are not found
_MOVING = 0.33
_STRONGER = 3.0  # than a motor can be; half: gears with overload trip it, double: units pass
# [rad or m] by which real arms stand beyond their limits; degrees are farther; no benchmark comes
# here, also with a hundredth or a hundred times
_BEYOND = 0.18
# of the first orientation; another order of a quaternion is farther; half, twice: the tests of
# guards end alike
_AWRY = math.radians(30.0)

JOINTS, FRAME, TORQUE, TIME = range(4)  # the channels that are bridged
# What may be wrong: channel, signal, flaw, guess, and the guard that looks for it.
_DEGREES = "in degrees, millimetres or another order?"
_WIRED = "a motor or encoder of the wrong sign, two joints swapped, a collision?"
_MOUNTED = "in millimetres, repeated, in other axes? another frame, marker, tool? an encoder off?"
_WRAP, _OTHER_UNIT = "a wrap at +-pi, a lost count, degrees?", "the wrong sign, unit or joint?"
_OF_JOINTS = {
    kernels.JUMP: (JOINTS, "q", "has jumped", _WRAP, "differences"),
    kernels.SPIKE: (JOINTS, "v", "is implausible", "in degrees?", "differences"),
    kernels.APART: (JOINTS, "v", "is not the rate of q", _OTHER_UNIT, "differences"),
    kernels.STOPPED: (JOINTS, "q", "is stuck", "has the encoder stopped?", "differences"),
    kernels.OUT: (JOINTS, "q", "is out of range", _DEGREES, "limits"),
}
_AGAINST = JOINTS, "v", "shows more torque beside the motors than they have", _WIRED, "gravity"
_TURNED = FRAME, "x", "is turned", "in the order wxyz? other axes?", "position"
_MOVED = FRAME, "x", "does not move with the joints", _MOUNTED, "position"
_STRONG = TORQUE, "tau", "is more than the motors give", "in another unit?", "gravity"
_OTHER = TORQUE, "tau", "is not what was sent", _OTHER_UNIT, "gravity"


class Explained(NamedTuple):
    """What explains the frames so far, see ``FrameFit``; p parameters, m_p positions.

    Attributes:
        value: (p + m_p) error of the estimate at the start, and offset of x [m].
        sums: (p + m_p, p + m_p + 1) of X^T X and X^T e over the frames, normalised.
        moved: the way of all joints until the last of them [rad and m].
    """

    value: np.ndarray
    sums: np.ndarray
    moved: float = -math.inf


class MonitorState(NamedTuple):
    """What is kept of the samples, to compare the next one with.

    Attributes:
        joints: (15, n) what ``kernels.check_joints`` keeps of each joint.
        shared: (2) least change of any v [rad/s or m/s], and the way of all joints [rad and m].
        bridged: how many samples of each channel were.
        since: the time at which each channel ceased to follow [s]; infinite where it follows.
        time: of the samples since the first one [s].
        begun: whether there was a step.
        fit: to the frames; None: there was none, or they are not compared.
    """

    joints: np.ndarray
    shared: np.ndarray
    bridged: list[int]
    since: list[float]
    time: float = 0.0
    begun: bool = False
    fit: Explained | None = None

    def lasts(self, channel: int) -> bool:
        """Count a bridged sample of a channel, and return whether it is to be refused."""
        self.bridged[channel] += 1
        self.since[channel] = min(self.since[channel], self.time)
        return self.time - self.since[channel] > LASTS


def new_monitor(v: np.ndarray, since: float = math.inf) -> MonitorState:
    """Return what is kept of the first sample, with its joint velocity v (n) [rad/s or m/s]."""
    joints = np.zeros((kernels.KEPT, v.size))
    joints[kernels.RATE] = joints[kernels.RAW_V] = v
    joints[kernels.RAW_Q] = np.nan
    return MonitorState(joints, np.zeros(2), [0] * 4, [since] * 4)


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
        self, monitor: MonitorState, X: np.ndarray, a_k: np.ndarray, error: np.ndarray
    ) -> tuple[float, float, Explained | None]:
        """Return the size of r, its bound [m], and the fit with a frame that is within it.

        Args:
            monitor: with the fit to the frames before.
            X: (m_p, p) regressor of the frame.
            a_k: (p) the estimate [m].
            error: (m_p) the prediction error of that [m].
        """
        n = len(self.prior)
        bound = CERTAIN * self.deviation
        fit = monitor.fit
        value, sums, since = fit or Explained(np.zeros(n), np.zeros((n, n + 1)))
        moved: float = monitor.shared.item(1)
        near = moved - since <= _FRAME
        if near and error.dot(error) < bound**2:  # the estimate explains the frame, too
            return 0.0, bound, fit
        error = error - X.dot(a_k - self.start)
        X = np.hstack([X, np.eye(error.size)])
        r = error - X.dot(value)
        size = math.hypot(*r)
        if not math.isfinite(size):
            return size, bound, fit
        if size >= bound:  # smaller ones are no more than the noise of a frame
            way = r / size
            S = X @ np.linalg.solve(self.prior + sums[:, :-1], X.T)
            S += self.deviation**2 * np.eye(r.size)
            share = size * math.sqrt(way @ np.linalg.solve(S, way)) / CERTAIN
            if share > 1.0:
                return size, size / share, fit
        if not near:
            rows = np.column_stack([X, error]) / self.deviation
            sums = math.exp(since - moved) * sums + rows[:, :-1].T @ rows
            fit = Explained(np.linalg.solve(self.prior + sums[:, :-1], sums[:, -1]), sums, moved)
        return size, math.inf, fit


class Guards:
    """The residual test of one robot; at first it accepts everything.

    Attributes:
        model: of the robot.
        bounds: (n) of ``kernels.BOUNDS``: largest |v| [rad/s or m/s]; tol [rad or m]; the largest
            change of v in a sample; v at which a joint moves; |v| below which an arm may be
            resting; lowest and highest q of the first sample.
        places: (n + 1) where each joint begins in q, and the end.
        torque: (n) that no motor gives [N m or N].
        sensed: by which a measured torque may differ from what the motors give [N m or N]; zero: it
            is not compared with what was sent.
        farthest: largest distance of x in unknown axes from x_hat [m].
        frames: what may explain x in known axes; None: it is not compared.
        momentum: whether the residual of the torque is compared with the torque limits.
        near: errors below which an arm may be resting [m or rad].
    """

    sensed: float = 0.0
    farthest: float = math.inf
    frames: FrameFit | None = None
    momentum: bool = False
    near: float = 0.0

    def __init__(self, model: pin.Model) -> None:
        """Take the model of the robot."""
        self.model = model
        self.bounds = np.full(model.nv, math.inf, kernels.BOUNDS)
        self.bounds["slow"], self.bounds["lowest"] = 0.0, -math.inf
        self.places = np.array([*model.idx_qs, model.nq], dtype=np.int64)[1:]
        self.torque = np.full(model.nv, math.inf)

    def check_joints(
        self, before: SensedState, q: np.ndarray, v: np.ndarray, dt: float, decay: float = 0.0
    ) -> tuple[int, np.ndarray, np.ndarray, MonitorState]:
        """Return the kernel's answer, q (nq) and v (n) as they are used, and the next state."""
        old: MonitorState = before.monitor
        q_before = before.q
        if dt == math.inf:  # it is compared with none, and nothing is bridged
            old = new_monitor(v, -math.inf)
            q_before = q
            dt = 0.0
        joints = empty(old.joints.shape)
        q_used = q.copy()
        v_used = empty(v.size)
        shared = old.shared.copy()
        bridged = old.bridged.copy()
        since = old.since.copy()
        monitor = MonitorState(joints, shared, bridged, since, old.time + dt, True, old.fit)
        answer = kernels.check_joints(
            q, q_before, v, dt, decay, old.begun, self.bounds, self.places, old.joints, joints,
            shared, q_used, v_used,
        )  # fmt: skip
        if answer != 2:
            monitor.since[JOINTS] = math.inf
        if answer != 2 or not (doubted := self._doubted(q_before, v, old, joints)).any():
            return answer, q_used, v_used, monitor
        kept = old.joints.copy()
        kept[kernels.DISTRUST, doubted] = kernels.NO_Q + kernels.NO_V
        return self.check_joints(
            before._replace(monitor=old._replace(joints=kept)), q, v, dt, decay
        )

    def _doubted(
        self, q_before: np.ndarray, v: np.ndarray, old: MonitorState, joints: np.ndarray
    ) -> np.ndarray:
        """Return which joints (n) have stopped, and the others do not show it.

        Kinematics cannot tell a joint that stands from an encoder that does; the momentum can. A
        joint that stops at once pushes the others, M_rr dv_r = M_ri v_i. If that would be seen and
        less than half of it was, nothing of the joint is used until it moves.
        """
        doubted = joints[kernels.KIND] == kernels.STOPPED
        doubted &= (old.joints[kernels.DISTRUST] == 0.0) & v.any()  # not if all stop
        rate = old.joints[kernels.RATE]
        for i in np.flatnonzero(doubted).tolist():
            M = pin.crba(self.model, self.model.createData(), q_before)
            push = np.linalg.inv(M)[i]
            change = v - rate
            push *= -rate[i] / push[i]
            push[i] = change[i] = 0.0
            least = 2.0 * self.bounds["clear"][i]
            doubted[i] = np.linalg.norm(push) > least and push @ M @ (change - 0.5 * push) < 0.0
        return doubted

    def bridge_joints(self, sample: Measurement, monitor: MonitorState) -> None:
        """Count a sample of which q or v was replaced.

        Raises:
            ImplausibleError: something has not followed for too long.
            MeasurementError: q or v is not finite.
        """
        for name, value in (("q", sample.q), ("v", sample.v)):
            if not np.isfinite(value).all():
                raise MeasurementError(name, value)
        kinds = monitor.joints[kernels.KIND]
        wrong = (kinds != kernels.FOLLOWS) & (kinds != kernels.STOPPED)
        wrong |= monitor.joints[kernels.DISTRUST] != 0.0
        if not wrong.any():
            monitor.since[JOINTS] = math.inf
            return
        i = int(np.argmax(wrong))
        size = monitor.joints[kernels.SIZE, i]
        bound = monitor.joints[kernels.BOUND, i]
        summed = (kinds == kernels.APART).any()  # a sum beyond its bound has lasted
        self._bridge(_OF_JOINTS[int(kinds[i])], sample, size, bound, monitor, i, summed)

    def bridge_torque(
        self, sample: Measurement, monitor: MonitorState, sent: np.ndarray | None
    ) -> Measurement:
        """Return a sample without its torque where no motor gives it, and count that.

        Where the offset of the torque sensor is declared, the torque may also be off by offset,
        noise and the whole of what was sent, as of a motor that gives none, but not by more.

        Raises:
            ImplausibleError: it has lasted.
        """
        most = self.torque
        tau = np.asarray(sample.tau)
        flaw = _STRONG
        if tau.shape != most.shape or tau.dtype.kind not in "fiu":
            return sample._replace(tau=None)
        if sent is not None and self.sensed and sent.any():
            tau = tau - sent
            flaw = _OTHER
            most = np.minimum(most, np.abs(sent) + self.sensed)
        i = int(np.argmax(np.abs(tau) / most))
        if not abs(tau[i]) > most[i]:
            monitor.since[TORQUE] = math.inf
            return sample
        self._bridge(flaw, sample, tau[i], most[i], monitor, i)
        return sample._replace(tau=None)

    def bridge_frame(
        self,
        sample: Measurement,
        error: np.ndarray,
        X: np.ndarray,
        a_k: np.ndarray,
        monitor: MonitorState,
    ) -> tuple[Measurement, MonitorState]:
        """Return a sample without a frame that does not follow, and the state, where it counts.

        The estimate a_k (p) [m] has the prediction error (m_p) [m], with the regressor X (m_p, p).

        Raises:
            ImplausibleError: it has lasted, or there is nothing to bridge it with.
        """
        if self.frames is None:
            size = math.hypot(*error)
            bound = self.farthest
            fit = None
        else:
            size, bound, fit = self.frames.after(monitor, X, a_k, error)
        if size > bound:
            self._bridge(_MOVED, sample, size, bound, monitor)
            return sample._replace(x=None, x_time=None, xd=None), monitor
        monitor.since[FRAME] = math.inf
        return sample, monitor if fit is monitor.fit else monitor._replace(fit=fit)

    def check_turn(
        self, sample: Measurement, kinematics: TaskKinematics, monitor: MonitorState
    ) -> None:
        """Refuse a first orientation far from that of the estimated kinematics.

        Raises:
            ImplausibleError: it is.
        """
        if self.frames is None or sample.x is None:
            return
        error = kinematics.task.error(sample.x, kinematics.x_hat)[kinematics.positions :]
        turn = math.hypot(*error)
        if turn > _AWRY:
            self._bridge(_TURNED, sample, turn, _AWRY, monitor, at_once=True)

    def check_momentum(
        self,
        sample: Measurement,
        residual: np.ndarray,
        torque: np.ndarray,
        limits: np.ndarray,
        monitor: MonitorState,
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
            monitor: of the sample.

        Raises:
            ImplausibleError: it does.
        """
        if not (self.momentum and kernels.exceeds(residual, limits)):
            return
        gravity = pin.computeGeneralizedGravity(self.model, self.model.createData(), sample.q)
        moving = np.abs(residual) > limits
        moving &= (residual + torque - gravity) * residual > _MOVING * residual**2
        if moving.any():
            i = int(np.argmax(moving))
            self._bridge(_AGAINST, sample, residual[i], limits[i], monitor, i, at_once=True)

    def _bridge(
        self,
        flaw: tuple[int, str, str, str, str],
        sample: Measurement,
        residual: float,
        bound: float,
        monitor: MonitorState,
        joint: int | None = None,
        at_once: bool = False,
    ) -> None:
        """Count a sample of a channel that is bridged, and refuse what lasts.

        Raises:
            ImplausibleError: with the residual and its bound.
        """
        channel, name, words, guess, guard = flaw
        if not monitor.lasts(channel) and not at_once:
            return
        where = f"against the model, [{'rad' if flaw is _TURNED else 'm'}]"
        hint = ""
        if joint is not None:
            where = f"joint '{self.model.names[joint + 1]}',"
        else:
            hint = "If the base's axes or origin are unknown: unknown=pa.Unknown(base=True). "
        raise ImplausibleError(
            name,
            getattr(sample, name),
            f"{words}: {where} {residual:.3g} beyond {bound:.3g}",
            guess,
            f"{hint}limits=pa.Limits(guards={{'{guard}': False}}) switches this check off.",
        )


def make_guards(
    robot: Robot,
    kinematics: TaskKinematics,
    on: Mapping[str, bool],
    quality: SensorQuality,
    *,
    box: np.ndarray,
    sensors: Sensors,
    dt: float,
) -> Guards:
    """Return the guards of a controller with a period dt [s], for a robot.

    ``on`` says which there are; the box (2, p) is that of the kinematic estimates [m].
    """
    model = robot.model
    size = robot.reach
    guards = Guards(model)
    bounds = guards.bounds
    m = kinematics.positions
    lengths = np.where(robot.sliding, min(1.0, size), 1.0)
    fast = velocity_limits(model)
    if on["velocity"]:
        bounds["fastest"] = 10.0 * fast  # half or double: the same faults are found
    if on["differences"]:
        noise = sensors.deviation("q") + sensors.deviation("v") * math.sqrt(dt * kernels.MEMORY)
        counts = 2.0 * np.asarray(sensors.encoder, float)
        bounds["tolerance"] = _WAY * lengths + counts + CERTAIN * noise
        bounds["leap"] = 0.5 * fast + 2.0 * CERTAIN * quality.v  # half or double: as above
        if not robot.constraints:  # else forces that nobody measures stop joints at once
            bounds["clear"] = _BRAKED * dt * lengths + CERTAIN * quality.v
    if on["limits"]:
        most = 8.0 * math.pi  # [rad or m] of joints without limits
        low, high = np.clip(position_limits(model), -most, most)
        bounds["lowest"], bounds["highest"] = low - _BEYOND, high + _BEYOND
    if on["rest"]:
        bounds["slow"] = _SLOW * lengths + CERTAIN * quality.v
    if on["position"] and m:
        guards.farthest = 20.0 * size  # in unknown axes; millimetres are farther
        if kinematics.calibrated:
            off = np.append(0.5 * (box[1] - box[0]), np.full(m, _OFFSET * size))
            scatter = _FRAME * size / CERTAIN + 2.0 * quality.x
            prior = np.diag((CERTAIN / np.maximum(off, scatter)) ** 2)
            guards.frames = FrameFit(kinematics.initial, prior, scatter)
    if on["gravity"]:
        deviation = np.asarray(sensors.noise.get("tau", 0.0), float)
        guards.torque[:] = _STRONGER * effort_limits(model) + CERTAIN * deviation
    guards.sensed = CERTAIN * quality.tau
    guards.momentum = on["gravity"]
    guards.near = _NEAR * (size if m else 1.0) + CERTAIN * quality.x
    return guards
