"""A robot as the library sees it: one open chain, one task frame, one starting pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import flag, vector
from .._files import write_text
from .._table import Sheet, Table
from ..description.chain import (
    angles_from_configuration,
    configuration_from_angles,
    effort_limits,
    frame_id,
    is_slide,
    position_limits,
    reach,
    reduce_visual,
    velocity_limits,
    warn_beyond_limits,
)
from ..description.urdf import Origin
from ..description.urdf_writer import WrittenChain, urdf_text
from ..exceptions import RobotError
from ..tasks.frame import FrameTask
from ..tasks.task import Task
from . import changes
from .changes import Friction
from .home import MountingPlane

_HEADER = ("joint", "home", "lower", "upper", "speed", "effort", "units")
_UNITS = ("rad, rad/s, N m", "m, m/s, N")
_SHOWN = 6  # names of other ends


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """An open chain of revolute, continuous and prismatic joints that carries a task frame.

    Immutable by convention: whoever needs to change the model takes ``model.copy()``. ``print``
    shows it.

    Attributes:
        name: catalogue name or the model's own.
        model: Pinocchio model of the chain alone, everything off the chain locked into it.
        frame: name of the task frame.
        task: the controlled coordinates of that frame.
        q0: (nq) home configuration.
        friction: joint friction, of the real robot or as believed; descriptions have none.
        drawn: its visual geometry, not read yet, or None.
        ends: other frames of the description at which its chain might end, the likeliest first.
        locked: joints of the description that are not of the chain.
        welded: whether the base floats in the description.
        mounting: the plane that the chain is mounted on; None for a floating base and for robots of
            the catalogue, whose homes are stated or searched without one.
        loads: what it carries since it was loaded, in the axes of the last joint; the model has it.
        origin: the URDF it was read from, with the chain as that has it, or None.
    """

    name: str
    model: pin.Model
    frame: str
    task: Task
    q0: np.ndarray
    friction: Friction
    drawn: Visual | None = None
    ends: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    welded: bool = False
    mounting: MountingPlane | None = None
    loads: tuple[pin.Inertia, ...] = ()
    origin: Origin | None = None

    @property
    def visual(self) -> pin.GeometryModel | None:
        """The geometry to draw, read when it is first asked for, or None."""
        return None if self.drawn is None else self.drawn.geometry

    @cached_property
    def frame_id(self) -> int:
        """Index of the task frame in ``model.frames``."""
        return frame_id(self.model, self.frame)

    @property
    def joint_names(self) -> list[str]:
        """Names of the chain's joints, from the base."""
        return [str(name) for name in self.model.names[1:]]

    @property
    def slides(self) -> dict[str, bool]:
        """Joint name -> whether it is prismatic."""
        joints = self.model.joints[1:]
        return {name: is_slide(j) for name, j in zip(self.joint_names, joints, strict=True)}

    @property
    def home_angles(self) -> np.ndarray:
        """The home configuration as one number a joint (nv) [rad or m]."""
        return angles_from_configuration(self.model, self.q0)

    @cached_property
    def reach(self) -> float:
        """Length [m] of the stretched chain from its first joint to the frame, slides extended."""
        return reach(self.model, self.frame_id)

    @property
    def mass(self) -> float:
        """Mass [kg] of all that the joints move."""
        return float(pin.computeTotalMass(self.model))

    @property
    def frame_task(self) -> FrameTask:
        """The task as one of the frame, which has rows of its Jacobian.

        Raises:
            RobotError: it is one of the joints.
        """
        if not isinstance(self.task, FrameTask):
            raise RobotError(
                f"this needs a task of the frame; the task is '{self.task.name}'.",
                where="task",
                hint='Load the robot with task = "xyz".',
            )
        return self.task

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return the task coordinates x of this description at configuration q (nq), in world axes.

        Positions (m) [m]; for a pose position and quaternion xyzw (7).

        Raises:
            RobotError: not nq finite numbers.
        """
        q = vector(q, self.model.nq, "q", error=RobotError)
        return self.task.at(self.model, self.model.createData(), self.frame_id, q)

    def placement(self, q: np.ndarray) -> pin.SE3:
        """Return the placement of the described task frame at q (nq), in world axes.

        Raises:
            RobotError: not nq finite numbers.
        """
        q, data = vector(q, self.model.nq, "q", error=RobotError), self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return data.oMf[self.frame_id].copy()

    def at(self, q0: ArrayLike) -> Robot:
        """Return this robot with another home pose, given as one number a joint (nv) [rad or m].

        A joint outside its limits is warned of.

        Raises:
            RobotError: wrong size or non-finite numbers.
        """
        angles = vector(q0, self.model.nv, "q0", names=self.joint_names, error=RobotError)
        warn_beyond_limits(self.model, angles)
        return replace(self, q0=configuration_from_angles(self.model, angles))

    def changed(
        self,
        *,
        inertial_scale: float | Mapping[str, float] = 1.0,
        payload: changes.Payload | None = None,
        tool_translation: ArrayLike | None = None,
        link_translation: Mapping[str, ArrayLike] | None = None,
        armature: ArrayLike | None = None,
        viscous: ArrayLike | None = None,
        coulomb: ArrayLike | None = None,
    ) -> Robot:
        """Return another robot that differs from this one as stated; the models share nothing.

        Args:
            inertial_scale: factor on mass and inertia of all bodies, or joint name -> factor.
            payload: load fixed to the last body; placed from this robot's frame, before the tool
                moves it.
            tool_translation: (3) [m] added to the frame's origin, in the frame's axes.
            link_translation: joint name -> (3) [m] added to that joint's placement, parent axes.
            armature: rotor inertia as the joint feels it, number or (nv) [kg m^2 or kg]; default:
                as it is.
            viscous: friction, number or (nv) [N m s/rad or N s/m]; default: as it is.
            coulomb: friction, number or (nv) [N m or N]; default: as it is.

        Raises:
            RobotError: unknown joints, wrong sizes, factors or masses that are not positive.
        """
        model = self.model.copy()
        changes.scale_inertias(model, inertial_scale)
        loads = self.loads
        if payload is not None:
            loads = *loads, changes.attach_payload(model, self.frame_id, payload)
        changes.shift_joints(model, link_translation)
        if tool_translation is not None:
            changes.shift_tool(model, self.frame_id, tool_translation)
        model.armature = self._coefficients(armature, "armature", model.armature)
        friction = Friction(
            self._coefficients(viscous, "friction.viscous", self.friction.viscous),
            self._coefficients(coulomb, "friction.coulomb", self.friction.coulomb),
        )
        return replace(self, model=model, friction=friction, loads=loads)

    def urdf(self, *, shapes: bool = True) -> str:
        """Return this robot as a URDF that Pinocchio and MuJoCo read.

        Where it was read from a URDF, from a file, a xacro or the catalogue, that text, without its
        comments, with the numbers in which this robot differs: inertias of the links of changed
        bodies, placements of moved joints and of the task frame, damping and friction of joints. A
        first comment names them. Paths of meshes that are found are written whole. The first link
        of a body takes what changed; the others, fixed to it or locked, keep theirs where that
        leaves a physical rest, else a share. The frame is moved by its own fixed joint where it
        is a last link, else it is a new link, which the comment names. Of any other source the
        chain alone is written. Gravity and where the base stands have no place in a URDF; a rotor
        inertia is an attribute ``armature`` that only ``load(..., joint_effects=True)`` reads.

        Args:
            shapes: with the visual and collision shapes of the description; MuJoCo refuses those
                whose meshes are neither STL nor OBJ.

        Raises:
            RobotError: a changed body that no distribution of mass has, or a source that is gone.
        """
        chain = WrittenChain(
            self.name,
            self.model,
            self.frame,
            self.friction.viscous,
            self.friction.coulomb,
            self.origin,
        )
        return urdf_text(chain, shapes=flag(shapes, "shapes"))

    def save(self, path: Path | str, *, shapes: bool = True) -> None:
        """Write ``urdf`` to a file, whole or not at all; its folder is made if it is missing.

        Raises:
            RobotError: as ``urdf``.
        """
        write_text(Path(path), self.urdf(shapes=shapes))

    def undrawn(self) -> Robot:
        """Return this robot without the geometry to draw, which no controller needs."""
        return replace(self, drawn=None)

    def __repr__(self) -> str:
        """Return a table: frame, task, size, other ends, and the joints with their limits."""
        return str(robot_sheet(self))

    def _repr_html_(self) -> str:
        return robot_sheet(self).html()

    def _coefficients(self, given: ArrayLike | None, where: str, default: np.ndarray) -> np.ndarray:
        """Return coefficients (nv), one a joint, or refuse negative ones."""
        if given is None:
            return np.array(default, dtype=float)
        numbers = vector(given, self.model.nv, where, names=self.joint_names, error=RobotError)
        if (numbers < 0.0).any():
            raise RobotError(f"must not be negative, got {numbers.tolist()}.", where=where)
        return numbers


@dataclass(frozen=True, eq=False)
class Visual:
    """The visual geometry of a chain, read from its meshes when it is first drawn.

    Attributes:
        read: returns the geometry of the whole robot, or None.
        whole: model of the whole robot.
        keep: indices of the chain's joints in it.
        q_reference: (nq) where the other joints are locked.
    """

    read: Callable[[], pin.GeometryModel | None]
    whole: pin.Model
    keep: tuple[int, ...]
    q_reference: np.ndarray

    @cached_property
    def geometry(self) -> pin.GeometryModel | None:
        """The geometry of the chain, or None where there is none."""
        visual = self.read()
        if visual is None:
            return None
        return reduce_visual(self.whole, visual, self.keep, self.q_reference)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy without the meshes, which are read again where they are needed."""
        return type(self), (self.read, self.whole, self.keep, self.q_reference)


def robot_sheet(robot: Robot) -> Sheet:
    """Return what a robot is, and its joints with home and limits; a dash where there is none."""
    words = [
        ("frame", robot.frame + (", its floating base welded" if robot.welded else "")),
        ("task", robot.task.name),
        ("moving mass", f"{robot.mass:.4g} kg"),
        ("reach", f"{robot.reach:.4g} m"),
    ]
    if robot.ends:
        words.append(("other ends", names_shown(robot.ends)))
    if robot.locked:
        words.append(("locked joints", names_shown(robot.locked)))
    joints = Table(_joint_rows(robot), _HEADER)
    return Sheet(f"{robot.name}, {robot.model.nv} joints", [Table(words), joints])


def names_shown(names: tuple[str, ...], shown: int = _SHOWN) -> str:
    """Return the first names, and how many more there are."""
    more = f" and {len(names) - shown} more" if len(names) > shown else ""
    return ", ".join(names[:shown]) + more


def _joint_rows(robot: Robot) -> list[tuple[str, ...]]:
    model = robot.model
    lower, upper = position_limits(model)
    columns = (robot.home_angles, lower, upper, velocity_limits(model), effort_limits(robot.model))
    numbers = np.column_stack(columns)
    return [
        (name, *map(_shown, row), _UNITS[is_slide(joint)])
        for name, row, joint in zip(robot.joint_names, numbers, model.joints[1:], strict=True)
    ]


def _shown(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"
