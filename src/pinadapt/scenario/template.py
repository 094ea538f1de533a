"""A scenario chosen for a robot: frame, task, home, tool, load, and a circle it can follow."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..controller.controller import Controller
from ..laws import DEFAULT, LAWS
from ..robot.chain import links_of, massless_joints
from ..robot.changes import Payload
from ..robot.description import describe
from ..robot.loading import load
from ..robot.robot import Robot
from ..robot.urdf import is_path
from ..robot.workspace import WorkspaceCircle, find_circle
from ..robot.xacro import XacroArguments
from ..tuning.make_controller import make_controller
from .schema import SimulationSection
from .template_gains import three_digits

_TOOL = 0.05  # unknown tool, in parts of the reach
_LOAD = 0.05  # unknown load, in parts of the moving mass


@dataclass(frozen=True)
class Template:
    """A scenario to be written.

    Attributes:
        source: a path or a name.
        robot: as described, at the home pose that is written.
        circle: one it can follow.
        xacro: arguments of a xacro file.
        mass: what the whole robot weighs [kg], where links are described without inertia.
        massless: these links, one for each such body.
        law: of the controller.
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
        """Take what ``load`` chooses where it is not given, and a circle.

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
        """Name for the file and the title."""
        if not is_path(self.source):
            return self.source
        return Path(self.source.removesuffix(".xacro")).stem

    @property
    def tool_share(self) -> float:
        """Length of the unknown tool in parts of the reach."""
        return _TOOL

    @property
    def load_share(self) -> float:
        """Mass of the unknown load in parts of the moving mass."""
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
        """The controller with default gains, for the robot as it is believed."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what matters of it is written into the file
            return make_controller(self.robot, law=self.law, dt=SimulationSection().dt)

    @property
    def rests(self) -> bool:
        """Whether the law is for a set point: the opposite point of the circle."""
        return LAWS[self.law].set_point


def _ball(mass: float, gyration: float, com: np.ndarray) -> Payload:
    """Return a load: mass [kg], radius of gyration [m], centre (3) [m] in the frame's axes."""
    moment = three_digits(mass * gyration**2)
    return Payload(mass, com, (moment, 0.0, moment, 0.0, 0.0, moment))


def _further_out(robot: Robot) -> np.ndarray:
    """Return a tool (3) [m], in the frame's axes, that lengthens the arm as the task sees it."""
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
