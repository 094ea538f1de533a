"""A new scenario for a robot: frame, task, home, tool, payload, friction and a safe motion."""

from __future__ import annotations

import os
import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from math import ceil, cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from .._output import meanings
from ..controller.controller import Controller
from ..description.chain import links_of, massless_joints
from ..description.description import describe
from ..description.urdf import is_path
from ..description.xacro import XacroArguments
from ..exceptions import InputError, RobotError
from ..laws import DEFAULT, LAWS
from ..laws.law import NAMES, SYMBOLS
from ..models.joint_effects import typical_coefficients
from ..robot.loading import JOINT, PLANES, load
from ..robot.robot import Robot
from ..robot.workspace import JointSwing, WorkspaceCircle, find_circle, find_swing
from ..tasks.frame import IMAGE, pinhole_camera
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown
from .tables import KEYS, MOTIONS

_AWAY, _ASIDE = 2.0, (0.25, 0.2)  # reaches to a camera; its way aside, relative to that before
_FOCAL = 1000.0  # [pixels] of an ordinary camera
_TOOL = 0.05  # length of the unknown tool, relative to the reach
_PAYLOAD = 0.05  # mass of the unknown payload, relative to the moving mass
_FRICTION = 0.5  # unknown friction, relative to what is typical for a robot of this size
_PLACE = (0.8, -0.5, 0.3)  # of the reach: the base as a tracker sees it, which is turned by 2 rad
_WIDTH, _SHOWN = 98, 12  # largest width of a comment, and number of names in it


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
        if (tracker and (task == JOINT or filmed)) or (
            (tracker or filmed) and not LAWS[law].uses_position_error
        ):
            raise InputError(
                "a tracker needs a task of the frame, and both a tracker and a picture a law that "
                "learns from positions.",
                where="--tracker" if tracker else "--law",
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
            free = task is None and robot.task.positions == 3
            found = list(_in_planes(robot, make)) if free else []
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

    @cached_property
    def tool(self) -> np.ndarray:
        """The unknown tool (3) [m], in the frame's axes."""
        return _further_out(self.robot)

    @cached_property
    def controller(self) -> Controller:
        """The controller with default gains for the robot as described."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file itself contains what matters
            return make_controller(
                self.robot.filmed_by(pixel=self.pixel) if self.filmed else self.robot,
                law=self.law,
                unknown=Unknown(**self.unknown),
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
        radius = float(f"{path.radius / self._covered:.2g}")
        return radius, round(float(np.arctan2(v, u)), 3)

    @property
    def unknown(self) -> dict[str, Any]:
        """The table [unknown]."""
        if self.rests:
            return {"bodies": "all"}
        tool = {"tool": True} if self.robot.task.positions else {}
        placed = {"tracker": True} if self.tracker else {}
        return {**placed, **tool, "bodies": "all", "friction": True, "armature": True}

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

    def tables(self, folder: Path) -> dict[str, dict[str, Any]]:
        """Return the tables of the scenario; a robot's path is made relative to a folder."""
        found = {
            "robot": self._robot(folder),
            "truth": self._truth(),
            "unknown": self.unknown,
            "controller": {
                "law": self.law,
                "adaptation": self.controller.adaptation_d.name,
                "dt": self.controller.period,
            },
            "limits": {"governor": True},
            "trajectory": self._motion(),
            "simulation": {"duration": self._duration},
        }
        if self.filmed:
            found["sensors"] = {"camera": {"rate": 30.0, "delay": 0.06}, "noise": {"x": 0.5}}
        return found

    def _robot(self, folder: Path) -> dict[str, Any]:
        robot, source = self.robot, self.source
        if is_path(source) and not Path(source).is_absolute():
            parent = os.path.relpath(Path(source).resolve().parent, folder.resolve())
            source = os.path.join(parent, Path(source).name)
        given = {
            "source": source,
            "xacro": dict(self.xacro) or None,
            "mass": self.mass,
            "frame": robot.frame,
            "task": IMAGE if self.filmed else robot.task.name,
            "pixel": self.pixel if self.filmed else None,
            "weld_root": True if robot.welded else None,
            "locked": [],
            "q0": _numbers(robot.home_angles, digits=12),
        }
        return {key: value for key, value in given.items() if value is not None}

    def _truth(self) -> dict[str, Any]:
        reach = self.robot.reach
        moment = float(f"{_PAYLOAD * self.robot.mass * 0.1 * (_TOOL * reach) ** 2:.3g}")  # a ball
        com, (_, viscous, coulomb) = self.tool, _FRICTION * typical_coefficients(self.robot)
        found: dict[str, Any] = {}
        if self.robot.task.positions:
            found["tool_translation"] = _numbers(self.tool)
        if self.tracker:
            place = _numbers(reach * np.array(_PLACE), 2)
            found["tracker"] = {"rotation": [0.0, 0.0, 2.0], "translation": place}
        if self.filmed:
            position = _numbers(self.camera)
            found["camera"] = [{"position": position, "focal": _FOCAL}]
        found["payload"] = {
            "mass": float(f"{_PAYLOAD * self.robot.mass:.3g}"),
            "com": _numbers(com),
            "inertia": [moment, 0.0, moment, 0.0, 0.0, moment],
        }
        if not self.rests:  # Coulomb friction would hold the arm beside its set point
            found["friction"] = {"viscous": _numbers(viscous, 2), "coulomb": _numbers(coulomb, 2)}
        return found

    def _motion(self) -> dict[str, Any]:
        path = self.path
        if self.rests:
            across, segment = self._across()
            return {
                "kind": "waypoints",
                "relative": True,
                "points": [_numbers(across.round(6))],
                "segment": float(f"{segment:.3g}"),
            }
        if isinstance(path, JointSwing):
            sizes = {"amplitude": _numbers(path.amplitude), "period": _numbers(path.period)}
            return {"kind": "sinusoid", **sizes}
        if self.filmed:
            radius, phase = self.picture
            return {"kind": "circle", "radius": radius, "period": path.period, "phase": phase}
        plane = path.motion(self.robot.task.positions).plane
        given = {"radius": path.radius, "period": path.period, "plane": plane}
        return {"kind": "circle", **given, "phase": float(f"{path.phase:.12g}")}

    def _across(self) -> tuple[np.ndarray, float]:
        """Return the way to the opposite point of the motion, and its duration [s]."""
        path = self.path
        if isinstance(path, JointSwing):
            return 2.0 * path.amplitude, 0.5 * float(path.period.max())
        motion, half = path.motion(self.robot.task.positions), 0.5 * path.period
        return motion.at(half).x_d - motion.at(0.0).x_d, half

    @property
    def _duration(self) -> float:
        """Duration of a run [s]: two turns, and time enough to come to rest."""
        longest = 2.0 * float(np.max(self.path.period))
        return float(ceil(max(20.0 if self.rests else 10.0, longest)))

    def remarks(self) -> dict[str, str]:
        """Return what the robot adds to the meaning of keys."""
        robot = self.robot
        found = {
            "robot.frame": f"Other ends of chains: {_names(robot.ends)}.",
            "robot.locked": f"Always locked, off the chain: {_names(robot.locked)}.",
            "robot.q0": f"Joints: {', '.join(robot.joint_names)}.",
            "robot.mass": f"Links described without inertia: {_names(self.massless)}.",
        }
        if self.planar:
            found["robot.task"] = "No circle in space is within this chain's limits."
        return found

    def gains(self) -> Iterator[tuple[str, float | list[float]]]:
        """Yield key and value of each gain of the law that is a number or a list."""
        law: Any = self.controller.law
        for key in NAMES:
            if key == "Kp" and not law.units[1]:
                continue  # it follows from the other gains
            gain = getattr(law, SYMBOLS.get(key, key), None)
            if isinstance(gain, bool) or not isinstance(gain, int | float | np.ndarray):
                continue
            numbers = np.asarray(gain, dtype=float)
            if numbers.ndim == 2:
                if not np.array_equal(numbers, np.diag(np.diag(numbers))):
                    continue  # a full matrix is too long for a comment
                numbers = np.diag(numbers)
            values = _numbers(numbers.flat, 3)
            if values and np.isfinite(values).all():
                yield key, values[0] if len(set(values)) == 1 else values


def _in_planes(robot: Robot, make: Callable[..., Robot]) -> Iterator[tuple[Robot, WorkspaceCircle]]:
    """Yield the robot with a plane as its task, and its circle, for the planes that have one."""
    for plane in PLANES:
        with suppress(RobotError):
            planar = make(frame=robot.frame, task=plane)
            yield planar, find_circle(planar)


def _further_out(robot: Robot) -> np.ndarray:
    """Return a tool (3) [m], in the frame's axes, that lengthens the arm in task coordinates."""
    frame, out = robot.placement(robot.q0), np.zeros(3)
    place = robot.frame_task.place if robot.task.positions else slice(None)
    out[place] = frame.translation[place]
    length = _TOOL * robot.reach
    tool = frame.rotation.T @ out * (length / np.linalg.norm(out))
    return np.round(tool, 3 - int(np.floor(np.log10(length))))


# The file

_ABOUT = {
    "robot": "What pinadapt.load takes.",
    "truth": "Differences between the simulated robot and its description, which the controller "
    "does not know, as Robot.changed takes them: here a tool longer by 5 % of the reach, with a "
    "ball of 5 % of the mass at its end. Replace them by what you expect of your robot.",
    "unknown": "What the controller adapts: pinadapt.Unknown.",
    "controller": "What pinadapt.make_controller takes.",
    "limits": "pinadapt.Limits",
    "trajectory": "The desired motion, a class of pinadapt.trajectories. It begins where the robot "
    "is, and keeps joint limits, even with a tool error of 5 % of the reach. as_given = true: at "
    "full speed from the first sample, not from rest.",
    "simulation": "What pinadapt.simulate takes.",
    "sensors": "pinadapt.Sensors; noise of a picture is in pixels.",
}


def scenario_text(template: Template, folder: Path) -> str:
    """Return the text of a scenario file in a folder: each key under its meaning.

    Meanings are the first sentences of the docstrings of the classes and functions.
    """
    lines, remarks = [f"title = {_written(template.name)}"], template.remarks()
    for name, table in template.tables(folder).items():
        make = MOTIONS[table["kind"]] if name == "trajectory" else KEYS[name][0]
        about = meanings(make)
        lines += ["", *_comment(_ABOUT[name]), f"[{name}]"]
        for key, value in table.items():
            meaning = f"{about.get(key, '')} {remarks.get(f'{name}.{key}', '')}"
            lines += [*_comment(meaning.strip()), f"{key} = {_written(value)}"]
        if name == "controller":
            lines += _comment("Gains in use; remove the # to set your own.")
            lines += [f"# {key} = {value}" for key, value in template.gains()]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    """Return the lines of a comment; unprintable characters become spaces."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    lines = textwrap.wrap(printable, _WIDTH, break_long_words=False, break_on_hyphens=False)
    return [f"# {line}" for line in lines]


def _written(value: Any) -> str:
    """Return a value in TOML, tables inline."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_written(each)}' for key, each in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return tomlkit.item(value).as_string()


def _numbers(values: Any, digits: int = 6) -> list[float]:
    return [float(f"{value:.{digits}g}") + 0.0 for value in values]


def _names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more if names else "none"
