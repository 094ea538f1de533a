"""A scenario chosen for a robot: frame, task, home, tool, load, and a circle it can follow."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..controller.controller import Controller
from ..exceptions import RobotError
from ..robot.chain import is_free_flyer, links_of, massless_joints
from ..robot.changes import Payload
from ..robot.description import describe
from ..robot.end_links import end_links
from ..robot.home import conditioning
from ..robot.robot import Robot, load
from ..robot.urdf import is_path
from ..robot.workspace import WorkspaceCircle, reach, reachable_circle
from ..robot.xacro import XacroArguments
from ..tuning.make_controller import make_controller
from .schema import SimulationSection
from .template_gains import three_digits

_TOOL = 0.05  # unknown tool, in parts of the reach
_LOAD = 0.05  # unknown load, in parts of the moving mass
_PLANAR = ("xy", "xz", "yz")


@dataclass(frozen=True)
class Template:
    """A scenario to be written.

    Attributes:
        source: a path or a name.
        robot: as described, at the home pose that is written.
        circle: one it can follow.
        welded: its base floats in the description.
        ends: other links at which its chain might end.
        others: joints off the chain.
        xacro: arguments of a xacro file.
        mass: what the whole robot weighs [kg], where links are described without inertia.
        massless: these links, one for each such body.
    """

    source: str
    robot: Robot
    circle: WorkspaceCircle
    welded: bool
    ends: Sequence[str]
    others: Sequence[str]
    xacro: XacroArguments
    mass: float | None
    massless: Sequence[str]

    @classmethod
    def of(
        cls,
        source: str,
        *,
        frame: str | None = None,
        task: str | None = None,
        xacro: XacroArguments | None = None,
        mass: float | None = None,
    ) -> Template:
        """Choose what is not given: likeliest frame, largest task, a home pose and a circle.

        Raises:
            RobotError: as ``load`` and ``reachable_circle``, or a robot without a chain of two
                joints.
        """
        whole = describe(source, xacro=xacro)
        model, known = whole.model, whole.frame is not None
        ends = end_links(model, whole.mimics)
        if frame is None and not known:
            frame = _likeliest(ends, source)
        welded = not known and any(is_free_flyer(joint) for joint in model.joints[1:])
        read = partial(load, source, frame=frame, weld_root=welded, xacro=xacro, mass=mass)
        robot = read(task=task) if task or known else _largest_task(read)
        robot = robot.at(np.round(robot.home_angles, 4))
        others = [
            str(name)
            for name in model.names[1:]
            if str(name) not in robot.joint_names and name != "root_joint"
        ]
        return cls(
            source,
            robot,
            reachable_circle(robot),
            welded,
            [end for end in ends if end != robot.frame],
            others,
            xacro or {},
            mass,
            [links_of(model, joint)[0] for joint in massless_joints(model)],
        )

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
        gyration = 0.5 * _TOOL * reach(self.robot) * 0.4**0.5
        return _ball(three_digits(_LOAD * self._mass), gyration, self.tool)

    @cached_property
    def controller(self) -> Controller:
        """The controller with the default law, at the robot as it is believed."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what matters of it is written into the file
            return make_controller(self.robot, dt=SimulationSection().dt)

    @property
    def _mass(self) -> float:
        return float(pin.computeTotalMass(self.robot.model))


def _ball(mass: float, gyration: float, com: np.ndarray) -> Payload:
    """Return a load: mass [kg], radius of gyration [m], centre (3) [m] in the frame's axes."""
    moment = three_digits(mass * gyration**2)
    return Payload(mass, com, (moment, 0.0, moment, 0.0, 0.0, moment))


def _likeliest(ends: Sequence[str], source: str) -> str:
    if not ends:
        raise RobotError("no link is moved by two independent joints or more.", where=source)
    return ends[0]


def _largest_task(read: Callable[..., Robot]) -> Robot:
    """Return the robot with the task "xyz", or else with the best conditioned plane."""
    try:
        return read(task="xyz")
    except RobotError as error:
        if error.where != "task":
            raise
    robots = []
    for task in _PLANAR:
        try:
            robots.append(read(task=task))
        except RobotError as error:
            if error.where != "task" or (task == _PLANAR[-1] and not robots):
                raise
    return max(robots, key=_conditioning)


def _conditioning(robot: Robot) -> float:
    return conditioning(
        robot.model, robot.model.createData(), robot.frame_id, robot.frame_task.rows, robot.q0
    )[1]


def _further_out(robot: Robot) -> np.ndarray:
    """Return a tool (3) [m], in the frame's axes, that lengthens the arm as the task sees it."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    frame, seen = data.oMf[robot.frame_id], np.zeros(3)
    length = _TOOL * reach(robot)
    for placement in reversed(list(data.oMi)):
        seen[robot.frame_task.place] = (frame.translation - placement.translation)[
            robot.frame_task.place
        ]
        if np.linalg.norm(seen) > 0.1 * length:
            break
    tool = frame.rotation.T @ seen * (length / np.linalg.norm(seen))
    return np.round(tool, 3 - int(np.floor(np.log10(length))))
