"""Motions that begin where the robot is, at rest."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from .._checks import instance, positive, vector
from ..description.chain import effort_limits, is_slide, velocity_limits
from ..exceptions import InputError
from ..records import Desired, Measurement
from ..robot.robot import Robot
from ..tasks.task import Task
from ..trajectories.given import TrajectoryLike, as_trajectory
from ..trajectories.trajectory import AsGiven, Derived, Trajectory
from .within_limits import joint_motion


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
    any case); from 0.3 s to 10 s. A motion ``as_given`` is returned as it is.

    Args:
        motion: of the task's coordinates, as ``as_trajectory`` takes it.
        robot: the robot as it is believed to be; read only.
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
    needed = 1.0
    for _ in range(_PASSES):
        needed = approach_time(Approach(motion, x, needed, task), robot, measurement.q)
    if duration is not None and needed > duration:
        warnings.warn(
            f"the robot needs {needed:.3g} s to the first point of the motion, and the run ends "
            f"after {duration:.3g} s. motion.as_given() omits the approach.",
            stacklevel=3,
        )
    return Approach(motion, x, needed, task)


def approach_time(approach: Approach, robot: Robot, q: np.ndarray) -> float:
    """Return how long an approach should take [s], from a configuration (nq).

    The null space returns home at its own pace, so an approach of that duration may differ a
    little.
    """
    joints = joint_motion(approach, robot, np.linspace(0.0, approach.duration, _POINTS), q)
    caps = [_SLIDE_SPEED if is_slide(joint) else _JOINT_SPEED for joint in robot.model.joints[1:]]
    speeds = np.minimum(caps, _SPEED_SHARE * velocity_limits(robot.model))
    efforts = effort_limits(robot.model)
    room = np.maximum(_EFFORT_SHARE * efforts - np.abs(joints.still), _LEAST_EFFORT * efforts)
    speed = (np.abs(joints.v) / speeds).max(axis=1)
    effort = np.sqrt((np.abs(joints.curve) + np.abs(joints.drag)) / room).max(axis=1)
    needed = float(np.maximum(speed, effort)[joints.off <= 1.0].max(initial=0.0))
    return min(max(needed * approach.duration, _SHORTEST), _LONGEST)


def _tolerance(robot: Robot) -> np.ndarray:
    """Return how far off (m) the first point a motion may begin [m or rad]."""
    task = robot.task
    sizes = np.repeat([_THERE * robot.reach, _THERE], [task.positions, task.size - task.positions])
    return np.asarray(sizes)
