"""A template as a TOML file with comments."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from math import ceil
from pathlib import Path

import numpy as np
import tomlkit
from tomlkit.items import Comment, InlineTable, Table

from ..robot.changes import Payload
from ..robot.urdf import is_path
from .schema import SimulationSection
from .template import Template
from .template_gains import default_gains

_WIDTH = 98  # of a comment
_SHOWN = 12  # names in a comment


def scenario_text(template: Template, folder: Path) -> str:
    """Return the scenario file for a folder; a relative URDF path is made relative to it."""
    blocks = [tomlkit.dumps({"title": template.name})]
    for name, remark, table in _sections(template, folder):
        head = "".join(comment.as_string() for comment in _comments(remark))
        blocks.append(head + ("" if table is None else tomlkit.dumps({name: table})))
    return "\n".join(blocks)


def _sections(template: Template, folder: Path) -> Iterable[tuple[str, str, Table | None]]:
    """Return name, remark before it, and content of each table; a remark may stand alone."""
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
    "How the simulated robot differs from its description, which the controller is not told. Here: "
    "a tool {tool:g} % of the reach longer [m, frame's axes], in its end a ball of {load:g} % of "
    "the mass [kg; com m from the described frame; Ixx Ixy Iyy Ixz Iyz Izz kg m^2]. Put what you "
    "expect of your robot."
)
_MASS = (
    "What the whole robot weighs [kg]. These links are described without inertia: {links}. What "
    "the others leave of this mass is spread over them with one density: solids of their shapes, "
    "rods to the next joint where they have none."
)
_UNKNOWN = (
    "What the controller adapts: the tool's translation, all inertial parameters of every body, "
    "rotor inertia and friction of every joint."
)
_GRAVITY = (
    "What the controller adapts: the inertial parameters of every body, as far as gravity shows "
    "them. It does not learn the tool."
)
_SET_POINT = (
    "The way to a set point that the arm reaches inside its joint limits, as an offset from the "
    'tool\'s first position [m], in so many seconds; without points, kind = "hold" stays there.'
)
_REFERENCE = (
    "A circle through the tool's first position, which the arm follows inside its joint limits and "
    "away from singularities, also with a tool 5 % of its reach off."
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
        f"Other ends of chains: {_names(robot.ends)}; any link of the robot can be named.",
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
            "The base floats in the description: it is fixed, and the chain is used as an arm.",
        )
        table["weld_root"] = True
    _remark(
        table,
        "Joints of the chain to lock as well. Locked anyway, for they are not on it: "
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
    _option(table, "inertial_scale = 1.3", "every mass and inertia 30 % above its description", 45)
    friction = "friction = { viscous = 0.1, coulomb = 0.05 }"
    _option(table, friction, "[N m s/rad, N m], or one number a joint", 45)
    return table


def _controller(template: Template) -> Table:
    controller = template.controller
    table = _filled({"law": controller.law.name, "adaptation": "natural"})
    _remark(
        table,
        'Other adaptations learn from the torque as well, and faster: "natural-memory", which '
        'keeps every body physical too, and "least-squares", which does not.',
    )
    _remark(
        table,
        "These gains are chosen for this robot, law and sampling period; take the # away to set "
        "your own.",
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
    """Return the way across the circle."""
    circle, task = template.circle, template.robot.task
    motion = circle.motion(task.positions)
    across = motion.at(0.5 * circle.period).x_d - motion.at(0.0).x_d
    segment = float(f"{0.5 * circle.period:.3g}")
    return _filled({"kind": "waypoints", "points": [_numbers(across.round(6))], "segment": segment})


def _simulation(template: Template) -> Table:
    duration = float(ceil(max(20.0 if template.rests else 10.0, 2 * template.circle.period)))
    table = _filled({"duration": duration, "dt": SimulationSection().dt})
    meaning = "let the torque exceed the description's effort limits"
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
    """Return a source as it is found from a folder."""
    if not is_path(source) or Path(source).is_absolute():
        return source
    parent = os.path.relpath(Path(source).resolve().parent, folder.resolve())
    return os.path.join(parent, Path(source).name)


def _option(table: Table, setting: str, meaning: str, width: int) -> None:
    """Add a key that is commented out, with its meaning behind it."""
    table.add(tomlkit.comment(f"{setting:<{width}} # {meaning}"))


def _remark(table: Table, text: str) -> None:
    for comment in _comments(text):
        table.add(comment)


def _comments(text: str) -> list[Comment]:
    """Return the lines of a comment; what cannot be printed becomes a space."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    lines = textwrap.wrap(printable, _WIDTH, break_long_words=False, break_on_hyphens=False)
    return [tomlkit.comment(line) for line in lines]


def _numbers(values: Iterable[float], digits: int = 6) -> list[float]:
    return [float(f"{value:.{digits}g}") + 0.0 for value in values]


def _names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more if names else "none"
