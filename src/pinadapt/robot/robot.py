"""A robot as the library sees it: one open chain, one task frame, one starting pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import arithmetic, flag, instance, name_list, vector
from .._files import write_text
from ..exceptions import RobotError
from ..tasks.task import FrameTask, Task
from . import changes
from .chain import (
    angles_from_configuration,
    chain_joints,
    check_joints,
    check_mass_matrix,
    configuration_from_angles,
    frame_id,
    is_free_flyer,
    is_slide,
    reduce_to_chain,
)
from .choice import choose_frame, choose_task
from .description import Description, Source, describe
from .end_links import end_links
from .friction import Friction
from .joint_effects import described_effects
from .mounting import MountingPlane
from .origin import Origin
from .position_limits import check_position_limits, warn_beyond_limits
from .reach import reach
from .robot_sheet import robot_sheet
from .urdf_text import urdf_text
from .visual import Visual
from .xacro import XacroArguments


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
        return urdf_text(self, shapes=flag(shapes, "shapes"))

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


@arithmetic("robot", RobotError)
def load(
    source: Source,
    *,
    frame: str | None = None,
    task: str | None = None,
    locked: str | Sequence[str] = (),
    q0: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    weld_root: bool | None = None,
    xacro: XacroArguments | None = None,
    mass: float | None = None,
    joint_effects: bool = False,
) -> Robot:
    """Load any robot and keep the chain from its base to one frame.

    What is not given is chosen, for every source and by everybody (``pinadapt init`` as well) in
    the same way; ``print(robot)`` shows what was, and the other ends of chains.

    Args:
        source: path of a URDF, xacro or MJCF file, catalogue name, name of the package
            robot_descriptions, ``pin.Model`` or ``RobotWrapper``; never written to.
        frame: task frame, by default the catalogue's, else the end of a chain that looks most like
            a tool, see ``end_links``.
        task: "xy", "xz", "yz", "xyz" or "pose" of the frame, or "joint", the joints themselves; by
            default the catalogue's, else "xyz", or the best conditioned plane where the chain
            cannot do that.
        locked: joints of the chain to lock as well; joints off the chain always are.
        q0: home pose, one number a remaining joint (nv) [rad or m]; by default the catalogue's, the
            description's own where it is well conditioned, else a well-conditioned one; inside the
            limits, and off the plane that the chain is mounted on, see ``MountingPlane``. Of a
            joint task the description's own inside the limits, else their middle.
        gravity: (3) [m/s^2] in world axes, by default the model's.
        weld_root: fix a floating base where the reference configuration has it, or refuse it; by
            default that of a file is fixed, that of an object refused, which has it on purpose.
            Robots of the catalogue are always fixed.
        xacro: arguments of a xacro file, name -> text, number or bool.
        mass: what the whole robot weighs [kg], its base included, where bodies are described
            without mass: these get what the others leave of it; see ``missing_inertia``.
        joint_effects: believe the damping, friction and rotor inertia that the description states
            of its joints; by default friction is none, as most descriptions only hold a place
            for it.

    Raises:
        RobotError: missing file, bad XML, unknown frame or joint, floating base, mimic or
            unsupported joints, crossed limits, a singular mass matrix, too few joints for the task,
            wrong sizes or NaN.
    """
    for given, where in ((frame, "frame"), (task, "task")):
        instance(given, str | None, where, RobotError)
    locked = name_list(locked, "locked", RobotError)
    found = describe(source, xacro=xacro, mass=mass)
    ends = end_links(found.model, found.mimics)
    name = frame or found.frame or choose_frame(found.model, ends, task)
    weld = found.from_file if weld_root is None else flag(weld_root, "weld_root")
    keep = _kept_joints(found, name, [*found.locked, *locked], weld or found.weld_root)
    model = reduce_to_chain(found.model, keep, found.q_reference)
    check_position_limits(model)
    if gravity is not None:
        model.gravity.linear = vector(gravity, 3, "gravity", error=RobotError)
    poses, welded = _reference_poses(found, model, keep), _floats(found.model, name)
    tip, mounted = frame_id(model, name), not (welded or found.weld_root)
    plane = MountingPlane.of(model, tip, poses[0]) if mounted else None
    chosen, home = choose_task(model, tip, task or found.task, poses, plane)
    robot = Robot(
        found.name,
        model,
        name,
        chosen,
        home,
        Friction.none(model.nv),
        Visual(found.visual, found.model, tuple(keep), found.q_reference),
        ends=tuple(end for end in ends if end != name),
        locked=_off_chain(found.model, keep),
        welded=welded,
        mounting=plane,
        origin=None if found.urdf is None else Origin(found.urdf, model.copy()),
    )
    if flag(joint_effects, "joint_effects"):
        armature, viscous, coulomb = described_effects(robot)
        robot = robot.changed(armature=armature, viscous=viscous, coulomb=coulomb)
    if q0 is not None:
        robot = robot.at(q0)
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (3, model.nv))
    check_mass_matrix(
        model, [robot.q0, *(configuration_from_angles(model, sample) for sample in samples)]
    )
    return robot


def _kept_joints(
    found: Description, frame: str, locked: Sequence[str], weld_root: bool
) -> list[int]:
    """Return the joints from base to frame that are not locked; refuse the unsupported ones."""
    chain = chain_joints(found.model, frame_id(found.model, frame))
    if weld_root:
        chain = [j for j in chain if not is_free_flyer(found.model.joints[j])]
    for name in locked:
        changes.joint_id(found.model, name, "locked")
    keep = [joint for joint in chain if str(found.model.names[joint]) not in set(locked)]
    check_joints(found.model, keep)
    mimics = [str(found.model.names[j]) for j in keep if str(found.model.names[j]) in found.mimics]
    if mimics:
        raise RobotError(
            f"joints {mimics} mimic other joints, which laws for independent joints do not cover.",
            where=found.name,
            hint="Lock them, or choose a frame before them.",
        )
    if not keep:
        raise RobotError(
            f"no moving joint lies between the base and frame '{frame}'.", where=found.name
        )
    return keep


def _floats(model: pin.Model, frame: str) -> bool:
    """Tell whether a floating joint lies between the base and a frame."""
    joints = chain_joints(model, frame_id(model, frame))
    return any(is_free_flyer(model.joints[joint]) for joint in joints)


def _off_chain(model: pin.Model, keep: Sequence[int]) -> tuple[str, ...]:
    """Return the names of the joints that are not kept, but for a floating one."""
    kept = set(keep)
    return tuple(
        str(model.names[joint])
        for joint in range(1, model.njoints)
        if joint not in kept and not is_free_flyer(model.joints[joint])
    )


def _reference_poses(found: Description, model: pin.Model, keep: Sequence[int]) -> list[Any]:
    """Return the description's poses of the chain (nq): its reference and the neutral one."""
    parts = [
        found.q_reference[j.idx_q : j.idx_q + j.nq] for j in (found.model.joints[k] for k in keep)
    ]
    return [np.concatenate(parts), pin.neutral(model)]
