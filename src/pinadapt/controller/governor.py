"""The governor: slows the time of the path where the arm cannot follow, and goes on afterwards.

The path has a time of its own, s, and the desired motion is x_d(s(t)). Its derivatives follow by
the chain rule, xd_d = x_d' ds/dt and xdd_d = x_d'' (ds/dt)^2 + x_d' d^2s/dt^2; with a twice
differentiable s this is a motion like any other, so the proofs of the laws hold unchanged. The task
error stays an error in space: while the path waits, the error does not grow by its waiting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy import empty

from .._checks import positive, take_checked
from .._kernels import samples as kernels
from ..description.chain import position_limits, velocity_limits
from ..exceptions import GainError
from ..models.right_inverse import RightInverse
from ..records import Camera, Desired, Sensors
from ..robot.motors import torque_bounds
from ..robot.robot import Robot
from ..tasks.task import JointTask, Moving, Task
from ..trajectories.trajectory import Trajectory

ERROR, FRAMES = "error", "frames"
EFFORT, STOP, SPEED, SINGULAR = "effort", "joint stop", "joint speed", "singularity"
# [s] by which a frame may be older than the camera explains; half, twice: the tests of governed
# runs end alike
_SPARE = 0.05


class PathTime(NamedTuple):
    """The time of the path, s = t - lag, at one instant t.

    Attributes:
        lag: t - s, by how much the path is late [s].
        rate: ds/dt, from 0 to 1.
        acceleration: d^2s/dt^2 [1/s].
        cause: what slowed the path last, empty at full rate: "error", "frames", "singularity", or
            "effort", "joint stop" or "joint speed" with the name of the joint, as in "effort of
            elbow".
    """

    lag: float = 0.0
    rate: float = 1.0
    acceleration: float = 0.0
    cause: str = ""

    def desired(self, motion: Trajectory, t: float) -> Desired:
        """Return x_d(s(t)) with its derivatives by the chain rule."""
        return motion.at(t - self.lag).at_rate(self.rate, self.acceleration)


@dataclass(frozen=True)
class Governor:
    """When the time of the path slows down; the defaults do not act on a run that goes well.

    The target of the rate ds/dt is the smallest of these factors from 0 to 1:

    * error: 1 up to the share ``slow`` of a stop error, ``creep`` from there on, 0 from ``hold``
      stop errors on, so that a path that leaves the workspace comes back by itself, and one that is
      lost waits;
    * effort: 1 up to the share ``effort`` of a motor's limit, 0 at the limit;
    * joint stop: 1 while the path at full rate needs longer than ``lead`` to a joint's stop, in
      proportion below, at least ``creep``;
    * joint speed: what brings the velocity of the joints for the path, J_hat^+ x_d' now or as it
      will be when the rate has followed, whichever is larger, to the share ``speed`` of the
      description's limits; less while the rate is still above that. Laws with
      ``Law.keeps_speeds`` keep their whole reference, with feedback and null motion, below 1.06
      times that;
    * singularity, for laws with ``Law.keeps_speeds`` false, whose joints would spin there: 1 while
      J_hat is as far from a singularity as the share ``near`` of home, 0 from ``singular`` on, by
      ``RightInverse.conditioning``. A path that leaves the workspace ends its time there;
    * frames: 1 while the latest frame is as old as the declared camera explains, 0 at ``gap`` more.

    The rate follows the target through two low passes in a row, dy/dt = w (target - y) and
    d(rate)/dt = quick (y - rate), w = ``quick`` where the target is below y and ``recovery`` above:
    the path slows down quickly, critically damped, and recovers slowly. So s is twice continuously
    differentiable, and the rate stays in [0, 1].

    Attributes:
        position: stop error of positions and sliding joints, of the reach.
        angle: stop error of rotations and turning joints [rad].
        slow: of the stop error, from which the path slows.
        hold: of the stop error, from which the path does not move at all.
        creep: least rate below ``hold`` errors and at joint stops.
        effort: of the torque limits of the controller, from which the path slows.
        speed: of the velocity limits that the path may ask for.
        near: of home's distance from a singularity, below which the path slows.
        singular: the same, from which on it stops.
        lead: time to a joint's stop [s].
        gap: by which a frame may be older than the camera explains when the path rests [s].
        blind: by which a frame is older than the camera explains when the step is refused [s].
        quick: bandwidth of the rate [1/s].
        recovery: bandwidth at which it rises again [1/s].

    Raises:
        GainError: numbers that are not positive, or shares that are not in order.
    """

    position: float = 0.05
    angle: float = 0.3
    slow: float = 0.3
    hold: float = 6.0
    creep: float = 0.2
    effort: float = 0.9
    speed: float = 0.85
    near: float = 0.8
    singular: float = 0.4
    lead: float = 0.3
    gap: float = 0.25
    blind: float = 10.0
    quick: float = 20.0
    recovery: float = 2.0

    def __post_init__(self) -> None:
        """Refuse numbers that make no governor."""
        take_checked(self, positive, "governor.", *(part.name for part in fields(self)))
        shares = max(self.slow, self.creep, self.effort)
        if not (shares < 1.0 < self.hold and self.singular < self.near):
            raise GainError(
                "slow, creep and effort must be shares below 1, hold more than 1, and singular "
                f"less than near, got {self}.",
                where="governor",
            )

    def of(self, robot: Robot, task: Task, sensors: Sensors, home: float = 0.0) -> PathGovernor:
        """Return the governor of one robot.

        Args:
            robot: as described.
            task: the controlled coordinates.
            sensors: as declared.
            home: conditioning of J_hat at home; zero for a law that needs no distance from
                singularities.
        """
        model = robot.model
        lower, upper = position_limits(model)
        causes = EFFORT, STOP, SPEED  # as the kernel ``path_rate`` counts them
        of_joints = (f"{what} of {joint}" for what in causes for joint in robot.joint_names)
        length = 1.0 / (self.position * robot.reach)
        weight = task.per_row(length, 1.0 / self.angle)
        return PathGovernor(
            self,
            names=("", ERROR, FRAMES, *of_joints),
            weight=weight,
            positions=-1 if isinstance(task, JointTask) else task.lengths,
            places=np.array(model.idx_qs)[1:],
            lower=lower,
            upper=upper,
            velocity=self.speed * velocity_limits(model),
            frames=explained_age(sensors) + _SPARE,
            near=self.near * home,
            singular=self.singular * home,
        )


def explained_age(sensors: Sensors) -> float:
    """Return the age [s] of the latest frame that the declared camera explains.

    With the share p of lost frames k of them in a row are lost with probability p^k; those with
    less than one in a million are not explained.
    """
    camera = sensors.camera or Camera()
    lost = math.ceil(math.log(1e-6) / math.log(camera.dropout)) if camera.dropout else 0
    return camera.delay + (0.0 if camera.rate is None else (1 + lost) / camera.rate)


@dataclass(frozen=True, eq=False)
class PathGovernor:
    """The governor of one robot: pure functions of a ``PathTime``.

    Attributes:
        settings: as given.
        names: of the causes, by the answer of the kernel.
        weight: (m) one over the stop errors.
        positions: number of positions among the rows of the error; -1 for joints.
        places: where joints without full turns are in q.
        lower, upper: (n) position limits [rad or m].
        velocity: (n) velocities that the path may ask for [rad/s or m/s].
        frames: age of a frame from which the path slows [s].
        near, singular: conditioning of J_hat below which the path slows, and stops; zero for a law
            that needs neither.
    """

    settings: Governor
    names: tuple[str, ...]
    weight: np.ndarray
    positions: int
    places: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    frames: float
    near: float
    singular: float

    def target(
        self,
        path: PathTime,
        dx: np.ndarray,
        q: np.ndarray,
        desired: Moving,
        inverse: RightInverse,
        torque: np.ndarray,
        age: float,
        limits: np.ndarray | None = None,
    ) -> tuple[float, str]:
        """Return the target of the rate and what it comes from, empty at full rate.

        Args:
            path: now.
            dx: (m) task error [m or rad].
            q: (nq) configuration.
            desired: (m) velocity xd_d and (m) acceleration xdd_d of the task coordinates.
            inverse: of J_hat.
            torque: (n) of the motors [N m or N].
            age: of the latest frame [s].
            limits: (n) of the torque [N m or N], None for none.
        """
        given = self.settings
        factors = empty(len(self.names))
        least = kernels.path_rate(
            dx, self.weight, self.positions, given.slow, given.hold, given.creep,
            (age - self.frames) / given.gap,
            torque, torque_bounds(limits, torque.size), given.effort,
            q[self.places], self.lower, self.upper, given.lead,
            *desired, inverse.J, inverse.gram_inverse, self.velocity,
            path.rate, path.acceleration, 2.0 / given.quick, factors,
        )  # fmt: skip
        target = float(factors[least])
        if inverse.conditioning < self.near:
            way = (inverse.conditioning - self.singular) / (self.near - self.singular)
            room = max(way, 0.0)
            if room < path.rate:  # as in the kernel: it follows with more than a lag
                room *= (room / path.rate) ** 2
            if room < target:
                return room, SINGULAR
        return target, self.names[least]

    def step(self, path: PathTime, target: float, cause: str, dt: float) -> PathTime:
        """Return the time of the path after dt [s] with the target held: exact for any dt."""
        lag, rate, acceleration, before = path
        if target == rate == 1.0 and acceleration == 0.0:
            return PathTime(lag)
        w = self.settings.quick
        y = rate + acceleration / w
        w_y = w if target <= y else self.settings.recovery
        # y = target + ahead e_y; rate = target + ahead passed + (rate - target) e
        ahead = y - target
        e = math.exp(-w * dt)
        e_y = math.exp(-w_y * dt)
        passed = w * dt * e if w_y == w else w / (w - w_y) * (e_y - e)
        after = target + ahead * passed + (rate - target) * e
        y_after = target + ahead * e_y
        # d(rate)/dt = w (y - rate): the integral of the rate is that of y less the change over w
        moved = target * dt + ahead * (1.0 - e_y) / w_y - (after - rate) / w
        if target == 1.0 and 1.0 - min(after, y_after) < _DONE:
            return PathTime(lag + dt - moved)
        return PathTime(lag + dt - moved, after, w * (y_after - after), cause or before)

    def rate(self, path: PathTime, target: float, cause: str) -> PathTime:
        """Return the time derivative of the path time, with the present cause."""
        _, rate, acceleration, before = path
        w = self.settings.quick
        y = rate + acceleration / w
        y_rate = (w if target <= y else self.settings.recovery) * (target - y)
        name = cause or (before if rate < 1.0 - _DONE else "")
        return PathTime(1.0 - rate, acceleration, w * (y_rate - acceleration), name)


# of the rate: the path counts as fast as its time again; a hundredth, a hundred times: the same
_DONE = 1e-4
