"""Motions that a given robot can start and follow: approaches, and time scaling to its limits."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ._checks import instance, joint_numbers, positive, vector
from .description.chain import (
    angles_from_configuration,
    configuration_from_angles,
    effort_limits,
    position_limits,
    velocity_limits,
)
from .exceptions import InputError
from .laws.posture import Posture
from .laws.separation import Separation
from .records import Desired, Measurement
from .robot.motors import torque_bounds, torque_limits
from .robot.robot import Robot
from .tasks.frame import FrameTask
from .tasks.task import Task
from .trajectories.given import Spline, TrajectoryLike
from .trajectories.periodic import FourierSeries
from .trajectories.pose import placed_trajectory
from .trajectories.trajectory import Derived, Retimed, SlowedTime, Trajectory, minimum_jerk

# How far off the motion a robot still follows it, of the reach or [rad]. Half or twice changes by
# millimetres where a motion counts as leaving the workspace.
TRACKED = 0.01


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The joints along a motion of the task, at N instants s of the motion's own time.

    At a constant rate ds/dt the joint velocity is v ds/dt, the acceleration a (ds/dt)^2, and the
    torque still + drag ds/dt + curve (ds/dt)^2.

    Attributes:
        q: (N, nq) configurations.
        v: (N, n) dq/ds [rad/s or m/s].
        a: (N, n) d^2q/ds^2 [rad/s^2 or m/s^2].
        still: (N, n) gravity and Coulomb friction [N m or N].
        drag: (N, n) viscous friction v.
        curve: (N, n) M a + C v.
        off: (N) how far the robot is from the motion, in units of what is allowed.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    still: np.ndarray
    drag: np.ndarray
    curve: np.ndarray
    off: np.ndarray

    def slowness(
        self,
        speeds: np.ndarray,
        efforts: np.ndarray,
        accelerations: float | np.ndarray = np.inf,
    ) -> dict[str, np.ndarray]:
        """Return the factor (n) on all times at which each joint keeps each kind of limit.

        A torque is within its limit with the factor p where room p^2 - drag p - curve >= 0; the
        room beside ``still`` is a tenth of the limit at least. Instants at which the robot does not
        follow the motion do not count.

        Args:
            speeds: (n) limits [rad/s or m/s].
            efforts: (n) limits [N m or N].
            accelerations: one limit or (n) [rad/s^2 or m/s^2].
        """
        sign = np.array([1.0, -1.0])[:, None, None]
        room = np.maximum(efforts - sign * self.still, _RESERVE * efforts)
        half = 0.5 * sign * self.drag / room
        c = sign * self.curve / room
        square = half**2 + c
        root = half + np.sqrt(np.maximum(square, 0.0))
        found = {
            "speed": np.abs(self.v) / speeds,
            "acceleration": np.sqrt(np.abs(self.a) / accelerations),
            "effort": np.where(square > 0.0, root, 0.0).max(axis=0),
        }
        valid = self.off <= 1.0
        return {kind: p[valid].max(axis=0, initial=0.0) for kind, p in found.items()}


# Share of an effort limit that is left for the motion where gravity takes nearly all; with half of
# it such motions are slower by 1.4, with twice faster by that.
_RESERVE = 0.1


def joint_motion(
    motion: Trajectory,
    robot: Robot,
    s: np.ndarray,
    q: np.ndarray | None = None,
    frequency: float = 4.0,
) -> JointMotion:
    """Return the joint motion and torques that a motion requires of a robot.

    For a task of frames by inverse kinematics: damped least squares from one instant to the
    next, with the return of the null space to the home pose at the frequency of a posture, in the
    motion's own time. Where the damping limits the motion, for example outside of the
    workspace, ``off`` exceeds 1.

    Args:
        motion: of the task's coordinates.
        robot: the model of the robot; read only.
        s: (N) instants at even steps [s], N >= 3.
        q: (nq) where the search for the first configuration begins; None: home.
        frequency: of the posture [rad/s], see ``Posture``.

    Raises:
        InputError: the robot has constraints.
    """
    if robot.constraints:
        raise InputError(
            "how fast a robot with constraints can move is not computed.", where="motion"
        )
    model = robot.model
    data = model.createData()
    asked = [motion.at(float(each)) for each in s]
    if isinstance(robot.task, FrameTask):
        h = s[1] - s[0]
        targets = [each.x_d for each in asked]
        posture = Posture(robot, frequency=frequency)
        poses, off = _followed(robot, posture, targets, h, robot.q0 if q is None else q)
        angles = np.array([angles_from_configuration(model, pose) for pose in poses])
        v = np.gradient(np.unwrap(angles, axis=0), h, axis=0, edge_order=2)
        a = np.gradient(v, h, axis=0)
    else:
        angles, v, a = (np.array(rows) for rows in zip(*asked, strict=True))
        poses = np.array([configuration_from_angles(model, each) for each in angles])
        off = np.zeros(len(s))
    g = np.array([pin.computeGeneralizedGravity(model, data, pose) for pose in poses])
    torque = np.array([pin.rnea(model, data, *each) for each in zip(poses, v, a, strict=True)])
    friction = robot.friction
    dry = friction.coulomb + friction.gear_friction * np.abs(g) + friction.asymmetry * np.sign(v)
    still = g + friction.offset + dry * np.maximum(friction.breakaway, 1.0) * np.sign(v)
    return JointMotion(poses, v, a, still, friction.viscous * v, torque - g, off)


def _followed(
    robot: Robot, posture: Posture, targets: list[np.ndarray], h: float, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return configurations (N, nq) for N targets h [s] apart, and how far (N) they are off these.

    Damped least squares; all rows of errors and Jacobians are in m, rotations times the reach. The
    search for the first configuration begins at q (nq).
    """
    model = robot.model
    data = model.createData()
    reach = robot.reach
    task = robot.task
    assert isinstance(task, FrameTask)  # of one frame or several
    arms = task.per_row(1.0, reach)  # [m/rad]
    share = 1.0 - math.exp(-posture.frequency * h) if model.nv > task.size else 0.0

    def stepped(
        q: np.ndarray, target: np.ndarray, following: np.ndarray, share: float
    ) -> tuple[Any, float]:
        """Return q (nq) after a step to the following target, and how far it is off its own.

        The squared error is added to the damping (Levenberg's rule): out of reach it is strong.
        """
        x, J = task.linear_map(model, data, robot.frame_id, q)
        J = arms[:, None] * J
        error, to_go = (arms * task.error(each, x) for each in (target, following))
        psi = -share * posture.offset(q)
        damped = J @ J.T + (least + error @ error) * np.eye(task.size)
        step = psi + J.T @ np.linalg.solve(damped, to_go - J @ psi)
        step *= 0.2 / max(float(np.linalg.norm(step)), 0.2)  # [rad or m], far from the motion
        return pin.integrate(model, q, step), np.abs(error).max() / reach

    J_home = arms[:, None] * task.linear_map(model, data, robot.frame_id, robot.q0)[1]
    smallest = np.linalg.svd(J_home, compute_uv=False)[-1]
    least = (0.01 * max(smallest, 1e-6)) ** 2  # half or twice: durations as they are to 1e-5
    for _ in range(100):  # a few, unless the point is out of reach
        after, error = stepped(q, targets[0], targets[0], 0.0)
        if error < 1e-8:
            break
        q = after
    poses = []
    off = []
    for pair in zip(targets, [*targets[1:], targets[-1]], strict=True):
        poses.append(q)
        q, error = stepped(q, *pair, share)
        off.append(error)
    return np.array(poses), np.array(off) / TRACKED


_STEP = 0.0125  # [s] between instants looked at; half of it: slower by 0.5 %; twice: faster by 2 %


def within_limits(
    motion: TrajectoryLike,
    robot: Robot,
    *,
    share: float = 0.8,
    margin: float = 0.3,
    acceleration: ArrayLike | None = None,
    efforts: ArrayLike | bool = True,
    horizon: float = 60.0,
) -> Trajectory:
    """Return a motion slowed down until a robot keeps its limits; the path stays the same.

    Speeds, accelerations and torques of the joints follow from those along the motion, see
    ``JointMotion``: at a constant rate r of the motion's own time the velocity of a joint is v r
    and its torque g + f r + c r^2. The rate is the largest one, at most 1, that keeps all limits at
    all instants up to the ``horizon``, or until the motion settles. A motion that starts at speed
    is begun from rest, unless it is ``as_given``. Samples (t, x) begin and end at rest: recorded at
    speed, they ask for much in their first and last interval, and for a low rate.

    Time scaling does not help where the motion leaves the workspace: a warning says when and where,
    and those instants do not count for the rate.

    Args:
        motion: as ``simulate`` takes it.
        robot: the model of the robot, with its friction; read only. Redundant joints
            move as under the posture of the default law, from home.
        share: of the velocity limits, and of the effort limits, that may be used.
        margin: by how much the true torque may exceed that of the model, relative to it; the torque
            of the model stays within share / (1 + margin) of the efforts.
        acceleration: limits, one number or (n) [rad/s^2 or m/s^2]; None: none.
        efforts: limits, one number or (n) [N m or N]; True: those of the description; False: none.
        horizon: [s] of the motion's own time.

    Returns:
        A ``Retimed`` motion, whose representation says how much and why it is slower.

    Raises:
        InputError: the motion does not suit the task, or numbers that are not positive.
        GainError: effort limits that are not positive.
    """
    instance(robot, Robot, "robot")
    given = placed_trajectory(motion, robot).from_rest()
    positive(share, "share", error=InputError)
    positive(horizon, "horizon", error=InputError)
    positive(margin, "margin", zero=True, error=InputError)
    n = robot.model.nv
    most = torque_bounds(torque_limits(robot, efforts, "efforts"), n)
    accelerations: float | np.ndarray = np.inf
    if acceleration is not None:
        accelerations = joint_numbers(acceleration, "acceleration", n, zero=False)
    span = horizon if given.settles is None else min(max(given.settles, _STEP), horizon)
    parts = [np.linspace(0.0, span, math.ceil(span / _STEP) + 2)]
    # a spline comes from rest, and to it, between two samples; half of the 33 instants exceed the
    # limits by 0.7 % there, twice find nothing more
    if isinstance(given, Spline):
        parts += [np.linspace(a, b, 33) for a, b in (given.t[:2], given.t[-2:])]
    speeds = share * velocity_limits(robot.model)
    usable = share / (1.0 + margin) * most
    slowness = 1.0
    # In the time of a motion that is slowed a posture is as much faster. Half as many rounds: a
    # Panda's joint speeds up to 84 % where 80 % are asked and four give 81 %; twice: 81 %.
    for _ in range(4):
        frequency = 0.5 * Separation.own_bandwidth * slowness
        joints = [joint_motion(given, robot, part, frequency=frequency) for part in parts]
        found = [part.slowness(speeds, usable, accelerations) for part in joints]
        needed = {kind: np.max([part[kind] for part in found], axis=0) for kind in found[0]}
        kind = max(needed, key=lambda each: needed[each].max())
        before = slowness
        slowness = max(1.0, needed[kind].max())
        if slowness == before or n <= robot.task.size:
            break
    if (lost := joints[0].off > 1.0).any():
        first, last = parts[0][lost][[0, -1]]
        where = given.at(float(first)).x_d[: robot.task.positions].round(3).tolist()
        warnings.warn(
            f"the motion leaves the workspace from {first:.3g} s on, at {where} m, last at "
            f"{last:.3g} s of its own time.",
            stacklevel=2,
        )
    joint = robot.joint_names[int(np.argmax(needed[kind]))]
    return Retimed(given, SlowedTime(slowness, f"{kind} of {joint}"))


class Approach(Derived):
    """From a point to the first point of a motion, at rest at both ends, then the motion.

    Coordinates move by minimum jerk: along a straight line; an orientation turns about one axis,
    the shortest way; continuous joints turn the short way. The motion is that of t - duration
    afterwards; it should start at rest, see ``Trajectory.from_rest``.

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
        super().__init__(motion)
        self._task = task
        self._first = motion.at(0.0).x_d
        self.duration = positive(duration, "duration", error=InputError)
        if self.settles is not None:
            self.settles += self.duration
        self.way = task.error(vector(start, self._first.size, "start"), self._first)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        T = self.duration
        if t >= T:
            return self.motion.at(t - T)
        s, sd, sdd = minimum_jerk(max(t, 0.0) / T)
        x_d = self._task.moved(self._first, (1.0 - s) * self.way)
        return Desired(x_d, -sd / T * self.way, -sdd / T**2 * self.way)


class SmallExcitation(Trajectory):
    """A small excitation of all joints about a configuration, which begins and ends there at rest.

    Joint j moves by A_j sin^2(pi t / T) sin(2 pi c_j t / T) with c_j = 1 + j / 2 cycles, j = 0, 1,
    ...: a sum of three sines. The motion is twice differentiable, and at rest from T.

    Attributes:
        duration: T [s].
        amplitudes: (n) A [rad or m].
    """

    def __init__(self, robot: Robot, duration: float = 2.0) -> None:
        """Choose amplitudes that move the frame by a twentieth of the reach each.

        A joint turns by at most 0.15 rad, by a third of the way to its nearer stop, and at half of
        its velocity limit.

        Args:
            robot: whose home the motion is about.
            duration: T [s].

        Raises:
            InputError: a duration that is not positive.
        """
        model = robot.model
        n = model.nv
        self.duration = self.settles = positive(duration, "duration")
        home = robot.home_angles
        size = 0.05 * robot.reach
        J = pin.computeFrameJacobian(
            model, model.createData(), robot.q0, robot.frame_id, pin.LOCAL_WORLD_ALIGNED
        )
        wanted = size / np.maximum(np.linalg.norm(J[:3], axis=0), size / 0.15)
        low, high = position_limits(model)
        room = np.maximum(np.minimum(home - low, high - home), 0.0)
        fast = 0.5 * velocity_limits(model) * self.duration / (math.pi * (2.0 + np.arange(n)))
        self.amplitudes = np.minimum.reduce([wanted, room / 3.0, fast])
        # with b = pi / T and k = 2 + j: sin^2(b t) sin(k b t) = sin(k b t) / 2 - (sin((k - 2) b t)
        # + sin((k + 2) b t)) / 4; the columns are of 1, 2, ...
        sides = np.eye(n, n + 3, -1) + np.eye(n, n + 3, 3)
        sine = self.amplitudes[:, None] * (0.5 * np.eye(n, n + 3, 1) - 0.25 * sides)
        self._moving = FourierSeries(home, np.zeros_like(sine), sine, 2.0 * self.duration)

    def at(self, t: float) -> Desired:
        """Return joint positions, velocities and accelerations (n) at time t [s]."""
        return self._moving.at(min(max(t, 0.0), self.duration))


# A step of the error asks for K_P times as much acceleration. At K_P = 400 / s^2 a thousandth of
# the reach asks for 0.4 reach / s^2, as a circle of a tenth of the reach in 3 s does.
_THERE = 1e-3  # of the reach, [rad], or of slides [m]
# Of an approach: speed of a joint [rad/s], of a slide half of it [m/s]; least and most time [s].
# Half or twice the speed takes twice or half the time.
_SPEED, _SHORTEST, _LONGEST = 0.75, 0.3, 10.0


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
    limit, nor gravity and motion half of its effort limit (a tenth of that is left for the motion
    in any case); from 0.3 s to 10 s. A motion ``as_given`` is returned as it is. Where the robot
    does not reach the first point, a warning says so.

    Args:
        motion: as ``simulate`` takes it.
        robot: the model of the robot; read only.
        measurement: of the robot at rest; its x, or for a joint task its q, is where it is.
        duration: of the run [s]; the motion is not looked at beyond. None: unknown.

    Raises:
        InputError: the motion does not suit the robot's task.
    """
    task = instance(robot, Robot, "robot").task
    x = task.measured(measurement.x, measurement.q)
    motion = placed_trajectory(motion, robot, x)
    if motion.exact:
        return motion
    motion = motion.from_rest(duration=duration)
    first = motion.at(0.0).x_d
    if (np.abs(task.error(x, first)) <= _THERE * task.per_row(robot.reach, 1.0)).all():
        return motion
    speeds = np.where(robot.sliding, 0.5 * _SPEED, _SPEED)
    speeds = np.minimum(speeds, 0.8 * velocity_limits(robot.model))
    approach = Approach(motion, x, 1.0, task)
    for _ in range(2):  # the null space returns home at its own pace
        s = np.linspace(0.0, approach.duration, math.ceil(approach.duration / _STEP) + 2)
        joints = joint_motion(approach, robot, s, measurement.q)
        found = joints.slowness(speeds, 0.5 * effort_limits(robot.model))
        needed = approach.duration * max(p.max() for p in found.values())
        approach = Approach(motion, x, min(max(needed, _SHORTEST), _LONGEST), task)
    if joints.off[-1] - joints.off[0] > 1.0:  # the start is off with a tool that is not described
        warnings.warn(
            "the robot as described does not reach the first point of the motion, "
            f"{first[: task.positions].round(3).tolist()} m; its reach is {robot.reach:.3g} m. Is "
            "the motion in metres, in the axes and from the origin of the robot's base?",
            stacklevel=3,
        )
    return approach
