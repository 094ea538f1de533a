"""Motions inside a robot's limits: a circle of its frame, with an unknown tool; sines of joints."""

from __future__ import annotations

from itertools import product, takewhile
from math import ceil, floor, log10, pi, sqrt
from typing import Any

import numpy as np
import pinocchio as pin

from .._checks import arithmetic, instance
from ..description.chain import (
    Bounds,
    angles_from_configuration,
    configuration_from_angles,
    effort_limits,
    position_limits,
    velocity_limits,
)
from ..exceptions import RobotError
from ..tasks.frame import FrameTask, ImageTask
from ..trajectories.periodic import PLANES, Circle, Sinusoid
from ..trajectories.pose import PoseCircle
from ..trajectories.stacked import Stacked
from .constraints import Constraints
from .home import MARGIN
from .robot import Robot

# of the tool as described, relative to the reach; half, twice: two, three of 129 radii change
TOOL_ERROR = 0.05
# radii tried: a geometric sequence down to 2 % of the largest; half, twice as many in it: the same
# of twenty robots
_RATIO, _SIZES = 0.8, 18
_STEPS = 40  # of the inverse kinematics a turn; 20, 80: the same radii of all robots
# relative to the smallest singular value at home; 0.25: three of 129 robots get larger circles
_LEAST_SINGULAR = 0.5
# [s], of a circle at a reach of 1 m and less, and of the fastest joint of a swing; half: twice as
# fast, four times the accelerations
_PERIOD = 3.0
# [rad/s], largest on a circle; of a slide half of it in m/s; half: longer periods of fast joints
_SPEED = 1.5
# of the way from the middle of the feet to their edge, for the centre of mass; half and twice: an
# A1 circles with 39 and 96 mm in place of 61, and errs by 0.9 and 2.1 mm in place of 1.0 at first
# under 5 kg that nobody announced
_BALANCE = 0.5
SHARE = 0.8  # of the velocity and effort limits in the description; half: slower, 1: at the limits


def rounded_down(number: float) -> float:
    """Return a positive number rounded down to two significant digits."""
    unit = 10.0 ** (floor(log10(number)) - 1)
    return float(f"{floor(number / unit + 1e-9) * unit:.2g}")


@arithmetic("robot", RobotError)
def reachable_circle(robot: Robot) -> Circle | PoseCircle:
    """Return a circle that the robot can follow, as a motion that starts at its home position.

    It is the circle of ``find_circle``. For a true robot with another tool, start it where that one
    is: ``reachable_circle(robot).starting_at(true.position(true.q0))``. For a pose task the
    position follows the circle and the orientation is constant.

    Args:
        robot: any robot with a task of its frame; read only.

    Raises:
        RobotError: there is no such circle, as the home pose is at a limit or a singularity; or the
            task is the joint task, or one of several frames.
    """
    return _from_home(robot, find_circle(robot))


@arithmetic("robot", RobotError)
def reachable_circles(robot: Robot) -> Stacked:
    """Return circles that several frames can follow at once, each from where it is at home.

    All are the circle of ``find_circle``; beside that as ``reachable_circle``.

    Args:
        robot: with two task frames or more; read only.

    Raises:
        RobotError: as ``reachable_circle``.
        InputError: there is one task frame.
    """
    found = find_circle(robot)
    return Stacked([_from_home(robot.of_frame(frame), found) for frame in robot.frames])


def _from_home(robot: Robot, circle: Circle) -> Circle | PoseCircle:
    """Return a circle that starts where the task frame is at home, with its orientation there."""
    task = robot.frame_task
    start = robot.position(robot.q0)
    circle = circle.shifted(start[: task.lengths] - circle.at(0.0).x_d)
    return circle if task.size == task.lengths else PoseCircle(circle, start[3:])


def find_circle(robot: Robot) -> Circle:
    """Return the largest circle through the home position that the robot can follow safely.

    Its centre is zero; for a task of two coordinates its plane is "xy", whichever these are.

    Radii are tried in descending order from a tenth of the reach, each 0.8 times the last, planes
    and centres in the order of their conditioning. Inverse kinematics, with a return to the home
    pose in the null space as in the control laws, follows each circle from home. A circle is
    accepted if all joints keep a distance of 5 % of their range from the limits (less if the home
    pose is closer) and the smallest singular value of the task Jacobian stays above half of its
    value at home. This is required with the tool as described and with a tool displaced by 5 % of
    the reach in both directions along each axis of the frame; singular values are those of its
    Jacobian. If the home pose is on the right side of the mounting plane, so is the whole motion.

    The period is 3 s, or 3 sqrt(L) s for a reach of L > 1 m. It is longer if joints would exceed
    1.5 rad/s, slides 0.75 m/s, or either of them 80 % of the velocity limits in the description.

    Several frames follow the circle at the same time, each from its own position at home, with all
    tools displaced alike.

    For a pose task the orientation is that at home. The rotational rows of its Jacobian are
    multiplied by the reach, so that all singular values have the unit m/rad.

    Under constraints the rows of A are appended to the Jacobian. Of a robot that stands, the centre
    of mass stays above the inner half of the area between its contacts.

    Args:
        robot: any robot with a task of its frame; read only.

    Raises:
        RobotError: there is no such circle, as the home pose is at a limit or a singularity; or the
            task is the joint task or a picture.
    """
    instance(robot, Robot, "robot")
    if isinstance(robot.task, ImageTask):
        raise RobotError(
            "a picture has no circle in space.",
            where="task",
            hint="Find one for the same robot before filmed_by, or draw a motion in the picture.",
        )
    length = robot.reach
    task = robot.of_frame(robot.frame).frame_task
    planes = PLANES[: 3 if task.lengths == 3 else 1]
    shifts = TOOL_ERROR * length * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    described, *others = [
        robot.changed(tool_translation=dict.fromkeys(robot.frames, shift)) for shift in shifts
    ]
    for size in 0.1 * length * _RATIO ** np.arange(_SIZES):
        paths = [
            Circle(np.zeros(task.lengths), rounded_down(size), 1.0, plane, phase)
            for plane, phase in product(planes, (0.0, pi / 2, pi, -pi / 2))
        ]
        followed = [(run, path) for path in paths if (run := _follow(robot, described, path))]
        for first, path in sorted(followed, key=lambda found: -found[0][0]):
            more: Any = takewhile(bool, (_follow(robot, other, path) for other in others))
            periods = [period for _, period in (first, *more)]
            if len(periods) > len(others):
                period = ceil(10.0 * max(_PERIOD * sqrt(max(length, 1.0)), *periods)) / 10.0
                return Circle(path.center, path.radius, period, path.plane, path.phase)
    feet = ""
    other = 'or take a plane as the task, such as "yz"'
    if robot.contacts:
        feet = ", with the centre of mass above the feet"
        other = "with bent knees"
    raise RobotError(
        f"no circle through the home pose {np.round(robot.home_angles, 3).tolist()} stays inside "
        f"the joint limits and away from singularities{feet}.",
        where=robot.name,
        hint=f"Give a home pose q0 further from them, {other}.",
    )


@arithmetic("robot", RobotError)
def find_swing(robot: Robot) -> Sinusoid:
    """Return sines of the joints with motors that a robot can follow from its home pose.

    Each joint goes by up to 0.6 rad, or 0.2 m, to the side of its range with more room, and keeps 5
    % of its range from the limit; all go to the other side if the torques of the described robot
    exceed 80 % of the effort limits. The periods differ, so that the joints pass many poses
    together: the shortest is 3 s, or 3 sqrt(L) s for a reach of L > 1 m. The amplitudes are smaller
    where joints would exceed 80 % of their velocity limits.

    Args:
        robot: any robot; read only. A joint whose home pose is outside its limits stays there.
    """
    model = robot.model
    home = robot.home_angles
    lower, upper = position_limits(model)
    period = _PERIOD * sqrt(max(robot.reach, 1.0)) * np.linspace(1.0, 1.5, model.nv)
    period = np.round(period, 1)
    most = np.minimum(
        np.where(robot.sliding, 0.1, 0.3),  # [m], [rad]
        SHARE * velocity_limits(model) * period / (2.0 * pi),
    )
    room = np.array([upper - home, home - lower]) - margins(lower, upper)
    up = room[0] >= room[1]
    own = robot.motors  # of all others the constraints decide
    for side in (up, ~up):  # what falls on one side rises on the other
        way = np.minimum(most, np.maximum(np.where(side, *room), 0.0) / 2.0)
        way = np.array([rounded_down(a) if a else 0.0 for a in way])
        amplitude = np.where(side, way, -way)
        if _strong_enough(robot, Sinusoid(home + amplitude, amplitude, period)):
            break
    return Sinusoid((home + amplitude)[own], amplitude[own], period[own])


def _strong_enough(robot: Robot, swing: Sinusoid) -> bool:
    """Return whether the torques of a motion of the joints are within the efforts."""
    model = robot.model
    data = model.createData()
    torques = []
    for angles, v, a in map(swing.at, np.linspace(0.0, swing.period.max(), 80)):
        q = configuration_from_angles(model, angles)
        torques.append(pin.rnea(model, data, q, v, a))
    held = np.abs(pin.computeGeneralizedGravity(model, data, robot.q0))
    # where gravity needs more at home
    efforts = np.maximum(SHARE * effort_limits(model), 1.05 * held)
    return bool((np.abs(torques) <= efforts).all())


def _follow(robot: Robot, tool: Robot, path: Circle) -> tuple[float, float] | None:
    """Follow a circle by damped least squares, up to a limit or a singularity.

    Args:
        robot: as described.
        tool: the robot with a displaced tool, which follows.
        path: the circle.

    Returns:
        The smallest singular value, relative to that of ``robot`` at home; the least period [s] at
        which no joint is faster than it may be. None if the circle comes too close to a limit or a
        singularity.
    """
    model = tool.model
    data = model.createData()
    task = robot.task
    q = robot.q0
    assert isinstance(task, FrameTask)
    count = len(robot.frames)
    arms = task.per_row(1.0, robot.reach)  # [m/rad]
    low, high = range_within_limits(robot)
    constraints = tool.constrained

    def jacobian(of: Robot, q: np.ndarray) -> np.ndarray:
        """Return the task Jacobian at a configuration (nq), all rows in [m/rad], and A."""
        J = arms[:, None] * task.linear_map(of.model, data, of.frame_id, q)[1]
        return np.vstack([J, constraints.jacobian(q)]) if robot.constraints else J

    at_home = np.linalg.svd(jacobian(robot, q), compute_uv=False)[-1]
    ways = path.positions(np.arange(_STEPS + 2) / _STEPS) - path.at(0.0).x_d
    least = np.inf
    places = [q]
    fastest = np.zeros(model.nv)
    start = tool.position(q)
    for way in ways[1:]:
        angles = angles_from_configuration(model, q)
        J = jacobian(tool, q)
        U, singular, V = np.linalg.svd(J, full_matrices=False)
        least = min(least, float(singular[-1] / at_home))
        if least < _LEAST_SINGULAR or (angles < low).any() or (angles > high).any():
            return None
        if robot.contacts and not _balanced(tool, constraints, q):
            return None
        offset = np.append(np.tile(way, count), np.zeros(task.size - task.lengths))
        x = task.at(model, data, tool.frame_id, q)
        to_go = np.zeros(len(J))  # constraints hold
        to_go[: task.size] = arms * task.error(task.moved(start, offset), x)
        psi = 10.0 / _STEPS * pin.difference(model, q, robot.q0)  # half, twice: the same radii
        step = psi + V.T @ (U.T @ (to_go - J @ psi) / singular)
        fastest = np.maximum(fastest, np.abs(step))
        q = pin.integrate(model, q, step)
        places.append(q)
    distances = robot.mounting.distances(model, tool.frame_id, places)
    if distances[0] >= 0.0 > distances.min():
        return None
    speeds = np.where(robot.sliding, _SPEED / 2.0, _SPEED)
    speeds = np.minimum(speeds, SHARE * velocity_limits(model))
    return least, float((fastest * _STEPS / speeds).max())


def _balanced(robot: Robot, constraints: Constraints, q: np.ndarray) -> bool:
    """Return whether the centre of mass is well above the feet at a configuration (nq).

    That is the configuration at which the constraints were last looked at.
    """
    from scipy.optimize import nnls  # here, because few robots stand

    placed = zip(robot.contacts, constraints.placements, strict=True)
    points = np.array([place.act(each)[:2] for part, place in placed for each in part.corners])
    middle = constraints.feet[:, :2].mean(axis=0)
    at = middle + (pin.centerOfMass(robot.model, constraints.data, q)[:2] - middle) / _BALANCE
    _, off = nnls(np.vstack([points.T, np.ones(len(points))]), np.append(at, 1.0))
    return bool(off < 1e-9)  # a convex combination, but for rounding


def range_within_limits(robot: Robot) -> Bounds:
    """Return a range of the joints (2, nv) [rad or m] with a margin to their limits.

    Where home is closer to a limit than two margins, it is half of that.
    """
    limits = position_limits(robot.model)
    inward = np.array([[1.0], [-1.0]])
    room = inward * (robot.home_angles - limits)
    return limits + inward * np.clip(room / 2, 0.0, margins(*limits))


def margins(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return the distances (nv) [rad or m] to keep from joint limits, zero where there are none."""
    return np.where(np.isfinite(lower), MARGIN * (upper - lower), 0.0)
