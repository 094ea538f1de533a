"""A new scenario for a robot: frame, task, home, tool, payload, friction and a safe motion."""

from __future__ import annotations

import os
import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import cos, floor, log10, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit

from .._output import meanings
from ..controller.constraint_forces import ConstraintForces
from ..controller.controller import Controller
from ..description.urdf import is_path
from ..description.xacro import XacroArguments
from ..laws import DEFAULT
from ..laws.law import NAMES, SYMBOLS
from ..models.joint_effects import typical_coefficients
from ..robot.loading import FIXED, FREE, load
from ..robot.robot import Robot
from ..robot.workspace import TOOL_ERROR, find_circle, find_swing
from ..tasks.frame import IMAGE, pinhole_camera
from ..tasks.task import JointTask
from ..trajectories.periodic import Circle, Sinusoid
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown
from .tables import KEYS, MOTIONS, Tables, plain

# The unknown of the example, which users replace: half or twice is an easier or a harder one.
FRICTION = 0.5  # relative to what is typical for a robot of this size
_FOCAL = 1000.0  # [pixels] of the camera; half: a picture of half the resolution


class View(NamedTuple):
    """A camera, and the circle of the robot in its picture.

    Attributes:
        position: (3) where the camera stands [m], in the axes of the base.
        pixel: length that a pixel covers at the tool [m], to one digit.
        radius: of the circle [pixels].
        phase: of the circle at the start [rad].
    """

    position: np.ndarray
    pixel: float
    radius: float
    phase: float


@dataclass(frozen=True)
class Template:
    """A scenario to be written, with the choices of ``load`` for what is not given.

    Attributes:
        source: a path or a name of a robot.
        frame: task frame (default: the likeliest link at the robot's end); several, given again or
            with commas between, are moved by one controller.
        contacts: point feet, again or with commas between, on which a robot with a free base
            stands; its trunk moves.
        task: xyz, xy, xz, yz, pose, image (of an uncalibrated camera) or joint (default: xyz, or a
            plane if the chain is planar).
        xacro: arguments of a xacro file.
        mass: of the whole robot [kg], if links are described without inertia.
        tracker: whether x is measured in the axes of an uncalibrated tracker.
    """

    source: str
    frame: str | Sequence[str] = ()
    contacts: Sequence[str] = ()
    task: str | None = None
    xacro: XacroArguments = field(default_factory=dict)
    mass: float | None = None
    tracker: bool = False

    @cached_property
    def robot(self) -> Robot:
        """The robot as described, at its home pose.

        Raises:
            RobotError: as ``load``.
        """
        robot = load(
            self.source,
            xacro=self.xacro,
            mass=self.mass,
            frames=self.frame,
            task=None if self.filmed else self.task,
            base=FREE if self.contacts else FIXED,
            contacts=self.contacts,
        )
        if self.tracker or self.filmed:
            robot.check_single_frame()
        if self.contacts:
            ConstraintForces(robot)  # refuses those that cannot hold it
        return robot

    @cached_property
    def path(self) -> Circle | Sinusoid:
        """A motion that it can follow: a circle, or for a joint task sines of its joints.

        Raises:
            RobotError: as ``find_circle`` and ``find_swing``.
        """
        return find_circle(self.robot) if self.robot.task.lengths else find_swing(self.robot)

    @property
    def filmed(self) -> bool:
        """Whether the task is the picture of an uncalibrated camera."""
        return self.task == IMAGE

    @property
    def whole(self) -> bool:
        """Whether all joints of the description are controlled."""
        return not self.frame and isinstance(self.robot.task, JointTask)

    @property
    def name(self) -> str:
        """Name of the file, and the title."""
        source = self.source
        return Path(source.removesuffix(".xacro")).stem if is_path(source) else source

    @cached_property
    def tools(self) -> dict[str, np.ndarray]:
        """The unknown tool (3) [m] of each frame, in the frame's axes: it lengthens the arm."""
        found = {}
        for name in self.robot.frames:
            robot = self.robot.of_frame(name)
            out = np.zeros(3)
            frame = robot.placement(robot.q0)
            place = robot.frame_task.place if robot.task.positions else slice(None)
            out[place] = frame.translation[place] if frame.translation[place].any() else 1.0
            length = TOOL_ERROR * robot.reach
            tool = frame.rotation.T @ out * (length / np.linalg.norm(out))
            found[name] = np.round(tool, 3 - floor(log10(length)))
        return found

    @cached_property
    def controller(self) -> Controller:
        """The controller with default gains for the robot as described."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file itself contains what matters
            return make_controller(
                self.robot.filmed_by(pixel=self.view.pixel) if self.filmed else self.robot,
                unknown=Unknown(**self.unknown),
            )

    @cached_property
    def view(self) -> View:
        """A camera two reaches before the circle's plane and somewhat aside."""
        path = self.path
        p = self.robot.placement(self.robot.q0).translation
        assert isinstance(path, Circle)
        axes = np.eye(3)[self.robot.frame_task.place]
        first, second = axes[["xyz".index(axis) for axis in path.plane]]
        normal = np.cross(first, second)
        away = np.copysign(1.0, p @ normal) * normal + 0.25 * first + 0.2 * second
        position = np.round(p + 2.0 * self.robot.reach * away / np.linalg.norm(away), 2)
        covered = np.linalg.norm(position - p) / _FOCAL
        out = cos(path.phase) * first + sin(path.phase) * second
        u, v, _ = pinhole_camera(position, p, _FOCAL)[:, :3] @ out
        phase = round(np.arctan2(v, u), 3)
        return View(position, _rounded(covered, 1), _rounded(path.radius / covered, 2), phase)

    @property
    def unknown(self) -> Tables:
        """The table [unknown]."""
        if self.robot.contacts:
            return {"bodies": "payload", "friction": False, "armature": False}
        return plain(
            {
                "tracker": self.tracker or None,
                "tool": self.robot.task.positions > 0 or None,
                "bodies": "all",
                "friction": True,
                "armature": True,
            }
        )

    def tables(self, folder: Path) -> dict[str, Tables]:
        """Return the tables of the scenario; a robot's path is made relative to a folder."""
        sensors = {"camera": {"rate": 30.0, "delay": 0.06}, "noise": {"x": 0.5}}
        return plain(
            {
                "robot": self._robot(folder),
                "truth": self._truth(),
                "unknown": self.unknown,
                "controller": {
                    "law": DEFAULT,
                    "adaptation": self.controller.adaptation_d.name,
                    "dt": self.controller.period,
                },
                "limits": {"governor": True},
                "trajectory": self._motion(),
                "simulation": {"duration": max(10.0, np.ceil(2.0 * np.max(self.path.period)))},
                "engine": {"plant": "mujoco"} if self.robot.contacts else None,
                "sensors": sensors if self.filmed else None,
            }
        )

    def _robot(self, folder: Path) -> Tables:
        robot = self.robot
        source = self.source
        if is_path(source) and not Path(source).is_absolute():
            source = os.path.relpath(source, folder.resolve())
        several = len(robot.frames) > 1
        return {
            "source": source,
            "xacro": dict(self.xacro) or None,
            "mass": self.mass,
            "frame": None if self.whole or several else robot.frame,
            "frames": robot.frames if several else None,
            "base": FREE if robot.contacts else None,
            "contacts": [contact.frame for contact in robot.contacts] or None,
            "task": IMAGE if self.filmed else robot.task.name,
            "pixel": self.view.pixel if self.filmed else None,
            "locked": [],
            "q0": significant(robot.home_angles.round(12), digits=12),
        }

    def _truth(self) -> Tables:
        robot = self.robot
        mass = TOOL_ERROR * robot.mass / len(robot.frames)
        radius = TOOL_ERROR * robot.reach
        moment = _rounded(0.1 * mass * radius**2, 3)  # of a ball
        _, viscous, coulomb = FRICTION * typical_coefficients(robot)
        tracker = {  # the base as the tracker sees it
            "rotation": [0.0, 0.0, 2.0],
            "translation": significant(robot.reach * np.array([0.8, -0.5, 0.3]), 2),
        }
        payload = self._by_frame(
            lambda tool: {
                "mass": _rounded(mass, 3),
                "com": significant(tool),
                "inertia": [moment, 0.0, moment, 0.0, 0.0, moment],
            }
        )
        friction = {"viscous": significant(viscous, 2), "coulomb": significant(coulomb, 2)}
        moved = robot.task.positions and not robot.contacts
        return {
            "tool_translation": self._by_frame(significant) if moved else None,
            "tracker": tracker if self.tracker else None,
            "camera": [{"position": significant(self.view.position), "focal": _FOCAL}]
            if self.filmed
            else None,
            "payload": payload,
            "friction": None if robot.contacts else friction,
        }

    def _by_frame(self, make: Callable[[np.ndarray], Any]) -> Any:
        """Return what is made of the tool, of several frames by their names."""
        found = {name: make(tool) for name, tool in self.tools.items()}
        return found if len(found) > 1 else found[self.robot.frame]

    def _motion(self) -> Tables:
        path = self.path
        if isinstance(path, Sinusoid):
            return {
                "kind": "sinusoid",
                "amplitude": significant(path.amplitude),
                "period": significant(path.period),
            }
        circle: Tables = {"kind": "circle", "radius": path.radius, "period": path.period}
        if self.filmed:
            return circle | {"radius": self.view.radius, "phase": self.view.phase}
        circle |= {"plane": path.plane, "phase": _rounded(path.phase, 12)}
        count = len(self.robot.frames)
        return circle if count == 1 else {"kind": "stacked", "motions": [circle] * count}

    def remarks(self) -> dict[str, str]:
        """Return what the robot adds to the meaning of keys."""
        robot = self.robot
        return {
            "robot.frame": f"Other ends of chains: {', '.join(robot.ends) or 'none'}.",
            "robot.locked": f"Always locked, off the chain: {', '.join(robot.locked) or 'none'}.",
            "robot.q0": f"Joints: {', '.join(robot.joint_names)}.",
            "truth.tool_translation": "Here 5 % of the reach, away from the base.",
            "truth.payload": "Here a ball of 5 % of the mass.",
        }

    def gains(self) -> Iterator[tuple[str, float | list[float]]]:
        """Yield key and value of each gain of the law that is a number or a diagonal matrix."""
        for key in NAMES:
            gain = getattr(self.controller.law, SYMBOLS.get(key, key), None)
            if isinstance(gain, float | np.ndarray) and np.size(gain) and np.isfinite(gain).all():
                values = significant(np.diag(np.atleast_2d(gain)), 3)
                yield key, values[0] if len(set(values)) == 1 else values


# The file

_ABOUT = {
    "robot": "What pinadapt.load takes.",
    "truth": "Differences between the simulated robot and its description, which the controller "
    "does not know, as Robot.changed takes them. Replace them by what you expect of your robot.",
    "unknown": "What the controller adapts: pinadapt.Unknown.",
    "controller": "What pinadapt.make_controller takes.",
    "limits": "pinadapt.Limits",
    "trajectory": "The desired motion, a class of pinadapt.trajectories. It begins where the robot "
    "is, and keeps joint limits, even with a tool error of 5 % of the reach. as_given = true: at "
    "full speed from the first sample, not from rest.",
    "simulation": "What pinadapt.simulate takes.",
    "engine": "pinadapt.Engine",
    "sensors": "pinadapt.Sensors; noise of a picture is in pixels.",
}


def scenario_text(template: Template, folder: Path) -> str:
    """Return the text of a scenario file in a folder: each key under its meaning.

    Meanings are the first sentences of the docstrings of the classes and functions.
    """
    lines = [f"title = {_written(template.name)}"]
    remarks = template.remarks()
    for name, table in template.tables(folder).items():
        about = meanings(MOTIONS[table["kind"]] if name == "trajectory" else KEYS[name][0])
        lines += ["", *_comment(_ABOUT[name]), f"[{name}]"]
        for key, value in table.items():
            meaning = f"{about.get(key, '')} {remarks.get(f'{name}.{key}', '')}"
            lines += [*_comment(meaning.strip()), f"{key} = {_written(value)}"]
        if name == "controller":
            lines += _comment(
                "Gains in use; remove the # to set your own. A Kv without lag has none; an R_k "
                "that is stated is constant, the default's grows as the estimate becomes certain."
            )
            lines += [f"# {key} = {value}" for key, value in template.gains()]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    """Return the lines of a comment; unprintable characters become spaces."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    return textwrap.wrap(
        printable,
        initial_indent="# ",
        subsequent_indent="# ",
        width=100,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _written(value: Any) -> str:
    """Return a value in TOML, tables inline."""
    if isinstance(value, Mapping):
        pairs = (f"{tomlkit.key(key).as_string()} = {_written(value[key])}" for key in value)
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return tomlkit.item(value).as_string()


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def significant(values: Any, digits: int = 6) -> list[float]:
    """Return numbers with so many significant digits."""
    return [_rounded(value, digits) + 0.0 for value in values]
