"""Motions that a given robot can start and follow: approaches, and time scaling to its limits."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ._checks import instance, positive, vector
from .description.chain import (
    configuration_from_angles,
    effort_limits,
    is_slide,
    position_limits,
    velocity_limits,
)
from .exceptions import InputError
from .laws.posture import Posture
from .records import Desired, Measurement
from .robot.motors import torque_limits
from .robot.robot import Robot
from .tasks.frame import FrameTask
from .tasks.task import Task
from .trajectories.given import TrajectoryLike, as_trajectory
from .trajectories.trajectory import AsGiven, Derived, Retimed, SlowedTime, Trajectory

TRACKED = 0.01  # [reach] or [rad]: further from the motion, the robot has not followed it
_DAMPING = 0.01  # of the smallest singular value at home
_LARGEST_STEP = 0.2  # [rad or m] of all joints together, from one instant to the next
_WIGGLE = 0.15  # [rad] most of a joint
_SEARCH = 100  # most steps to the first point


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The joints along a motion of the task, at N instants s of the motion's own time.

    At a constant rate ds/dt the joint velocity is v ds/dt, the acceleration a (ds/dt)^2, and the
    torque still + drag ds/dt + curve (ds/dt)^2.

    Attributes:
        s: (N) [s].
        q: (N, nq) configurations.
        v: (N, n) dq/ds [rad/s or m/s].
        a: (N, n) d^2q/ds^2 [rad/s^2 or m/s^2].
        still: (N, n) gravity and Coulomb friction [N m or N].
        drag: (N, n) viscous friction v.
        curve: (N, n) M a + C v.
        off: (N) how far the robot is from the motion, in units of what is allowed.
        beyond: (N, n) how far joints are beyond their limits [rad or m], else negative.
    """

    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    still: np.ndarray
    drag: np.ndarray
    curve: np.ndarray
    off: np.ndarray
    beyond: np.ndarray


def joint_motion(
    motion: Trajectory, robot: Robot, s: np.ndarray, q: np.ndarray | None = None
) -> JointMotion:
    """Return the joint motion and torques that a motion requires of a robot.

    For a task of the frame by inverse kinematics: damped least squares from one instant to the
    next, with the return of the null space to the home pose that the control laws have by default,
    at the motion's own speed. Where the damping limits the motion, for example outside of the
    workspace, ``off`` exceeds 1.

    Args:
        motion: of the task's coordinates.
        robot: the model of the robot; read only.
        s: (N) instants at even steps [s], N >= 3.
        q: (nq) where the search for the first configuration begins; None: home.
    """
    model, data, n = robot.model, robot.model.createData(), robot.model.nv
    h = float(s[1] - s[0])
    if isinstance(robot.task, FrameTask):
        follower = _InverseKinematics(robot, robot.task)
        found = list(follower.along(motion, s, robot.q0 if q is None else q))
        poses, off = np.array([each for each, _ in found]), np.array([far for _, far in found])
        v = np.empty((len(s), n))
        for k in range(len(s)):
            before, after = max(k - 1, 0), min(k + 1, len(s) - 1)
            v[k] = pin.difference(model, poses[before], poses[after]) / (h * (after - before))
        v[0], v[-1] = 2.0 * v[0] - v[1], 2.0 * v[-1] - v[-2]
        a = np.gradient(v, h, axis=0)
    else:
        asked = [motion.at(float(each)) for each in s]
        poses = np.array([configuration_from_angles(model, each.x_d) for each in asked])
        v, a = np.array([each.xd_d for each in asked]), np.array([each.xdd_d for each in asked])
        off = np.zeros(len(s))
    rest = np.zeros(n)
    g, curve = np.empty((2, len(s), n))
    for k, pose in enumerate(poses):
        g[k] = pin.rnea(model, data, pose, rest, rest)
        curve[k] = pin.rnea(model, data, pose, v[k], a[k])
    friction = robot.friction
    dry = friction.coulomb + friction.gear_friction * np.abs(g) + friction.asymmetry * np.sign(v)
    still = g + friction.offset + dry * np.maximum(friction.breakaway, 1.0) * np.sign(v)
    drag = robot.friction.viscous * v
    beyond = _beyond(model, poses)
    return JointMotion(s, poses, v, a, still, drag, curve - g, off, beyond)


def _beyond(model: pin.Model, poses: np.ndarray) -> np.ndarray:
    """Return how far (N, n) the configurations (N, nq) are beyond the limits of the joints."""
    low, high = position_limits(model)
    beyond = np.full((len(poses), model.nv), -np.inf)
    for joint in model.joints[1:]:
        if joint.nq == 1:
            x, i = poses[:, joint.idx_q], joint.idx_v
            beyond[:, i] = np.maximum(low[i] - x, x - high[i])
    return beyond


class _InverseKinematics:
    """Damped inverse kinematics of one robot along a motion."""

    def __init__(self, robot: Robot, task: FrameTask) -> None:
        m = task.positions
        self._robot, self._task, self._model = robot, task, robot.model
        self._data = robot.model.createData()
        self._arms = np.repeat([1.0, robot.reach], [m, task.size - m])  # [m/rad]
        self._allowed = np.repeat([TRACKED * robot.reach, TRACKED], [m, task.size - m])
        self._redundant = robot.model.nv > task.size
        self._posture = Posture(robot)
        J = self._jacobian(robot.q0)[0]
        self._least = (_DAMPING**2) * max(float(np.linalg.eigvalsh(J @ J.T)[0]), 1e-12)
        self._eye = np.eye(task.size)

    def along(
        self, motion: Trajectory, s: np.ndarray, q: np.ndarray
    ) -> Iterator[tuple[np.ndarray, float]]:
        """Yield a configuration (nq) for each instant (N), and how far off the motion it is."""
        targets = [motion.at(float(each)).x_d for each in s]
        q = self._nearest(q, targets[0])
        share = 1.0 - math.exp(-self._posture.frequency * float(s[1] - s[0]))
        for k, target in enumerate(targets):
            J, x = self._jacobian(q)
            error = self._task.error(target, x)
            yield q, float(np.abs(error / self._allowed).max())
            if k + 1 < len(targets):
                to_go = self._task.error(targets[k + 1], x)
                q = self._stepped(q, J, to_go, float(error @ error), share)

    def _nearest(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return a configuration (nq) that reaches a point, or comes near, from q (nq)."""
        for _ in range(_SEARCH):
            J, x = self._jacobian(q)
            to_go = self._task.error(target, x)
            if np.abs(to_go / self._allowed).max() < 1e-6:
                break
            q = self._stepped(q, J, to_go, float(to_go @ to_go), 0.0)
        return q

    def _stepped(
        self, q: np.ndarray, J: np.ndarray, to_go: np.ndarray, off: float, share: float
    ) -> np.ndarray:
        """Return q (nq) after a step towards what is left to go (m).

        The squared error is added to the damping (Levenberg's rule): out of reach it is strong.
        """
        to_go = self._arms * to_go
        psi = np.zeros(J.shape[1])
        if self._redundant and share:
            psi = -share * self._posture.offset(q)
            to_go = to_go - J @ psi
        step = psi + J.T @ np.linalg.solve(J @ J.T + (self._least + off) * self._eye, to_go)
        size = float(np.linalg.norm(step))
        if size > _LARGEST_STEP:
            step *= _LARGEST_STEP / size
        return np.asarray(pin.integrate(self._model, q, step))

    def _jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Jacobian (m, n), rotations times the reach, and the coordinates at q (nq)."""
        model, data, frame = self._model, self._data, self._robot.frame_id
        pin.computeJointJacobians(model, data, q)
        placement = pin.updateFramePlacement(model, data, frame)
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        return self._arms[:, None] * self._task.jacobian(placement, J), self._task.of(placement)


_SHARE, _MARGIN = 0.8, 0.3
_HORIZON = 60.0  # [s]
_STEP, _MOST_POINTS = 0.0125, 6000  # [s] between instants looked at, and most of them
_SETTLED = 3.0  # [s] after which the null space moves as periodically as the motion
_LEAST_SHARE = 0.05  # of a limit, left for the motion beside gravity where that takes it all
_SLOWEST = 50.0  # largest factor on the duration


class WithinLimits(SlowedTime):
    """The time law of ``within_limits``, with what it was made for.

    Attributes:
        cause: the limit that asks for it, and the joint.
    """

    def __init__(self, slowness: float, cause: str) -> None:
        """Take the factor on all times, and what it was made for."""
        super().__init__(slowness)
        self.cause = cause

    def __repr__(self) -> str:
        """Return how much and why the motion is slower."""
        if self.slowness == 1.0:
            return "not slowed"
        return f"slowed to {100 / self.slowness:.3g} % ({self.cause})"


def within_limits(
    motion: TrajectoryLike,
    robot: Robot,
    *,
    share: float = _SHARE,
    margin: float = _MARGIN,
    acceleration: ArrayLike | None = None,
    efforts: ArrayLike | bool = True,
    q: ArrayLike | None = None,
    horizon: float = _HORIZON,
) -> Trajectory:
    """Return a motion slowed down until a robot keeps its limits; the path stays the same.

    Speeds, accelerations and torques of the joints follow from those along the motion, see
    ``JointMotion``: at a constant rate r of the motion's own time the velocity of a joint is v r
    and its torque g + f r + c r^2. The rate is the largest one, at most 1, that keeps all limits at
    all instants.

    A motion that starts at speed is begun from rest, unless it is ``as_given``. A motion that
    repeats itself is looked at for a turn (``Trajectory.repeats``), any other up to its
    ``horizon``, or until it settles.

    Time scaling does not help where the motion leaves the workspace, or a joint its range: a
    warning says when and where, and those instants do not count for the rate.

    Args:
        motion: of the task's coordinates, as ``as_trajectory`` takes it.
        robot: the model of the robot, with its friction; read only. Redundant joints
            move as under the default posture of the control laws.
        share: of the velocity limits, and of the effort limits, that may be used.
        margin: by how much the true torque may exceed that of the model, relative to it; the torque
            of the model stays within share / (1 + margin) of the efforts.
        acceleration: limits, one number or (n) [rad/s^2 or m/s^2]; None: none.
        efforts: limits, one number or (n) [N m or N]; True: those of the description; False: none.
        q: (n) where the joints are at the start [rad or m]; None: home.
        horizon: [s] of the motion's own time.

    Returns:
        A ``Retimed`` motion, whose representation says how much and why it is slower.

    Raises:
        InputError: the motion does not suit the task, or numbers that are not positive.
        GainError: effort limits that are not positive.
    """
    instance(robot, Robot, "robot")
    given = as_trajectory(motion, robot.task).from_rest()
    for value, name in ((share, "share"), (horizon, "horizon")):
        positive(value, name, error=InputError)
    positive(margin, "margin", zero=True, error=InputError)
    span = _span(given, horizon)
    s = np.linspace(0.0, span, min(math.ceil(span / _STEP) + 2, _MOST_POINTS))
    start = robot.q0 if q is None else robot.at(vector(q, robot.model.nv, "q")).q0
    joints = joint_motion(given, robot, s, start)
    _warn(joints, given, robot)
    slowness, cause = _slowness(robot, joints, share, margin, acceleration, efforts)
    return Retimed(given, WithinLimits(slowness, cause))


def _span(motion: Trajectory, horizon: float) -> float:
    """Return until when a motion is looked at [s]."""
    if motion.settles is not None:
        return min(max(motion.settles, _STEP), horizon)
    found = motion.repeats
    if found is None:
        return horizon
    since, period = found
    return min(since + period * max(2, math.ceil(_SETTLED / period)), horizon)


def _warn(joints: JointMotion, motion: Trajectory, robot: Robot) -> None:
    """Say when and where a motion leaves the workspace, or a joint its range."""
    if (lost := joints.off > 1.0).any():
        first, last = joints.s[lost][[0, -1]]
        where = motion.at(float(first)).x_d[: robot.task.positions].round(3).tolist()
        warnings.warn(
            f"the motion leaves the workspace from {first:.3g} s on, at {where} m, last at "
            f"{last:.3g} s of its own time.",
            stacklevel=3,
        )
        return  # what the joints do then means nothing
    for name, beyond in zip(robot.joint_names, joints.beyond.T, strict=True):
        if (out := beyond > 0.0).any():
            k = int(np.argmax(out))
            warnings.warn(
                f"the motion takes joint '{name}' beyond its range from {joints.s[k]:.3g} s of its "
                f"own time on, by up to {beyond.max():.3g} rad or m.",
                stacklevel=3,
            )


def _slowness(
    robot: Robot,
    joints: JointMotion,
    share: float,
    margin: float,
    acceleration: ArrayLike | None,
    efforts: ArrayLike | bool,
) -> tuple[float, str]:
    """Return the least factor on all times, at least 1, that keeps the limits, and the cause.

    With the factor p a torque is within its limit where room p^2 - f p - c >= 0.
    """
    n, names = robot.model.nv, robot.joint_names
    most = torque_limits(robot, efforts)
    most = np.full(n, np.inf) if most is None else most
    accelerations = np.full(n, np.inf)
    if acceleration is not None:
        accelerations = vector(acceleration, n, "acceleration", names=names)
        if (accelerations <= 0.0).any():
            raise InputError("must be positive.", where="acceleration")
    usable, least = share * most / (1.0 + margin), _LEAST_SHARE * most
    still = np.where(np.isinf(most), 0.0, joints.still)
    heavy = np.abs(still).max(axis=0) / most
    if (heavy > 1.0).any():
        i = int(np.argmax(heavy))
        warnings.warn(
            f"gravity alone takes {100 * heavy[i]:.3g} % of the effort limit of joint "
            f"'{names[i]}' on the way; no time scaling helps.",
            stacklevel=3,
        )
    both = []
    for sign in (1.0, -1.0):
        room = np.maximum(usable - sign * still, least)
        half, c = 0.5 * sign * joints.drag / room, sign * joints.curve / room
        square = half**2 + c
        both.append(np.where(square > 0.0, half + np.sqrt(np.maximum(square, 0.0)), 0.0))
    found = {
        "speed": np.abs(joints.v) / (share * velocity_limits(robot.model)),
        "acceleration": np.sqrt(np.abs(joints.a) / accelerations),
        "effort": np.maximum(*both),
    }
    valid = joints.off <= 1.0
    needed = {kind: p[valid].max(axis=0, initial=1.0) for kind, p in found.items()}
    kind = max(needed, key=lambda each: float(needed[each].max()))
    i = int(np.argmax(needed[kind]))
    return min(float(needed[kind][i]), _SLOWEST), f"{kind} of {names[i]}"


class Approach(Derived):
    """From a point to the first point of a motion, at rest at both ends, then the motion.

    Coordinates move by minimum jerk, s(u) = 10 u^3 - 15 u^4 + 6 u^5 with u = t / duration: along a
    straight line; an orientation turns about one axis, the shortest way; continuous joints turn the
    short way. The motion is that of t - duration afterwards; it should start at rest, see
    ``Trajectory.from_rest``.

    Attributes:
        motion: what follows.
        way: (m) from its first point back to where the approach starts [m or rad].
        duration: of the approach [s].
    """

    def __init__(self, motion: Trajectory, start: ArrayLike, duration: float, task: Task) -> None:
        """Take the motion, the coordinates to start from, the duration [s] and the task.

        Raises:
            InputError: coordinates of another number than the motion has, or not finite; or a
                duration that is not positive.
        """
        self.motion, self._task, self._first = motion, task, motion.at(0.0).x_d
        self.duration = positive(duration, "duration", error=InputError)
        self.way = task.error(vector(start, self._first.size, "start"), self._first)

    def __repr__(self) -> str:
        """Return how long the approach takes, and what follows."""
        return f"approach of {self.duration:.3g} s, {self.motion!r}"

    @property
    def settles(self) -> float | None:
        """When the motion that follows comes to rest [s], or None."""
        settled = self.motion.settles
        return None if settled is None else self.duration + settled

    @property
    def repeats(self) -> tuple[float, float] | None:
        """From when and with which period [s] the motion that follows repeats itself, or None."""
        found = self.motion.repeats
        return None if found is None else (self.duration + found[0], found[1])

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        T = self.duration
        if t >= T:
            return self.motion.at(t - T)
        u = max(t, 0.0) / T
        left = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        speed = -30.0 * u * u * (1.0 - u) ** 2 / T
        rate = -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / T**2
        x_d = self._task.moved(self._first, left * self.way)
        return Desired(np.asarray(x_d), speed * self.way, rate * self.way)


# A step of the error asks for K_P times as much acceleration. At K_P = 400 / s^2 a thousandth of
# the reach asks for 0.4 reach / s^2, as a circle of a tenth of the reach in 3 s does.
_THERE = 1e-3  # of the reach, [rad], or of slides [m]
_JOINT_SPEED, _SLIDE_SPEED = 0.75, 0.375  # [rad/s], [m/s]: half of those of ``reachable_circle``
_SPEED_SHARE, _EFFORT_SHARE = 0.8, 0.5  # of the limits of the description
_LEAST_EFFORT = 0.1  # share of the effort limit that is left for the motion beside gravity
_SHORTEST, _LONGEST = 0.3, 10.0  # [s]
_POINTS, _PASSES = 61, 2


class Wiggle(Trajectory):
    """A small excitation of all joints about a configuration, which begins and ends there at rest.

    Joint j moves by A_j sin^2(pi t / T) sin(2 pi c_j t / T), with a number of cycles c_j of its
    own. The motion is twice differentiable, and at rest from T.

    Attributes:
        duration: T [s].
        amplitudes: (n) A [rad or m].
    """

    def __init__(self, robot: Robot, duration: float = 2.0, *, size: float = 0.05) -> None:
        """Choose amplitudes that move the frame by ``size`` of the reach each.

        A joint turns by at most 0.15 rad, by a third of the way to its nearer stop, and at half of
        its velocity limit.

        Args:
            robot: whose home the motion is about.
            duration: T [s].
            size: displacement of the frame by one joint, relative to the reach.

        Raises:
            InputError: numbers that are not positive.
        """
        model, n = robot.model, robot.model.nv
        self.duration, size = positive(duration, "duration"), positive(size, "size")
        self._home, self._cycles = robot.home_angles, 1.0 + 0.5 * np.arange(n)
        J = pin.computeFrameJacobian(
            model, model.createData(), robot.q0, robot.frame_id, pin.LOCAL_WORLD_ALIGNED
        )[:3].reshape(3, n)
        lever = np.linalg.norm(J, axis=0)
        wanted = size * robot.reach / np.maximum(lever, size * robot.reach / _WIGGLE)
        low, high = position_limits(model)
        room = np.minimum(self._home - low, high - self._home)
        rate = 2.0 * math.pi * self._cycles / self.duration
        fast = 0.5 * velocity_limits(model) / rate
        self.amplitudes = np.minimum.reduce([wanted, np.maximum(room, 0.0) / 3.0, fast])

    @property
    def settles(self) -> float:
        """T [s]."""
        return self.duration

    def at(self, t: float) -> Desired:
        """Return joint positions, velocities and accelerations (n) at time t [s]."""
        n, T = self._home.size, self.duration
        if not 0.0 < t < T:
            return Desired(self._home.copy(), np.zeros(n), np.zeros(n))
        b, c = 2.0 * math.pi / T, 2.0 * math.pi * self._cycles / T
        w, wd, wdd = (
            0.5 - 0.5 * math.cos(b * t), 0.5 * b * math.sin(b * t), 0.5 * b * b * math.cos(b * t)
        )  # fmt: skip
        sine, cosine, A = np.sin(c * t), np.cos(c * t), self.amplitudes
        return Desired(
            self._home + A * w * sine,
            A * (wd * sine + w * c * cosine),
            A * (wdd * sine + 2.0 * wd * c * cosine - w * c * c * sine),
        )


def starting_from(
    motion: TrajectoryLike,
    robot: Robot,
    measurement: Measurement,
    *,
    duration: float | None = None,
) -> Trajectory:
    """Return a motion that begins where the robot is, at rest; ``simulate`` does so by default.

    The motion starts from rest, see ``Trajectory.from_rest``. If its first point is more than a
    thousandth of the reach, or a milliradian, from where the robot is, an ``Approach`` comes first.
    That takes as long that no joint exceeds 0.75 rad/s, or 0.375 m/s, or 80 % of its velocity
    limit, nor gravity and motion half of its effort limit (a tenth of it is left for the motion in
    any case); from 0.3 s to 10 s. A motion ``as_given`` is returned as it is. Where the robot does
    not reach the first point, a warning says so.

    Args:
        motion: of the task's coordinates, as ``as_trajectory`` takes it.
        robot: the model of the robot; read only.
        measurement: of the robot at rest; its x, or for a joint task its q, is where it is.
        duration: of the run [s]; the motion is not looked at beyond. None: unknown.

    Raises:
        InputError: the motion does not suit the robot's task.
    """
    task = instance(robot, Robot, "robot").task
    motion = as_trajectory(motion, task)
    if isinstance(motion, AsGiven):
        return motion
    motion = motion.from_rest(duration=duration)
    x = task.measured(measurement.x, measurement.q)
    way = task.error(x, motion.at(0.0).x_d)
    if (np.abs(way) <= _tolerance(robot)).all():
        return motion
    needed, off = 1.0, 0.0
    for _ in range(_PASSES):
        needed, off = approach_time(Approach(motion, x, needed, task), robot, measurement.q)
    if off > 1.0:
        first = motion.at(0.0).x_d[: task.positions].round(3).tolist()
        warnings.warn(
            f"the robot as described does not reach the first point of the motion, {first} m, on a "
            f"straight line from where it is, {x[: task.positions].round(3).tolist()} m; its reach "
            f"is {robot.reach:.3g} m. Is the motion in metres, in the axes and from the origin of "
            "the robot's base?",
            stacklevel=3,
        )
    elif duration is not None and needed > duration:
        warnings.warn(
            f"the robot needs {needed:.3g} s to the first point of the motion, and the run ends "
            f"after {duration:.3g} s. Without an approach: motion.as_given(), in a scenario "
            'start = "moving".',
            stacklevel=3,
        )
    return Approach(motion, x, needed, task)


def approach_time(approach: Approach, robot: Robot, q: np.ndarray) -> tuple[float, float]:
    """Return how long an approach should take [s], and by how much its end is further off.

    That is in units of what is allowed, see ``JointMotion``. The start may be off already, with a
    tool that the description lacks.

    The null space returns home at its own pace, so an approach of that duration may differ a
    little.

    Args:
        approach: of any duration.
        robot: the model; read only.
        q: (nq) configuration where it starts.
    """
    joints = joint_motion(approach, robot, np.linspace(0.0, approach.duration, _POINTS), q)
    caps = [_SLIDE_SPEED if is_slide(joint) else _JOINT_SPEED for joint in robot.model.joints[1:]]
    speeds = np.minimum(caps, _SPEED_SHARE * velocity_limits(robot.model))
    efforts = effort_limits(robot.model)
    room = np.maximum(_EFFORT_SHARE * efforts - np.abs(joints.still), _LEAST_EFFORT * efforts)
    speed = (np.abs(joints.v) / speeds).max(axis=1)
    effort = np.sqrt((np.abs(joints.curve) + np.abs(joints.drag)) / room).max(axis=1)
    needed = float(np.maximum(speed, effort)[joints.off <= 1.0].max(initial=0.0))
    return min(max(needed * approach.duration, _SHORTEST), _LONGEST), float(
        joints.off[-1] - joints.off[0]
    )


def _tolerance(robot: Robot) -> np.ndarray:
    """Return how far off (m) the first point a motion may begin [m or rad]."""
    task = robot.task
    sizes = np.repeat([_THERE * robot.reach, _THERE], [task.positions, task.size - task.positions])
    return np.asarray(sizes)
