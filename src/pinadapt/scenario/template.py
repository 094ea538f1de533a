"""A new scenario for a robot: frame, task, home, tool, load, friction and a safe motion."""

from __future__ import annotations

import os
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from math import ceil, cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import tomlkit
from tomlkit.items import Comment, InlineTable, Table

from ..adaptation.adaptation import Adaptation, Stacked, Wrapper
from ..adaptation.natural import ExponentiatedGradient, Natural
from ..controller.controller import Controller
from ..description.chain import links_of, massless_joints
from ..description.description import describe
from ..description.urdf import is_path
from ..description.xacro import XacroArguments
from ..exceptions import InputError, RobotError
from ..laws import DEFAULT, LAWS
from ..models.joint_effects import typical_coefficients
from ..robot.changes import Payload
from ..robot.loading import JOINT, PLANES, load
from ..robot.robot import Robot
from ..robot.workspace import JointSwing, WorkspaceCircle, find_circle, find_swing
from ..tasks.frame import IMAGE, pinhole_camera
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown
from .schema import PinholeSection, SimulationSection

_MEANINGS = {
    "alpha": "gain of the position error in the reference velocity [1/s]",
    "beta": "gain of the position observer [1/s]",
    "lag": "limits the damping rates to 1 / lag [s]",
    "R_k": "weight of the tool's prediction error",
    "lambda_": "velocity filter [1/s]",
    "lambda_a": "acceleration filter [s]",
    "width": "position error at which the feedback saturates [m, for rotations rad]",
    "bound": "largest torque [N m or N]",
    "gravity": "part of the bound reserved for gravity [N m or N]",
}


def default_gains(controller: Controller) -> Iterable[tuple[str, str, str]]:
    """Return key, value as written, and meaning with unit of each default gain."""
    law: Any = controller.law
    velocity, position = law.units
    if _diagonal(law.K_v):  # a full matrix is too long for a comment
        yield "Kv", _gain(law.K_v), f"velocity gain [{velocity}]"
    if hasattr(law, "K_P") and position:  # else it follows from the other gains
        yield "Kp", _gain(law.K_P), f"position gain [{position}]"
    for name, meaning in _MEANINGS.items():
        framed = name in ("lambda_", "R_k")  # of the frame's velocity and position
        if hasattr(law, name) and (controller.kinematics.task.positions or not framed):
            yield name.rstrip("_"), _gain(getattr(law, name)), meaning
    if law.learns_from_torque:  # its rates depend on the prediction
        return
    bodies, joints = _parts(controller.adaptation_d)
    yield "gamma_d", _gain(bodies.gamma), "rate of the inertial parameters"
    if joints is not None:
        yield "gamma_joint", _gain(joints.gamma), "rate of armature and friction"
    known = controller.kinematics.calibrated  # else they are too many for a comment
    if law.learns_kinematics and controller.kinematics.size and known:
        rate_k = controller.adaptation_k.gain(controller.kinematics.initial)
        yield "gamma_k", _gain(rate_k), "rate of the tool"


def _diagonal(gain: np.ndarray) -> bool:
    """Return whether a gain (n, n) is diagonal."""
    return bool((np.diag(np.diag(gain)) == gain).all())


def _parts(adaptation: Adaptation) -> tuple[Natural, ExponentiatedGradient | None]:
    """Return the adaptations of bodies and of joint coefficients in a default adaptation."""
    while isinstance(adaptation, Wrapper):
        adaptation = adaptation.inner
    parts = (
        [part for part, _ in adaptation.parts] if isinstance(adaptation, Stacked) else [adaptation]
    )
    bodies, *joints = parts
    assert isinstance(bodies, Natural)  # the default
    joint = joints[0] if joints else None
    assert joint is None or isinstance(joint, ExponentiatedGradient)
    return bodies, joint


def _gain(gain: float | np.ndarray) -> str:
    """Return a gain as text: a number if all entries are equal, else a list."""
    numbers = np.asarray(gain)
    values = [three_digits(x) for x in (np.diag(numbers) if numbers.ndim == 2 else numbers.flat)]
    return str(values[0]) if len(set(values)) == 1 else str(values)


def three_digits(number: float) -> float:
    """Return a number rounded to three significant digits."""
    return float(f"{number:.3g}")


_AWAY, _ASIDE = 2.0, (0.25, 0.2)  # reaches to a camera; its way aside, relative to that before
_FOCAL = PinholeSection(position=[0.0] * 3).focal
_SMALLER = 0.8  # radius of the circle in a picture, relative to that of the circle in space
_TOOL = 0.05  # length of the unknown tool, relative to the reach
_LOAD = 0.05  # mass of the unknown load, relative to the moving mass
_FRICTION = 0.5  # unknown friction, relative to what is typical for a robot of this size


@dataclass(frozen=True)
class Template:
    """A scenario to be written.

    Attributes:
        source: a path or a name of a robot.
        robot: the robot as described, at its home pose.
        path: a motion that it can follow: a circle, or for a joint task sines of its joints.
        xacro: arguments of a xacro file.
        mass: total mass of the robot [kg], if links are described without inertia; else None.
        massless: names of these links, one for each such body.
        law: name of the control law.
        tracker: whether x is measured in the axes of a tracker whose placement is unknown.
        planar: whether the task is a plane because no circle in space is within the limits.
        filmed: whether the task is the picture of an uncalibrated camera.
    """

    source: str
    robot: Robot
    path: WorkspaceCircle | JointSwing
    xacro: XacroArguments
    mass: float | None
    massless: Sequence[str]
    law: str = DEFAULT
    planar: bool = False
    tracker: bool = False
    filmed: bool = False

    @classmethod
    def of(
        cls,
        source: str,
        *,
        frame: str | None = None,
        task: str | None = None,
        xacro: XacroArguments | None = None,
        mass: float | None = None,
        law: str = DEFAULT,
        tracker: bool = False,
    ) -> Template:
        """Load a robot, with the choices of ``load`` for what is not given, and find a motion.

        A law of joint space gets the joint task. Where a task in space is not asked for and no
        circle in space is within the limits, the task is the plane with the largest circle.

        Raises:
            RobotError: as ``load``, ``find_circle`` and ``find_swing``.
            InputError: a tracker or a camera for a law that does not learn from positions, or a
                tracker for a joint task or a picture.
        """
        filmed = task == IMAGE
        if tracker and (task == JOINT or filmed or not LAWS[law].uses_position_error):
            raise InputError(
                "a tracker needs a task of the frame and a law that learns from positions.",
                where="--tracker",
                hint='Take the law "separation".',
            )
        if filmed and not LAWS[law].uses_position_error:
            raise InputError(
                f"the law '{law}' does not learn from positions, which a picture needs.",
                where="--law",
                hint='Take the law "separation".',
            )
        task = None if filmed else task
        if task is None and LAWS[law].joint_space:
            task = JOINT
        make = partial(load, source, xacro=xacro, mass=mass)
        robot, planar = make(frame=frame, task=task), False
        path: WorkspaceCircle | JointSwing
        try:
            path = find_circle(robot) if robot.task.positions else find_swing(robot)
        except RobotError:
            planes = PLANES if task is None and robot.task.positions == 3 else ()
            found = list(_in_planes(robot, make, planes))
            if not found:
                raise
            (robot, path), planar = max(found, key=lambda both: both[1].radius), True
        massless: list[str] = []
        if mass is not None:
            model = describe(source, xacro=xacro).model
            massless = [links_of(model, joint)[0] for joint in massless_joints(model)]
        plane = planar and not filmed  # a picture is planar anyway
        return cls(source, robot, path, xacro or {}, mass, massless, law, plane, tracker, filmed)

    @property
    def name(self) -> str:
        """Name of the file, and the title."""
        if not is_path(self.source):
            return self.source
        return Path(self.source.removesuffix(".xacro")).stem

    @property
    def tool_share(self) -> float:
        """Length of the unknown tool, relative to the reach."""
        return _TOOL

    @property
    def load_share(self) -> float:
        """Mass of the unknown load, relative to the moving mass."""
        return _LOAD

    @cached_property
    def tool(self) -> np.ndarray:
        """The unknown tool (3) [m], in the frame's axes."""
        return _further_out(self.robot)

    @cached_property
    def load(self) -> Payload:
        """The unknown load, a ball at the end of the unknown tool."""
        gyration = 0.5 * _TOOL * self.robot.reach * 0.4**0.5
        return _ball(three_digits(_LOAD * self.robot.mass), gyration, self.tool)

    @cached_property
    def controller(self) -> Controller:
        """The controller with default gains for the robot as described."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file itself contains what matters
            return make_controller(
                self.robot.filmed_by(pixel=self.pixel) if self.filmed else self.robot,
                law=self.law,
                unknown=Unknown.of_tables(**self.unknown),
                dt=SimulationSection().dt,
            )

    @cached_property
    def camera(self) -> np.ndarray:
        """Where a camera stands (3) [m], in the axes of the base: before the circle's plane."""
        path, p = self.path, self.robot.placement(self.robot.q0).translation
        assert isinstance(path, WorkspaceCircle)
        first, second = ("xyz".index(axis) for axis in path.plane)
        E = np.eye(3)
        normal = E[3 - first - second]
        if p @ normal < 0.0:
            normal = -normal
        away = normal + _ASIDE[0] * E[first] + _ASIDE[1] * E[second]
        return np.round(p + _AWAY * self.robot.reach * away / np.linalg.norm(away), 2)

    @property
    def _covered(self) -> float:
        """Length [m] that a pixel covers at the tool."""
        p = self.robot.placement(self.robot.q0).translation
        return float(np.linalg.norm(self.camera - p)) / _FOCAL

    @property
    def pixel(self) -> float:
        """Stated length [m] that a pixel covers, to one digit."""
        return float(f"{self._covered:.1g}")

    @property
    def picture(self) -> tuple[float, float]:
        """Radius [pixels] of the circle in the picture, and its phase at the start [rad]."""
        path, p = self.path, self.robot.placement(self.robot.q0)
        assert isinstance(path, WorkspaceCircle)
        H = pinhole_camera(self.camera, p.translation, _FOCAL)
        E, (first, second) = np.eye(6), ("xyz".index(axis) for axis in path.plane)
        out = cos(path.phase) * E[first, :3] + sin(path.phase) * E[second, :3]
        u, v, _ = H[:, :3] @ out
        radius = float(f"{_SMALLER * path.radius / self._covered:.2g}")
        return radius, round(float(np.arctan2(v, u)), 3)

    @property
    def unknown(self) -> dict[str, Any]:
        """The keys of [unknown]."""
        if self.rests:
            return {"dynamic": "all"}
        words = [*["tracker"] * self.tracker, *["camera"] * self.filmed, "tool"]
        tool: dict[str, Any] = {"kinematic": words} if self.robot.task.positions else {}
        return {**tool, "dynamic": "all", "joint": "all"}

    @cached_property
    def friction(self) -> tuple[list[float], list[float]]:
        """The unknown viscous and Coulomb friction, one number per joint."""
        _, viscous, coulomb = _FRICTION * typical_coefficients(self.robot)
        return _numbers(viscous, 2), _numbers(coulomb, 2)

    @property
    def rests(self) -> bool:
        """Whether the law regulates to a set point; it is the opposite point of the motion."""
        return LAWS[self.law].set_point

    @property
    def words(self) -> str:
        """Frame, task and motion in words."""
        robot, path = self.robot, self.path
        if self.rests:
            way = "to a set point"
        elif isinstance(path, JointSwing):
            way = f"sines of all joints in {path.period.min():g} to {path.period.max():g} s"
        else:
            size = f"{self.picture[0]:g} pixels" if self.filmed else f"{path.radius} m"
            way = f"a circle of radius {size} in {path.period} s"
        task = IMAGE if self.filmed else robot.task.name
        return f"{robot.model.nv} joints to '{robot.frame}', task {task}, {way}."


def _in_planes(
    robot: Robot, make: Callable[..., Robot], planes: Iterable[str]
) -> Iterator[tuple[Robot, WorkspaceCircle]]:
    """Yield the robot with a plane as its task, and its circle, for the planes that have one."""
    for plane in planes:
        with suppress(RobotError):
            planar = make(frame=robot.frame, task=plane)
            yield planar, find_circle(planar)


def _ball(mass: float, gyration: float, com: np.ndarray) -> Payload:
    """Return a load: mass [kg], radius of gyration [m], centre (3) [m] in the frame's axes."""
    moment = three_digits(mass * gyration**2)
    return Payload(mass, com, (moment, 0.0, moment, 0.0, 0.0, moment))


def _further_out(robot: Robot) -> np.ndarray:
    """Return a tool (3) [m], in the frame's axes, that lengthens the arm in task coordinates."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    frame, seen = data.oMf[robot.frame_id], np.zeros(3)
    place = robot.frame_task.place if robot.task.positions else slice(None)
    length = _TOOL * robot.reach
    for placement in reversed(list(data.oMi)):
        seen[place] = (frame.translation - placement.translation)[place]
        if np.linalg.norm(seen) > 0.1 * length:
            break
    tool = frame.rotation.T @ seen * (length / np.linalg.norm(seen))
    return np.round(tool, 3 - int(np.floor(np.log10(length))))


_ADAPTATIONS = (
    '"natural" learns from the tracking error alone, "natural-memory" from all torques so far: '
    "it ends with smaller errors, and needs parameters that explain the torques, friction included."
)
_WIDTH = 98  # largest width of a comment
_SHOWN = 12  # largest number of names in a comment


def scenario_text(template: Template, folder: Path) -> str:
    """Return the text of a scenario file in a folder; a relative robot path is adjusted to it."""
    blocks = [tomlkit.dumps({"title": template.name})]
    for name, remark, table in _sections(template, folder):
        head = "".join(comment.as_string() for comment in _comments(remark))
        blocks.append(head + ("" if table is None else tomlkit.dumps({name: table})))
    return "\n".join(blocks)


def _sections(template: Template, folder: Path) -> Iterable[tuple[str, str, Table | None]]:
    """Return name, preceding comment and content of each table."""
    yield "robot", "", _robot(template, folder)
    joints, rests = isinstance(template.path, JointSwing), template.rests
    truth = _TRUTH_OF_JOINTS if joints else _TRUTH
    shares = {"tool": 100 * template.tool_share, "load": 100 * template.load_share}
    yield "truth", truth.format(**shares), _truth(template)
    unknown = _GRAVITY if rests else _UNKNOWN_OF_JOINTS if joints else _UNKNOWN
    where = "camera" if template.filmed else "tracker" if template.tracker else ""
    unknown = _UNKNOWN_PLACED.format(where) if where else unknown
    yield "unknown", unknown, _filled(template.unknown)
    yield "controller", "", _controller(template)
    reference = _SET_POINT if rests else _SINES if joints else _REFERENCE
    reference = _CIRCLE_SEEN if template.filmed else reference
    motion = (_way if rests else _reference)(template)
    if not rests:
        _option(
            motion, 'start = "moving"', "at full speed from the first sample, not from rest", 20
        )
    stops = not (LAWS[template.law].keeps_speeds or rests or joints)
    _remark(motion, _GOVERNOR + _STOPS * stops)
    motion["governor"] = True
    yield "reference", reference, motion
    yield "simulation", "", _simulation(template)


_TRUTH = (
    "Differences between the simulated robot and its description, which the controller does not "
    "know. Here: a tool longer by {tool:g} % of the reach [m, frame's axes], with a ball of "
    "{load:g} % of the mass at its end [kg; com in m from the described frame; Ixx Ixy Iyy Ixz Iyz "
    "Izz in kg m^2]. Replace them by what you expect of your robot."
)
_TRUTH_OF_JOINTS = (
    "Differences between the simulated robot and its description, which the controller does not "
    "know. Here: a ball of {load:g} % of the mass, {tool:g} % of the reach beyond the frame [kg; "
    "com in m from the frame; Ixx Ixy Iyy Ixz Iyz Izz in kg m^2]. Replace it by what you expect of "
    "your robot."
)
_TRACKER = (
    "The base in the axes of the tracker that measures x: a rotation vector [rad] and a position "
    "[m]. The motion is given in the same axes."
)
_CAMERA = (
    "The camera that films the tool: where it stands [m, axes of the base], focal length [pixels]. "
    "It looks at the described frame at home; target = [x, y, z] says where else. size = [1280, "
    "960] pixels and roll [rad] are its others. A second one in the list fixes the tool in space; "
    "turn it (roll = 1.57) if the first coordinate of its picture does not show the depth of the "
    "first."
)
_PIXEL = (
    "About the length that a pixel covers at the arm [m]; a factor of five does not matter. All "
    "numbers of pictures in this file are pixels: of [reference] and noise.x."
)
_TURN = [0.0, 0.0, 2.1]
_PLACE = np.array([0.8, -0.5, 0.3])  # of the reach
_PLANAR = (
    "This chain can follow no circle in space within its joint limits and away from "
    "singularities; the task is the plane in which it can follow the largest one."
)
_PICTURES = "Pictures a second, their delay [s], and the noise of what is found in them [pixels]."
_FRICTION_AT_REST = (
    "Coulomb friction is left out: this law does not learn it, and would rest where it holds the "
    "arm. Viscous friction does no harm."
)
_GOVERNOR = (
    "The path waits while the error is large, a motor is at its limit, a joint near its stop or "
    "its velocity limit, or frames are missing, and goes on afterwards."
)
_STOPS = " Before a singularity, as at the edge of the workspace, it stops: this law cannot pass."
_MASS = (
    "Total mass of the robot [kg]. These links are described without inertia: {links}. The mass "
    "that the other links leave is distributed over them with one density: as solids of their "
    "shapes, or as rods to the next joint if they have no shape."
)
_UNKNOWN = (
    "What the controller adapts: the tool's translation, all inertial parameters of every body, "
    "rotor inertia and friction of every joint."
)
_UNKNOWN_OF_JOINTS = (
    "What the controller adapts: all inertial parameters of every body, rotor inertia and friction "
    "of every joint."
)
_GRAVITY = (
    "What the controller adapts: the inertial parameters of every body, as far as gravity depends "
    "on them. It does not adapt the tool."
)
_SET_POINT = (
    "A set point that the arm can reach within its joint limits, as an offset from the initial "
    "position [m, or rad of joints], and the duration of the way to it [s]; "
    'kind = "hold" stays at the start.'
)
_REFERENCE = (
    "A circle through the tool's initial position. The arm can follow it within its joint limits "
    "and away from singularities, even with a tool error of 5 % of its reach."
)
_CIRCLE_SEEN = (
    "A circle of the tool's picture [pixels], through the picture at the start: u to the right, v "
    "downwards. The run begins with a wiggle of the joints, which shows what the camera sees."
)
_UNKNOWN_PLACED = (
    "What the controller adapts: the {}, of which it knows nothing, the tool's translation, "
    "all inertial parameters of every body, rotor inertia and friction of every joint."
)
_SINES = (
    "Sines of all joints that start at rest at the home pose: amplitudes [rad or m], negative "
    "where the joint goes down, and periods [s]. Joint limits are kept."
)


def _robot(template: Template, folder: Path) -> Table:
    robot, table = template.robot, tomlkit.table()
    table["source"] = _source(template.source, folder)
    if template.xacro:
        _remark(table, "Arguments of the xacro file.")
        table["xacro"] = _inline(template.xacro)
    if template.mass is not None:
        _remark(table, _MASS.format(links=_names(template.massless)))
        table["mass"] = template.mass
    _remark(
        table,
        f"Other ends of chains: {_names(robot.ends)}; any link of the robot is allowed.",
    )
    table["frame"] = robot.frame
    _remark(
        table,
        "The controlled coordinates of the frame, in world axes: xyz, xy, xz, yz, or pose, which "
        "adds the orientation; image, its picture in a camera; or joint, the joints themselves.",
    )
    if template.planar:
        _remark(table, _PLANAR)
    table["task"] = IMAGE if template.filmed else robot.task.name
    if template.filmed:
        _remark(table, _PIXEL)
        table["pixel"] = template.pixel
    if robot.welded:
        _remark(
            table,
            "The base floats in the description; here it is fixed, and the chain is an arm.",
        )
        table["weld_root"] = True
    _remark(
        table,
        "Further joints of the chain to lock. Always locked, because they are not on the chain: "
        f"{_names(robot.locked)}.",
    )
    table["locked"] = []
    _remark(
        table, f"Home pose, where the motion starts [rad or m]: {', '.join(robot.joint_names)}."
    )
    table["q0"] = _numbers(robot.home_angles, digits=12)
    return table


def _truth(template: Template) -> Table:
    table = tomlkit.table()
    if template.robot.task.positions:
        table["tool_translation"] = _numbers(template.tool)
    if template.tracker:
        _remark(table, _TRACKER)
        place = _PLACE * template.robot.reach
        table["tracker"] = _inline({"rotation": _TURN, "translation": _numbers(place, 2)})
    if template.filmed:
        _remark(table, _CAMERA)
        stands = tomlkit.array()
        stands.append(_inline({"position": _numbers(template.camera), "focal": _FOCAL}))
        table["camera"] = stands
    table["payload"] = _payload(template.load)
    _option(table, "inertial_scale = 1.3", "every mass and inertia 30 % larger than described", 45)
    viscous, coulomb = template.friction
    if template.rests:
        _remark(table, _FRICTION_AT_REST)
        _option(table, f"friction = {{ viscous = {viscous[0]} }}", "[N m s/rad]", 45)
        return table
    _remark(table, "Friction of the joints [N m s/rad, N m], numbers or lists with one per joint.")
    table["friction"] = _inline({"viscous": viscous, "coulomb": coulomb})
    return table


def _controller(template: Template) -> Table:
    controller = template.controller
    law = controller.law
    table = _filled({"law": law.name, "adaptation": controller.adaptation_d.name})
    _remark(table, _ADAPTATIONS)
    _remark(
        table,
        "Default gains for this robot, law and sampling period; remove the # to set your own.",
    )
    for key, value, meaning in default_gains(controller):
        _option(table, f"{key} = {value}", meaning, 20)
    meaning = "gains for late motors, or stiffness"
    _option(table, "actuators = { delay = 0.004, bandwidth = 200.0 }", meaning, 20)
    return table


def _reference(template: Template) -> Table:
    path = template.path
    if isinstance(path, JointSwing):
        sizes = {"amplitude": _numbers(path.amplitude), "period": _numbers(path.period)}
        return _filled({"kind": "sinusoid", **sizes})
    if template.filmed:
        radius, phase = template.picture
        period = {"period": path.period, "phase": phase}
        return _filled({"kind": "circle", "radius": radius, **period})
    return _filled(
        {
            "kind": "circle",
            "radius": path.radius,
            "period": path.period,
            "plane": path.plane,
            "phase": float(f"{path.phase:.12g}"),
        }
    )


def _way(template: Template) -> Table:
    """Return the motion to the opposite point of the circle, or of the sines."""
    path = template.path
    if isinstance(path, JointSwing):
        across, half = 2.0 * path.amplitude, 0.5 * float(path.period.max())
    else:
        motion, half = path.motion(template.robot.task.positions), 0.5 * path.period
        across = motion.at(half).x_d - motion.at(0.0).x_d
    segment = float(f"{half:.3g}")
    return _filled({"kind": "waypoints", "points": [_numbers(across.round(6))], "segment": segment})


def _simulation(template: Template) -> Table:
    longest = 2.0 * float(np.max(template.path.period))
    duration = float(ceil(max(20.0 if template.rests else 10.0, longest)))
    table = _filled({"duration": duration, "dt": SimulationSection().dt})
    if template.filmed:
        _remark(table, _PICTURES)
        table["camera"] = _inline({"rate": 30.0, "delay": 0.06})
        table["noise"] = _inline({"x": 0.5})
    meaning = "ignore the effort limits of the description"
    _option(table, "torque_limits = false", meaning, 45)
    meaning = "[s], [rad/s]: motors that follow late; or stiffness [N m/rad]"
    _option(table, "actuators = { delay = 0.004, bandwidth = 200.0 }", meaning, 45)
    return table


def _filled(values: dict[str, object]) -> Table:
    table = tomlkit.table()
    for key, value in values.items():
        table[key] = value
    return table


def _payload(load: Payload) -> InlineTable:
    com, inertia = (_numbers(np.asarray(part)) for part in (load.com, load.inertia))
    return _inline({"mass": load.mass, "com": com, "inertia": inertia})


def _inline(values: Mapping[str, object]) -> InlineTable:
    table = tomlkit.inline_table()
    table.update(values)
    return table


def _source(source: str, folder: Path) -> str:
    """Return a source with a path relative to a folder."""
    if not is_path(source) or Path(source).is_absolute():
        return source
    parent = os.path.relpath(Path(source).resolve().parent, folder.resolve())
    return os.path.join(parent, Path(source).name)


def _option(table: Table, setting: str, meaning: str, width: int) -> None:
    """Add a key that is commented out, followed by its meaning."""
    table.add(tomlkit.comment(f"{setting:<{width}} # {meaning}"))


def _remark(table: Table, text: str) -> None:
    for comment in _comments(text):
        table.add(comment)


def _comments(text: str) -> list[Comment]:
    """Return the lines of a comment; unprintable characters become spaces."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    lines = textwrap.wrap(printable, _WIDTH, break_long_words=False, break_on_hyphens=False)
    return [tomlkit.comment(line) for line in lines]


def _numbers(values: Iterable[float], digits: int = 6) -> list[float]:
    return [float(f"{value:.{digits}g}") + 0.0 for value in values]


def _names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more if names else "none"
