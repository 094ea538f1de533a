"""Motions inside a robot's limits: a circle of its frame, with an unknown tool; sines of joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, cos, exp, floor, log10, pi, sin, sqrt

import numpy as np
import pinocchio as pin

from .._checks import arithmetic, instance, positive
from ..description.chain import (
    configuration_from_angles,
    effort_limits,
    is_slide,
    position_limits,
    velocity_limits,
)
from ..exceptions import InputError, RobotError
from ..tasks.frame import ImageTask
from ..trajectories.periodic import Circle, Sinusoid
from ..trajectories.pose import PoseCircle
from ..trajectories.trajectory import Trajectory
from .home import MountingPlane
from .robot import Robot

_RATIO, _SIZES = 0.8, 18  # radii tried: a geometric sequence down to 2 % of the largest
_PHASES = (0.0, pi / 2, pi, -pi / 2)
_STEPS, _TURNS = 40, 1.5
_STEPS_PER_CHECK = 10  # singular values of several steps at once cost little more than of one
_LEAST_SINGULAR = 0.5  # relative to the smallest singular value at home
_LIMIT_MARGIN = 0.05  # distance from joint limits, relative to the joint's range
_PERIOD = 3.0  # [s]
_LONGEST = 3600.0  # [s], longest period
_JOINT_SPEED, _SLIDE_SPEED = 1.5, 0.75  # [rad/s], [m/s]
_SPEED_SHARE = 0.8  # of the velocity limits in the description
_RETURN = 4.0  # [rad/s], bandwidth of the return to the home pose in the null space, as in the laws
_SWING, _SLIDE_SWING = 0.3, 0.1  # [rad], [m], largest amplitudes of a joint
_SPREAD = 1.5  # longest period of a joint, relative to the shortest
_SWING_SAMPLES, _HALVINGS = 120, 6
_EFFORT_SHARE = 0.8  # of the effort limits in the description
_TRACKED = 0.05  # [radii] and [rad], largest errors of the inverse kinematics


@dataclass(frozen=True)
class WorkspaceCircle:
    """A circle through the home position, found by ``find_circle``.

    Attributes:
        plane: the two world axes that span it; those of the task if it has two coordinates.
        phase: angle of the home position on the circle, from the first axis [rad].
        radius: [m].
        period: time of one revolution [s].
        least_singular: smallest singular value of the task Jacobian along the circle, relative to
            that at home.
    """

    plane: str
    phase: float
    radius: float
    period: float
    least_singular: float

    def motion(self, size: int) -> Circle:
        """Return the circle around the origin in two or three coordinates; two are its plane."""
        plane = self.plane if size == 3 else "xy"
        return Circle(np.zeros(size), self.radius, self.period, plane, self.phase)


def rounded_down(number: float) -> float:
    """Return a positive number rounded down to two significant digits."""
    unit = 10.0 ** (floor(log10(number)) - 1)
    return float(f"{floor(number / unit + 1e-9) * unit:.2g}")


@arithmetic("robot", RobotError)
def reachable_circle(
    robot: Robot, *, largest: float = 0.1, tool_error: float = 0.05
) -> Circle | PoseCircle:
    """Return a circle that the robot can follow, as a motion that starts at its home position.

    It is the circle of ``find_circle``. For a true robot with another tool, start it where that one
    is: ``reachable_circle(robot).starting_at(true.position(true.q0))``. For a pose task the
    position follows the circle and the orientation is constant.

    Args:
        robot: any robot with a task of its frame; read only.
        largest: largest radius, relative to the reach.
        tool_error: largest error of the described tool position, relative to the reach.

    Raises:
        RobotError: there is no such circle, as the home pose is at a limit or a singularity; or the
            task is the joint task.
    """
    task, start = robot.frame_task, robot.position(robot.q0)
    circle = find_circle(robot, largest=largest, tool_error=tool_error).motion(task.positions)
    circle = circle.shifted(task.position(start) - circle.at(0.0).x_d)
    return circle if task.size == task.positions else PoseCircle(circle, start[3:])


def find_circle(robot: Robot, *, largest: float = 0.1, tool_error: float = 0.05) -> WorkspaceCircle:
    """Return the largest circle through the home position that the robot can follow safely.

    Radii are tried in descending order, each 0.8 times the last, planes and centres in the order of
    their conditioning. Inverse kinematics, with a return to the home pose in the null space as in
    the control laws, follows each circle from home. A circle is accepted if all joints keep a
    distance of 5 % of their range from the limits (less if the home pose is closer) and the
    smallest singular value of the task Jacobian stays above half of its value at home. This is
    required with the tool as described and with a tool displaced by the tool error in both
    directions along each axis of the frame; singular values are those of both Jacobians. If the
    home pose is on the right side of the mounting plane, so is the whole motion.

    The period is 3 s, or 3 sqrt(L) s for a reach of L > 1 m. It is longer if joints would exceed
    1.5 rad/s, slides 0.75 m/s, or either of them 80 % of the velocity limits in the description.

    For a pose task the orientation is that at home. The rotational rows of its Jacobian are
    multiplied by the reach, so that all singular values have the unit m/rad.

    Args:
        robot: any robot with a task of its frame; read only.
        largest: largest radius, relative to the reach.
        tool_error: largest error of the described tool position, relative to the reach.

    Raises:
        RobotError: there is no such circle, as the home pose is at a limit or a singularity; or the
            task is the joint task or a picture.
    """
    instance(robot, Robot, "robot")
    for given, where in ((largest, "largest"), (tool_error, "tool_error")):
        positive(given, where, zero=where == "tool_error", error=InputError)
    if isinstance(robot.task, ImageTask):
        raise RobotError(
            "a picture has no circle in space.",
            where="task",
            hint="Find one for the same robot before filmed_by, or draw a motion in the picture.",
        )
    length = robot.reach
    planes = [robot.frame_task.name] if robot.frame_task.positions == 2 else ["xy", "yz", "xz"]
    followers = [_Follower(robot, shift) for shift in _shifts(tool_error * length)]
    for size in largest * length * _RATIO ** np.arange(_SIZES):
        paths = [
            _Path(plane, phase, rounded_down(size)) for plane, phase in product(planes, _PHASES)
        ]
        first = [(followers[0].follow(path), path) for path in paths]
        for run, path in sorted(
            ((r, p) for r, p in first if r), key=lambda found: -found[0].least_singular
        ):
            runs = [run, *_while_found(follower.follow(path) for follower in followers[1:])]
            if len(runs) == len(followers):
                return _circle(robot, path, runs, length)
    raise RobotError(
        f"no circle through the home pose {np.round(robot.home_angles, 3).tolist()} stays inside "
        "the joint limits and away from singularities.",
        where=robot.name,
        hint="Give a home pose q0 further from both"
        + (', or take a plane as the task, such as "yz".' if len(planes) > 1 else "."),
    )


@dataclass(frozen=True)
class JointSwing:
    """Sines of all joints from home, found by ``find_swing``: each joint goes away and comes back.

    Attributes:
        amplitude: (nv) half the way of each joint [rad or m], negative where it goes down.
        period: (nv) [s], all different.
    """

    amplitude: np.ndarray
    period: np.ndarray

    def motion(self, start: np.ndarray) -> Trajectory:
        """Return the motion that starts at rest at joint positions (nv) [rad or m]."""
        return Sinusoid(start, self.amplitude, self.period).starting_at(start)


@arithmetic("robot", RobotError)
def find_swing(robot: Robot) -> JointSwing:
    """Return sines of all joints that a robot can follow from its home pose.

    Each joint goes by up to 0.6 rad, or 0.2 m, to the side of its range with more room, or else all
    of them to the other side, and keeps 5 % of its range from the limit. The periods differ, so
    that the joints pass many poses together: the shortest is 3 s, or 3 sqrt(L) s for a reach of L >
    1 m. The amplitudes are smaller where joints would exceed 80 % of their velocity limits. All of
    them are halved until the chain stays on its side of the mounting plane, and the torques of the
    described robot within 80 % of the effort limits, but no more than five times.

    Args:
        robot: any robot; read only.

    Raises:
        RobotError: the home pose of a joint is outside its limits.
    """
    model, home = instance(robot, Robot, "robot").model, robot.home_angles
    lower, upper = position_limits(model)
    if (home < lower).any() or (home > upper).any():
        raise RobotError(
            f"the home pose {np.round(home, 3).tolist()} is outside the joint limits.",
            where=robot.name,
            hint="Give another home pose q0.",
        )
    margin = np.where(np.isfinite(upper - lower), _LIMIT_MARGIN * (upper - lower), 0.0)
    first = _PERIOD * sqrt(max(robot.reach, 1.0))
    period = np.round(first * np.linspace(1.0, _SPREAD, model.nv), 1)
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    most = np.minimum(
        np.where(slides, _SLIDE_SWING, _SWING),
        _SPEED_SHARE * velocity_limits(model) * period / (2.0 * pi),
    )
    margin = np.where(np.isfinite(upper - lower), _LIMIT_MARGIN * (upper - lower), 0.0)
    room = np.array([upper - home, home - lower]) - margin
    up = room[0] >= room[1]
    for share in 0.5 ** np.arange(_HALVINGS):
        for side in (up, ~up):  # what sinks towards the plane on one side rises on the other
            way = np.minimum(share * most, np.maximum(np.where(side, *room), 0.0) / 2.0)
            amplitude = np.array([rounded_down(a) if a else 0.0 for a in way])
            swing = JointSwing(np.where(side, amplitude, -amplitude), period)
            if _stays(robot, swing):
                return swing
    return swing


def _stays(robot: Robot, swing: JointSwing) -> bool:
    """Return whether a motion of the joints stays above the plane and within the efforts."""
    model, data, efforts = robot.model, robot.model.createData(), effort_limits(robot.model)
    held = np.abs(pin.computeGeneralizedGravity(model, data, robot.q0))
    efforts = np.maximum(_EFFORT_SHARE * efforts, 1.05 * held)  # where gravity needs more at home
    plane = robot.mounting
    if plane is not None and plane.distance(model, data, robot.frame_id, robot.q0) < 0.0:
        plane = None
    motion = swing.motion(robot.home_angles)
    for t in np.linspace(0.0, _SPREAD * float(swing.period.max()), _SWING_SAMPLES):
        desired = motion.at(float(t))
        q = configuration_from_angles(model, desired.x_d)
        torque = pin.rnea(model, data, q, desired.xd_d, desired.xdd_d)
        if (np.abs(torque) > efforts).any():
            return False
        if plane is not None and plane.distance(model, data, robot.frame_id, q) < 0.0:
            return False
    return True


@dataclass(frozen=True)
class _Path:
    """A circle that starts at the home position."""

    plane: str
    phase: float
    radius: float

    def offset(self, angle: float) -> dict[str, float]:
        """Return axis -> displacement [m] from the home position after an angle [rad]."""
        along = cos(angle + self.phase) - cos(self.phase), sin(angle + self.phase) - sin(self.phase)
        return {axis: self.radius * part for axis, part in zip(self.plane, along, strict=True)}


@dataclass(frozen=True)
class _Run:
    """The result of following a circle.

    Attributes:
        speeds: (nv) largest joint velocities [rad or m per rad of the circle].
        least_singular: as in ``WorkspaceCircle``.
    """

    speeds: np.ndarray
    least_singular: float


class _Follower:
    """Inverse kinematics by damped least squares, for a tool displaced by a shift (3) [m]."""

    def __init__(self, robot: Robot, shift: np.ndarray) -> None:
        self._task, self._q0 = robot.frame_task, robot.q0
        m = robot.frame_task.positions
        self._arms = np.repeat([1.0, robot.reach], [m, robot.frame_task.size - m])  # [m/rad]
        self._model = robot.model.copy()
        self._described = robot.frame_id
        frame = self._model.frames[self._described]
        moved = frame.placement * pin.SE3(np.eye(3), shift)
        self._tool = self._model.addFrame(
            pin.Frame("moved tool", frame.parentJoint, 0, moved, pin.FrameType.OP_FRAME)
        )
        self._data = self._model.createData()
        self._low, self._high = _allowed(robot)
        self._plane = robot.mounting if self._clear(robot.mounting, self._q0) else None
        pin.computeJointJacobians(self._model, self._data, self._q0)
        self._home = _least_singular([self._jacobian(self._described)])
        self._frames = (self._tool, self._described) if shift.any() else (self._tool,)
        joints = [placement.translation for placement in list(self._data.oMi)[2:]]
        self._points = [*joints, self._data.oMf[self._tool].translation]  # views

    def follow(self, path: _Path) -> _Run | None:
        """Follow a circle; return None if it comes too close to a limit or a singularity."""
        model, data, task, q = self._model, self._data, self._task, self._q0
        home_share = 1.0 - exp(-_RETURN * _PERIOD / _STEPS)
        damping = (0.01 * self._home) ** 2 * np.eye(task.size)
        offsets, passed = self._offsets(path), list[np.ndarray]()
        speeds, least = np.zeros(model.nv), np.inf
        for k in range(len(offsets) - 1):
            pin.computeJointJacobians(model, data, q)
            x = task.of(pin.updateFramePlacement(model, data, self._tool))
            if (q < self._low).any() or (q > self._high).any() or not self._above():
                return None
            J, *_ = Js = [self._jacobian(frame) for frame in self._frames]
            passed += Js
            if k % _STEPS_PER_CHECK == 0:
                least, passed = min(least, _least_singular(passed)), []
                if least < _LEAST_SINGULAR * self._home:
                    return None
            if k == 0:
                start, target = x, task.moved(x, offsets[0])
            off = task.error(target, x)
            away, turned = off[: task.positions], off[task.positions :]
            if away.dot(away) > (_TRACKED * path.radius) ** 2 or turned.dot(turned) > _TRACKED**2:
                return None
            psi = home_share * pin.difference(model, q, self._q0)
            target = task.moved(start, offsets[k + 1])
            to_go = self._arms * task.error(target, x)
            step = psi + J.T @ np.linalg.solve(J @ J.T + damping, to_go - J @ psi)
            speeds = np.maximum(speeds, np.abs(step))
            q = pin.integrate(model, q, step)
        return _Run(speeds * _STEPS / (2 * pi), least / self._home)

    def _clear(self, plane: MountingPlane | None, q: np.ndarray) -> bool:
        """Return whether the chain is on its side of the mounting plane, if there is one."""
        return plane is None or plane.distance(self._model, self._data, self._tool, q) >= 0.0

    def _above(self) -> bool:
        """As ``_clear``, for the configuration to which the placements in ``_data`` belong."""
        plane = self._plane
        if plane is None:
            return True
        heights = [self._points[i][2] - plane.level for i in plane.movable]
        return bool(min(heights) >= 0.0 if plane.side > 0.0 else max(heights) <= 0.0)

    def _offsets(self, path: _Path) -> np.ndarray:
        """Return the displacement (steps + 1, m) from home at each step, and after the last."""
        labels, steps = self._task.labels, int(_TURNS * _STEPS) + 2
        offsets = [path.offset(2 * pi * k / _STEPS) for k in range(steps)]
        return np.array([[offset.get(label, 0.0) for label in labels] for offset in offsets])

    def _jacobian(self, frame: int) -> np.ndarray:
        J = pin.getFrameJacobian(self._model, self._data, frame, pin.LOCAL_WORLD_ALIGNED)
        return self._arms[:, None] * J[self._task.rows]


def _least_singular(Js: Sequence[np.ndarray]) -> float:
    """Return the smallest singular value of all matrices (m, n)."""
    J = np.array(Js)
    return sqrt(max(np.linalg.eigvalsh(J @ J.swapaxes(1, 2))[:, 0].min(), 0.0))


def _shifts(size: float) -> list[np.ndarray]:
    """Return shifts (3) of the tool: zero, then both directions along each axis."""
    return [np.zeros(3), *(size * side * axis for side in (1.0, -1.0) for axis in np.eye(3))]


def _while_found(runs: Iterable[_Run | None]) -> Iterator[_Run]:
    for run in runs:
        if run is None:
            return
        yield run


def _allowed(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper bounds (nq) of the configurations that are allowed."""
    model, q0 = robot.model, robot.q0
    lower, upper = position_limits(model)
    low, high = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
    for joint in model.joints[1:]:
        i, k = joint.idx_v, joint.idx_q
        if joint.nq == 1 and np.isfinite(lower[i]):
            margin = _LIMIT_MARGIN * (upper[i] - lower[i])
            low[k] = lower[i] + min(margin, max((q0[k] - lower[i]) / 2, 0.0))
            high[k] = upper[i] - min(margin, max((upper[i] - q0[k]) / 2, 0.0))
    return low, high


def _circle(robot: Robot, path: _Path, runs: list[_Run], length: float) -> WorkspaceCircle:
    """Return the circle with a period at which no run exceeds the velocity limits."""
    speeds = np.max([run.speeds for run in runs], axis=0)
    allowed = np.array(
        [_SLIDE_SPEED if is_slide(joint) else _JOINT_SPEED for joint in robot.model.joints[1:]]
    )
    allowed = np.minimum(allowed, _SPEED_SHARE * velocity_limits(robot.model))
    period = max(_PERIOD * sqrt(max(length, 1.0)), float(np.max(2 * pi * speeds / allowed)))
    if period > _LONGEST:
        raise RobotError(
            f"the velocity limits {velocity_limits(robot.model).tolist()} rad/s or m/s are too "
            f"low: one circle takes {period:.3g} s.",
            where=robot.name,
            hint="Correct the limits in the description; 0 means no limit.",
        )
    least = min(run.least_singular for run in runs)
    return WorkspaceCircle(path.plane, path.phase, path.radius, ceil(10 * period) / 10, least)
