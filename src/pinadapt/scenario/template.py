"""A scenario for a robot nobody has written one for: frame, task, home, unknown tool and load, and a circle it can follow."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..adaptation.natural import Natural
from ..controller.controller import Controller
from ..exceptions import RobotError
from ..robot.catalogue import catalogue_entry
from ..robot.chain import is_free_flyer
from ..robot.changes import Payload
from ..robot.end_links import end_links
from ..robot.home import conditioning
from ..robot.robot import Robot, load
from ..robot.urdf import is_path, mimic_joints, read_urdf
from ..robot.workspace import WorkspaceCircle, reach, reachable_circle, rounded_down
from ..tuning.light_joint import LightJoint, lightest_joint
from ..tuning.linearised_loop import gain_matrix
from ..tuning.make_controller import make_controller
from .schema import ControllerSection, SimulationSection

_TOOL = 0.05  # unknown tool, in parts of the reach
_LOAD = 0.05  # unknown load, in parts of the moving mass
_BELIEVED = 0.1  # the same of the load believed in where a joint is light; its radius of gyration is the tool
_PLANAR = ("xy", "xz", "yz")
_FORCES = "adaptive-jacobian"  # the law whose gains are forces
_SHOWN = 12  # names in a comment


@dataclass(frozen=True)
class Template:
    """A scenario to be written.

    Attributes:
        source: catalogue name or URDF path.
        robot: as described, at the home pose that is written.
        circle: one it can follow.
        welded: its base floats in the description.
        ends: other links at which its chain might end.
        others: joints off the chain.
    """

    source: str
    robot: Robot
    circle: WorkspaceCircle
    welded: bool
    ends: Sequence[str]
    others: Sequence[str]

    @classmethod
    def of(cls, source: str, *, frame: str | None = None, task: str | None = None) -> Template:
        """Choose what is not given: the likeliest frame, the largest task, a home pose and a circle.

        Raises:
            RobotError: as ``load`` and ``reachable_circle``, or a robot without a chain of two
                joints.
        """
        model, mimics = _whole(source)
        ends = end_links(model, mimics)
        known = not is_path(source)
        if frame is None and not known:
            if not ends:
                raise RobotError(
                    "no link is moved by two independent joints or more.", where=source
                )
            frame = ends[0]
        welded = not known and any(is_free_flyer(joint) for joint in model.joints[1:])
        robot = (
            load(source, frame=frame, task=task, weld_root=welded)
            if task or known
            else _largest_task(source, frame, welded)
        )
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
        )

    @property
    def name(self) -> str:
        """Name for the file and the title."""
        return Path(self.source).stem if is_path(self.source) else self.source

    def text(self, folder: Path) -> str:
        """Return the scenario file; a relative URDF path is written relative to the folder it will lie in."""
        return "\n".join(
            [
                *self._robot(folder),
                *self._truth(),
                *self._belief(),
                *self._controller(),
                *self._motion(),
            ]
        )

    def _robot(self, folder: Path) -> Iterable[str]:
        source, robot = self.source, self.robot
        if is_path(source) and not Path(source).is_absolute():
            source = os.path.join(
                os.path.relpath(Path(source).resolve().parent, folder.resolve()), Path(source).name
            )
        yield f"title = {_string(self.name)}"
        yield "\n[robot]"
        yield f"source = {_string(source)}"
        yield f"# Other ends of chains: {_names(self.ends)}; any link of the robot can be named."
        yield f"frame = {_string(robot.frame)}"
        yield "# The controlled coordinates of the frame, in world axes: xyz, xy, xz, yz, or pose, which adds the orientation."
        yield f"task = {_string(robot.task.name)}"
        if self.welded:
            yield "# The base floats in the description: it is fixed, and the chain is used as an arm."
            yield "weld_root = true"
        yield f"# Joints of the chain to lock as well. Locked anyway, for they are not on it: {_names(self.others)}."
        yield "locked = []"
        yield f"# Home pose, where the motion starts [rad or m]: {', '.join(robot.joint_names)}."
        yield f"q0 = {_numbers(robot.home_angles)}"

    def _truth(self) -> Iterable[str]:
        tool, mass = _further_out(self.robot), _three(_LOAD * self._mass)
        load = _ball(mass, 0.5 * _TOOL * reach(self.robot) * 0.4**0.5, tool)
        yield "\n# How the simulated robot differs from its description, which the controller is not told. Here: a tool"
        yield f"# {100 * _TOOL:g} % of the reach longer [m, frame's axes], in its end a ball of {100 * _LOAD:g} % of the mass"
        yield "# [kg; com m from the described frame; Ixx Ixy Iyy Ixz Iyz Izz kg m^2]. Put what you expect of your robot."
        yield "[truth]"
        yield f"tool_translation = {_numbers(tool)}"
        yield f"payload = {_table(load)}"
        yield "# inertial_scale = 1.3                           # every mass and inertia 30 % above its description"
        yield "# friction = { viscous = 0.1, coulomb = 0.05 }   # [N m s/rad, N m], or one number a joint"
        yield "\n# What the controller adapts: the tool's translation, and all inertial parameters of every body."
        yield "[unknown]"
        yield 'kinematic = ["tool"]'
        yield 'dynamic = "all"'

    def _belief(self) -> Iterable[str]:
        if (light := self._light) is None:
            return
        load, arm = rounded_down(light.load), 1e3 * light.arm
        yield f"\n# {light.joint} moves so little that laws whose feedback is M_hat times an acceleration can lose it under an"
        yield f"# unknown load above {load} kg, {arm:.0f} mm off its axis."
        if (guess := self._guess) is None:
            yield "# The law below has gains that are forces instead."
            return
        yield "# A load believed from the start keeps it, whether there is one or not."
        yield "[belief]"
        yield f"payload = {_table(guess)}"

    def _controller(self) -> Iterable[str]:
        law, controller = ControllerSection().law, self._main
        if self._guess is not None:
            controller = _made(self.robot.changed(payload=self._guess), law)
        elif self._light is not None:
            law = _FORCES
            controller = _made(self.robot, law)
        yield "\n[controller]"
        yield f"law = {_string(law)}"
        yield 'adaptation = "natural"'
        yield "# These gains are chosen for this robot, law and sampling period; take the # away to set your own."
        yield from (
            f"# {f'{key} = {value}':<20} # {meaning}" for key, value, meaning in _gains(controller)
        )

    def _motion(self) -> Iterable[str]:
        circle = self.circle
        yield "\n# A circle through the tool's first position, which the arm follows inside its joint limits and away from"
        yield "# singularities, also with a tool 5 % of its reach off."
        yield "[reference]"
        yield 'kind = "circle"'
        yield f"radius = {circle.radius}"
        yield f"period = {circle.period}"
        yield f"plane = {_string(circle.plane)}"
        yield f"phase = {circle.phase:.6g}"
        yield "\n[simulation]"
        yield f"duration = {float(ceil(max(10.0, 2 * circle.period)))}"
        yield f"dt = {SimulationSection().dt}"
        yield "# torque_limits = true                            # hold the torque inside the description's effort limits\n"

    @property
    def _mass(self) -> float:
        return float(pin.computeTotalMass(self.robot.model))

    @cached_property
    def _main(self) -> Controller:
        """The controller with the main law."""
        return _made(self.robot, ControllerSection().law)

    @cached_property
    def _light(self) -> LightJoint | None:
        """The joint that the main law may lose."""
        assert self._main.loop is not None  # make_controller gives one
        return lightest_joint(self.robot, self._main.loop, self._main.law.gains)

    @cached_property
    def _guess(self) -> Payload | None:
        """A load to believe in, whose inertia the light joint's damping bears at this period even where there is no load."""
        if (light := self._light) is None:
            return None
        guess = _ball(_three(_BELIEVED * self._mass), light.arm, np.zeros(3))
        heavier = 1.0 + guess.mass * light.arm**2 / light.inertia
        return (
            None
            if heavier * self._main.law.gains.K_v[0, 0] * SimulationSection().dt > 2.0
            else guess
        )


def _ball(mass: float, gyration: float, com: np.ndarray) -> Payload:
    """Return a load of a mass [kg] with a radius of gyration [m] at a place (3) [m] in the frame's axes."""
    moment = _three(mass * gyration**2)
    return Payload(mass, com, (moment, 0.0, moment, 0.0, 0.0, moment))


def _table(load: Payload) -> str:
    """Return a load as it is written in a scenario."""
    com, inertia = (_numbers(np.asarray(entries)) for entries in (load.com, load.inertia))
    return f"{{ mass = {load.mass}, com = {com}, inertia = {inertia} }}"


def _whole(source: str) -> tuple[pin.Model, frozenset[str]]:
    """Return the whole model behind a source, and its mimic joints."""
    if is_path(source):
        return read_urdf(Path(source), meshes=False)[0], mimic_joints(Path(source))
    model, _, _, mimics = catalogue_entry(source).load()
    return model, mimics


def _largest_task(source: str, frame: str | None, welded: bool) -> Robot:
    """Return the robot with the task "xyz", or with the best conditioned plane if it cannot do that."""
    try:
        return load(source, frame=frame, task="xyz", weld_root=welded)
    except RobotError as error:
        if error.where != "task":
            raise
    robots = []
    for task in _PLANAR:
        try:
            robots.append(load(source, frame=frame, task=task, weld_root=welded))
        except RobotError as error:
            if error.where != "task" or (task == _PLANAR[-1] and not robots):
                raise
    return max(robots, key=_conditioning)


def _conditioning(robot: Robot) -> float:
    return conditioning(
        robot.model, robot.model.createData(), robot.frame_id, robot.task.rows, robot.q0
    )[1]


def _further_out(robot: Robot) -> np.ndarray:
    """Return a tool (3) [m], in the frame's axes, that lengthens the arm where the task can see it."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    frame, seen = data.oMf[robot.frame_id], np.zeros(3)
    length = _TOOL * reach(robot)
    for placement in reversed(list(data.oMi)):
        seen[robot.task.place] = (frame.translation - placement.translation)[robot.task.place]
        if np.linalg.norm(seen) > 0.1 * length:
            break
    tool = frame.rotation.T @ seen * (length / np.linalg.norm(seen))
    return np.round(tool, 3 - int(np.floor(np.log10(length))))


def _made(robot: Robot, law: str) -> Controller:
    """Return the controller with a law's default gains."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the file says what there is to say
        return make_controller(robot, law=law, dt=SimulationSection().dt)


def _gains(controller: Controller) -> Iterable[tuple[str, str, str]]:
    """Return key, default and meaning of the gains."""
    law, natural = controller.law, controller.adaptation_d
    assert isinstance(natural, Natural)  # the default
    rate_k = gain_matrix(controller.adaptation_k, controller.kinematics.initial)
    kinds = (
        ("N s/m, for rotations N m s/rad", "N/m, for rotations N m/rad")
        if law.energy_based
        else ("1/s", "1/s^2")
    )
    yield "Kv", _gain(law.gains.K_v), f"velocity gain [{kinds[0]}]"
    yield "Kp", _gain(law.gains.K_P), f"position gain [{kinds[1]}]"
    yield "alpha", _gain(law.gains.alpha), "e = velocity error + alpha position error [1/s]"
    yield "gamma_d", _gain(natural.gamma), "rate of the inertial parameters"
    yield "gamma_k", _gain(rate_k), "rate of the tool"
    yield "R_k", _gain(law.gains.R_k), "weight of the tool's prediction error"
    yield "lambda", _gain(controller.velocity_filter.bandwidth), "velocity filter [1/s]"
    if not law.energy_based:
        yield (
            "lambda_a",
            _gain(1.0 / controller.acceleration_filter.bandwidth),
            "acceleration filter [s]",
        )


def _gain(gain: float | np.ndarray) -> str:
    """Return a gain as it would be written: a number, or the diagonal of a matrix whose entries differ."""
    values = [
        _three(value) for value in (np.diag(gain) if isinstance(gain, np.ndarray) else [gain])
    ]
    return str(values[0]) if len(set(values)) == 1 else str(values)


def _three(number: float) -> float:
    return float(f"{number:.3g}")


def _numbers(values: Iterable[float]) -> str:
    return str([float(f"{value:.6g}") + 0.0 for value in values])


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _names(names: Sequence[str]) -> str:
    if not names:
        return "none"
    return ", ".join(names[:_SHOWN]) + (
        f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    )
