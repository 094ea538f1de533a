"""A new scenario for a robot: frame, task, home, tool, load, and a circle that it can follow."""

from __future__ import annotations

import os
import textwrap
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import tomlkit
from tomlkit.items import Comment, InlineTable, Table

from ..adaptation.adaptation import Adaptation, Stacked, Wrapper
from ..adaptation.gradient import ExponentiatedGradient
from ..adaptation.natural import Natural
from ..controller.controller import Controller
from ..description.chain import links_of, massless_joints
from ..description.description import describe
from ..description.urdf import is_path
from ..description.xacro import XacroArguments
from ..laws import DEFAULT, LAWS
from ..robot.changes import Payload
from ..robot.loading import load
from ..robot.robot import Robot
from ..robot.workspace import WorkspaceCircle, find_circle
from ..tuning.make_controller import make_controller
from .schema import SimulationSection

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
    if hasattr(law, "K_P"):
        yield "Kp", _gain(law.K_P), f"position gain [{position}]"
    for name, meaning in _MEANINGS.items():
        if hasattr(law, name):
            yield name.rstrip("_"), _gain(getattr(law, name)), meaning
    bodies, joints = _parts(controller.adaptation_d)
    yield "gamma_d", _gain(bodies.gamma), "rate of the inertial parameters"
    if joints is not None:
        yield "gamma_joint", _gain(joints.gamma), "rate of armature and friction"
    if law.learns_kinematics:
        rate_k = controller.adaptation_k.gain(controller.kinematics.initial)
        yield "gamma_k", _gain(rate_k), "rate of the tool"


def _diagonal(gain: np.ndarray) -> bool:
    """Tell whether a gain (n, n) is diagonal."""
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


_TOOL = 0.05  # length of the unknown tool, relative to the reach
_LOAD = 0.05  # mass of the unknown load, relative to the moving mass


@dataclass(frozen=True)
class Template:
    """A scenario to be written.

    Attributes:
        source: a path or a name of a robot.
        robot: the robot as described, at its home pose.
        circle: a circle that it can follow.
        xacro: arguments of a xacro file.
        mass: total mass of the robot [kg], if links are described without inertia; else None.
        massless: names of these links, one for each such body.
        law: name of the control law.
    """

    source: str
    robot: Robot
    circle: WorkspaceCircle
    xacro: XacroArguments
    mass: float | None
    massless: Sequence[str]
    law: str = DEFAULT

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
    ) -> Template:
        """Load a robot, with the choices of ``load`` for what is not given, and find a circle.

        Raises:
            RobotError: as ``load`` and ``find_circle``.
        """
        robot = load(source, frame=frame, task=task, xacro=xacro, mass=mass)
        massless: list[str] = []
        if mass is not None:
            model = describe(source, xacro=xacro).model
            massless = [links_of(model, joint)[0] for joint in massless_joints(model)]
        return cls(source, robot, find_circle(robot), xacro or {}, mass, massless, law)

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
            return make_controller(self.robot, law=self.law, dt=SimulationSection().dt)

    @property
    def rests(self) -> bool:
        """Whether the law regulates to a set point; it is the opposite point of the circle."""
        return LAWS[self.law].set_point


def _ball(mass: float, gyration: float, com: np.ndarray) -> Payload:
    """Return a load: mass [kg], radius of gyration [m], centre (3) [m] in the frame's axes."""
    moment = three_digits(mass * gyration**2)
    return Payload(mass, com, (moment, 0.0, moment, 0.0, 0.0, moment))


def _further_out(robot: Robot) -> np.ndarray:
    """Return a tool (3) [m], in the frame's axes, that lengthens the arm in task coordinates."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    frame, seen = data.oMf[robot.frame_id], np.zeros(3)
    length = _TOOL * robot.reach
    for placement in reversed(list(data.oMi)):
        seen[robot.frame_task.place] = (frame.translation - placement.translation)[
            robot.frame_task.place
        ]
        if np.linalg.norm(seen) > 0.1 * length:
            break
    tool = frame.rotation.T @ seen * (length / np.linalg.norm(seen))
    return np.round(tool, 3 - int(np.floor(np.log10(length))))


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
    yield (
        "truth",
        _TRUTH.format(tool=100 * template.tool_share, load=100 * template.load_share),
        (_truth(template)),
    )
    if template.rests:
        yield "unknown", _GRAVITY, _filled({"dynamic": "all"})
    else:
        yield (
            "unknown",
            _UNKNOWN,
            _filled({"kinematic": ["tool"], "dynamic": "all", "joint": "all"}),
        )
    yield "controller", "", _controller(template)
    if template.rests:
        yield "reference", _SET_POINT, _way(template)
    else:
        yield "reference", _REFERENCE, _reference(template)
    yield "simulation", "", _simulation(template)


_TRUTH = (
    "Differences between the simulated robot and its description, which the controller does not "
    "know. Here: a tool longer by {tool:g} % of the reach [m, frame's axes], with a ball of "
    "{load:g} % of the mass at its end [kg; com in m from the described frame; Ixx Ixy Iyy Ixz Iyz "
    "Izz in kg m^2]. Replace them by what you expect of your robot."
)
_MASS = (
    "Total mass of the robot [kg]. These links are described without inertia: {links}. The mass "
    "that the other links leave is distributed over them with one density: as solids of their "
    "shapes, or as rods to the next joint if they have no shape."
)
_UNKNOWN = (
    "What the controller adapts: the tool's translation, all inertial parameters of every body, "
    "rotor inertia and friction of every joint."
)
_GRAVITY = (
    "What the controller adapts: the inertial parameters of every body, as far as gravity depends "
    "on them. It does not adapt the tool."
)
_SET_POINT = (
    "A set point that the arm can reach within its joint limits, as an offset from the tool's "
    'initial position [m], and the duration of the way to it [s]; kind = "hold" stays at the start.'
)
_REFERENCE = (
    "A circle through the tool's initial position. The arm can follow it within its joint limits "
    "and away from singularities, even with a tool error of 5 % of its reach."
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
        "adds the orientation.",
    )
    table["task"] = robot.task.name
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
    table = _filled({"tool_translation": _numbers(template.tool)})
    table["payload"] = _payload(template.load)
    _option(table, "inertial_scale = 1.3", "every mass and inertia 30 % larger than described", 45)
    friction = "friction = { viscous = 0.1, coulomb = 0.05 }"
    _option(table, friction, "[N m s/rad, N m], numbers or lists with one per joint", 45)
    return table


def _controller(template: Template) -> Table:
    controller = template.controller
    table = _filled({"law": controller.law.name, "adaptation": "natural"})
    _remark(
        table,
        'Other adaptations also use the measured torque and converge faster: "natural-memory", '
        'which keeps every body physical as well, and "least-squares", which does not.',
    )
    _remark(
        table,
        "Default gains for this robot, law and sampling period; remove the # to set your own.",
    )
    for key, value, meaning in default_gains(controller):
        _option(table, f"{key} = {value}", meaning, 20)
    return table


def _reference(template: Template) -> Table:
    circle = template.circle
    return _filled(
        {
            "kind": "circle",
            "radius": circle.radius,
            "period": circle.period,
            "plane": circle.plane,
            "phase": float(f"{circle.phase:.12g}"),
        }
    )


def _way(template: Template) -> Table:
    """Return the motion to the opposite point of the circle."""
    circle, task = template.circle, template.robot.task
    motion = circle.motion(task.positions)
    across = motion.at(0.5 * circle.period).x_d - motion.at(0.0).x_d
    segment = float(f"{0.5 * circle.period:.3g}")
    return _filled({"kind": "waypoints", "points": [_numbers(across.round(6))], "segment": segment})


def _simulation(template: Template) -> Table:
    duration = float(ceil(max(20.0 if template.rests else 10.0, 2 * template.circle.period)))
    table = _filled({"duration": duration, "dt": SimulationSection().dt})
    meaning = "ignore the effort limits of the description"
    _option(table, "torque_limits = false", meaning, 45)
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
