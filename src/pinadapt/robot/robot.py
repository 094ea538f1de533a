"""A robot: one open chain with a task frame and a home pose; and one that changes over time."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import (
    ROUNDING,
    flag,
    instance,
    joint_numbers,
    mapping,
    numbers,
    positive,
    vector,
    whole,
    word,
)
from .._output import Printed, Report, Table, write_text
from ..description.chain import (
    angles_from_configuration,
    chain_joints,
    configuration_from_angles,
    effort_limits,
    frame_id,
    frame_named,
    position_limits,
    reach,
    reduced,
    sliding_joints,
    velocity_limits,
)
from ..description.floating_base import BASE_JOINTS
from ..description.mjcf import mjcf_text
from ..description.urdf import Origin
from ..description.urdf_writer import urdf_text
from ..exceptions import InputError, RobotError
from ..tasks.frame import TASKS, FrameTask, ImageTask
from ..tasks.task import JointTask, Task
from . import changes
from .changes import Friction
from .constraints import Constraint, Constraints, Contact, Coupling, consistent
from .home import MountingPlane

_HEADER = ("joint", "home", "lower", "upper", "speed", "effort", "units")
_UNITS = ("rad, rad/s, N m", "m, m/s, N")


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Printed):
    """An open chain of revolute, continuous and prismatic joints that carries a task frame.

    Immutable by convention: to change the model, take ``model.copy()``. ``print`` shows a table.

    Attributes:
        name: name in the catalogue, or of the model.
        model: Pinocchio model of the chain; all other joints of the description are locked in it.
        frame: name of the task frame, the first one if there are several.
        task: the controlled coordinates of that frame, or of several.
        q0: (nq) home configuration.
        friction: joint friction; zero unless stated, as descriptions rarely have measured values.
        drawn: the visual geometry, read on demand, or None.
        ends: other frames of the description at which the chain could end, best candidate first.
        locked: joints of the description that are not part of the chain.
        welded: whether the description has a floating base, which is fixed here.
        mounting: the plane that the chain is mounted on; none for a floating base and for robots of
            the catalogue.
        loads: loads added with ``changed``, each after the index of the joint in whose axes it is;
            the model contains them.
        tracker: the placement of the base in the axes in which x is measured, which the model has,
            see ``seen_from``; None: x is in the axes of the base.
        origin: the URDF that the robot was read from, or None.
        constraints: of its motion; the contacts come last.
        passive: joints without a motor, beside those of a free base and those that follow others.
        remark: about where its parameters come from, for the first comment of its URDF.
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
    mounting: MountingPlane = field(default_factory=MountingPlane)
    loads: tuple[tuple[int, pin.Inertia], ...] = ()
    tracker: pin.SE3 | None = None
    origin: Origin | None = None
    remark: str = ""
    constraints: tuple[Constraint, ...] = ()
    passive: tuple[str, ...] = ()

    @property
    def visual(self) -> pin.GeometryModel | None:
        """The visual geometry of the chain, read at first use, or None."""
        return None if self.drawn is None else self.drawn.geometry

    @cached_property
    def frame_id(self) -> int:
        """Index of the task frame in ``model.frames``."""
        return frame_id(self.model, self.frame)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all task frames."""
        return tuple(self.task.frames) or (self.frame,)

    @property
    def frame_ids(self) -> list[int]:
        """Indices of all task frames in ``model.frames``."""
        return [frame_id(self.model, name) for name in self.frames]

    @property
    def carriers(self) -> list[int]:
        """Indices, from 0, ascending, of the bodies that carry a task frame and a load."""
        return sorted({self.model.frames[frame].parentJoint - 1 for frame in self.frame_ids})

    def check_single_frame(self) -> None:
        """Refuse a robot with several task frames.

        Raises:
            RobotError: it has several.
        """
        if len(self.frames) > 1:
            raise RobotError(
                f"this needs one task frame, and there are {len(self.frames)}.",
                where="frames",
                hint=f'Load the robot with frame = "{self.frame}".',
            )

    def of_frame(self, frame: str) -> Robot:
        """Return this robot with one of its several task frames alone; all joints stay.

        Raises:
            InputError: it is none of them.
        """
        task = TASKS[self.task.name] if self.task.frames else self.task
        return replace(self, frame=word(frame, self.frames, "frame"), task=task)

    @property
    def motors(self) -> np.ndarray:
        """Whether each joint (nv) has a motor."""
        follow = [part.joint for part in self.constraints if isinstance(part, Coupling)]
        idle = {*BASE_JOINTS, *self.passive, *follow}
        return np.array([name not in idle for name in self.joint_names])

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The feet on which it stands."""
        return tuple(part for part in self.constraints if isinstance(part, Contact))

    @property
    def constrained(self) -> Constraints:
        """The rows of all constraints, with scratch of their own."""
        return Constraints(self.model, self.constraints)

    @property
    def joint_names(self) -> list[str]:
        """Names of the chain's joints, from the base."""
        return list(self.model.names[1:])

    @property
    def slides(self) -> dict[str, bool]:
        """Joint name -> whether the joint is prismatic."""
        return dict(zip(self.joint_names, self.sliding.tolist(), strict=True))

    @property
    def sliding(self) -> np.ndarray:
        """Whether each joint (nv) is prismatic."""
        return sliding_joints(self.model)

    @property
    def home_angles(self) -> np.ndarray:
        """The home pose as joint positions (nv) [rad or m]."""
        return angles_from_configuration(self.model, self.q0)

    @cached_property
    def reach(self) -> float:
        """Length [m] of the stretched chain from its first joint to the task frame.

        Of several frames the longest.
        """
        model = self.model
        if len(self.frames) == 1:
            return reach(model, self.frame_id)
        return max(reach(model, end, chain_joints(model, end)) for end in self.frame_ids)

    @property
    def mass(self) -> float:
        """Mass [kg] of all moving bodies."""
        return pin.computeTotalMass(self.model)

    @property
    def frame_task(self) -> FrameTask:
        """The task, if it is one of the frame.

        Raises:
            RobotError: the task is the joint task, or one of several frames.
        """
        self.check_single_frame()
        if not isinstance(self.task, FrameTask):
            raise RobotError(
                f"the task is '{self.task.name}'; this needs a task of the frame.",
                where="task",
                hint='Load the robot with task = "xyz".',
            )
        return self.task

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return the task coordinates x at configuration q (nq), in world axes.

        They are a position (m) [m], for a pose position and quaternion xyzw (7), for the joint task
        joint positions (nv) [rad or m].

        Raises:
            RobotError: not nq finite numbers.
        """
        q = vector(q, self.model.nq, "q", error=RobotError, fills=False)
        return self.task.at(self.model, self.model.createData(), self.frame_id, q)

    def configuration(self, x: np.ndarray) -> np.ndarray:
        """Return the configuration (nq) of coordinates x of a joint task, all others as at home.

        Raises:
            RobotError: the constraints do not hold near it, or the task is another one.
        """
        if not isinstance(self.task, JointTask):
            raise RobotError("only a joint task has x of a configuration.", where="task")
        angles = self.home_angles
        angles[list(self.task.dofs)] = x
        q = configuration_from_angles(self.model, angles)
        return consistent(self.model, q, self.constraints)

    def placement(self, q: np.ndarray) -> pin.SE3:
        """Return the placement of the task frame at configuration q (nq), in world axes.

        Raises:
            RobotError: not nq finite numbers.
        """
        q = vector(q, self.model.nq, "q", error=RobotError, fills=False)
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return data.oMf[self.frame_id].copy()

    def at(self, q0: ArrayLike) -> Robot:
        """Return this robot with another home pose q0, joint positions (nv) [rad or m].

        Positions outside the joint limits cause a warning.

        Raises:
            RobotError: wrong size or non-finite numbers.
        """
        angles = vector(q0, self.model.nv, "q0", names=self.joint_names, error=RobotError)
        off = np.abs(angles - np.clip(angles, *position_limits(self.model))) > ROUNDING
        if off.any():
            outside = ", ".join(np.array(self.joint_names)[off])
            warnings.warn(
                f"q0 or a rest pose is outside the joint limits of {outside}.", stacklevel=2
            )
        return replace(self, q0=configuration_from_angles(self.model, angles))

    def changed(
        self,
        *,
        inertial_scale: float | Mapping[str, float] = 1.0,
        payload: changes.Load = None,
        tool_translation: ArrayLike | Mapping[str, ArrayLike] | None = None,
        link_translation: Mapping[str, ArrayLike] | None = None,
        armature: ArrayLike | None = None,
        viscous: ArrayLike | None = None,
        coulomb: ArrayLike | None = None,
        friction: Friction | None = None,
    ) -> Robot:
        """Return a robot with the stated changes; the models share no data.

        Args:
            inertial_scale: factor on mass and inertia of all bodies, or joint name -> factor.
            payload: load fixed to the last body, relative to the task frame of this robot, before
                ``tool_translation`` is applied; of several task frames by the frame's name.
            tool_translation: (3) [m] added to the origin of the task frame, in the frame's axes; of
                several task frames by the frame's name.
            link_translation: joint name -> (3) [m] added to the joint placement, in parent axes.
            armature: rotor inertia at the joint, number or (nv) [kg m^2 or kg]; None: unchanged.
            viscous: friction, number or (nv) [N m s/rad or N s/m]; None: unchanged.
            coulomb: friction, number or (nv) [N m or N]; None: unchanged.
            friction: all of the joints' friction, before ``viscous`` and ``coulomb`` are set.

        A number of these is of all joints but the six of a free base, which have no motors.

        Raises:
            RobotError: unknown joints, wrong sizes, or factors or masses that are not positive.
        """
        model = self.model.copy()
        loads = self.loads
        changes.scale_inertias(model, inertial_scale)
        for name, added in changes.by_frame(payload, self.frames, "payload").items():
            frame = frame_named(model, name)
            if instance(added, changes.Payload, "payload", RobotError).present:
                load = frame.placement.act(added.spatial_inertia())
                model.inertias[frame.parentJoint] += load
                loads = *loads, (frame.parentJoint, load)
        where = "link_translation"
        for name, given in mapping(link_translation, where, RobotError).items():
            placement = model.jointPlacements[changes.joint_id(model, name, where)]
            placement.translation += vector(
                given, 3, f"{where}.{name}", error=RobotError, fills=False
            )
        where = "tool_translation"
        for name, given in changes.by_frame(tool_translation, self.frames, where).items():
            placement = frame_named(model, name).placement
            shift = vector(given, 3, where, error=RobotError, fills=False)
            placement.translation += placement.rotation @ shift
        if armature is not None:
            rotors = changes.per_joint(armature, self.joint_names, "armature", 0.0, RobotError)
            model.armature = joint_numbers(rotors, "armature", error=RobotError)
        drag = self.friction if friction is None else friction
        drag = instance(drag, Friction, "friction", RobotError)
        drag = replace(
            drag,
            viscous=drag.viscous if viscous is None else viscous,
            coulomb=drag.coulomb if coulomb is None else coulomb,
        )
        return replace(self, model=model, friction=drag.of(model), loads=loads)

    def seen_from(self, rotation: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
        """Return this robot with x in the axes of a tracker that stands somewhere.

        Base and gravity of the model are turned into these axes, so that its torques are the same.

        Args:
            rotation: (3, 3) from the axes of the base to those of the tracker, or (3) the same as a
                rotation vector [rad].
            translation: (3) the base in the axes of the tracker [m].

        Raises:
            RobotError: wrong sizes, or no rotation.
        """
        tracker = changes.placement(rotation, translation, "tracker")
        model = self.model.copy()
        changes.move_base(model, tracker)
        if self.tracker is not None:
            tracker = tracker * self.tracker
        return replace(self, model=model, tracker=tracker, mounting=MountingPlane())

    def filmed_by(self, *cameras: ArrayLike, pixel: float | None = None, count: int = 1) -> Robot:
        """Return this robot with the task "image": the picture of the frame in one or two cameras.

        With one camera two coordinates of the frame's picture are controlled, with two also the
        first one of the second picture, which fixes the frame in space. A controller finds its
        cameras by itself: give them to the true robot alone.

        Args:
            cameras: (3, 4) projections from the world's axes to homogeneous coordinates (y_1, y_2,
                1) of the image, as of ``tasks.pinhole_camera``. None: cameras that look along axes
                from far away, as a controller's robot may have them.
            pixel: length [m] that a pixel counts as, about that which it covers at the arm; y is
                the picture in pixels, as the cameras have it, times this length, and results are
                shown in pixels. None: the cameras themselves count in such lengths.
            count: of the cameras, where none is given.

        Raises:
            RobotError: three cameras, wrong sizes, a frame that is not before a camera at home, two
                cameras that see it from one direction, or a joint task.
        """
        task = self.frame_task
        given = [numbers(H, "cameras", error=RobotError) for H in cameras]
        if not given:
            plane = [*np.arange(3)[task.place], *range(3)][:2]
            unknown = [np.eye(4)[[*plane, 3]], np.eye(4)[[2, 1, 3]]]
            given = unknown[: whole(count, "count", 1, most=2)]
        if len(given) > 2 or any(H.shape != (3, 4) for H in given):
            raise RobotError("expected one or two matrices (3, 4).", where="cameras")
        if pixel is not None:
            pixel = positive(pixel, "pixel", error=RobotError)
            given = [np.diag([pixel, pixel, 1.0]) @ H for H in given] if cameras else given
        at = self.placement(self.q0)
        for number, H in enumerate(given, 1):
            if H[2, :3] @ at.translation + H[2, 3] <= 0.0:
                raise RobotError(
                    f"at home the frame is behind camera {number} of {len(given)}.",
                    where="cameras",
                    hint="The depth, row 3 of H times (p, 1), must be positive.",
                )
        seen = ImageTask.seen_by(task, given, pixel)
        if np.linalg.cond(seen.jacobian(at, np.eye(6)[:, :3])) * ROUNDING > 1.0:
            raise RobotError(
                "at home the second picture adds nothing to the first one.",
                where="cameras",
                hint="Give cameras that see the frame from two directions.",
            )
        return replace(self, task=seen)

    @cached_property
    def in_base_axes(self) -> Robot:
        """This robot with x in the axes of its base."""
        if self.tracker is None:
            return self
        back = self.tracker.inverse()
        return replace(self.seen_from(back.rotation, back.translation), tracker=None)

    def urdf(self, *, shapes: bool = True) -> str:
        """Return this robot as a URDF that Pinocchio and MuJoCo read.

        If the robot was read from a URDF (a file, a xacro file or the catalogue), this is its text
        without comments and with the changed numbers: inertias of links, placements of joints and
        of the task frame, joint damping and friction. Paths of meshes are made absolute. For any
        other source only the chain is written, without shapes.

        What changed of a body is written to its first link; links that are fixed or locked to it
        keep their inertia as long as that of the first link remains physical. A moved task frame is
        written as its own fixed joint if it is a last link without mass, else as a new link,
        ``<frame>_learned``.

        A URDF does not contain gravity or the placement of the base. Rotor inertias and effects of
        the joints beside viscous and Coulomb friction are written as attributes of ``dynamics``
        that only ``load(..., joint_effects=True)`` reads; shafts of two joints are not written.

        Args:
            shapes: whether to write the visual and collision shapes of the description; MuJoCo
                refuses meshes other than STL and OBJ.

        Raises:
            RobotError: a changed body without a physical inertia, or a source file that is missing.
        """
        return urdf_text(self, flag(shapes, "shapes"))

    def mjcf(self) -> str:
        """Return this robot as MJCF, the format of MuJoCo: the chain alone, without shapes.

        It holds inertias, limits, rotor inertias (``armature``), viscous friction (``damping``) and
        Coulomb friction (``frictionloss``). A first comment says which effects of the joints it
        does not hold. Each joint has a motor, the task frame is a site.

        Raises:
            RobotError: a body without a physical inertia.
        """
        return mjcf_text(self)

    def save(self, path: Path | str, *, shapes: bool = True) -> None:
        """Write a file, completely or not at all; its folder is created.

        It has the text of ``mjcf`` if its name ends with ".xml", else that of ``urdf``.

        Raises:
            RobotError: as ``urdf`` or ``mjcf``.
        """
        path = Path(path)
        write_text(path, self.mjcf() if path.suffix == ".xml" else self.urdf(shapes=shapes))

    def undrawn(self) -> Robot:
        """Return this robot without its visual geometry, which controllers do not need."""
        return replace(self, drawn=None)

    def report(self) -> Report:
        """Return tables of the frame, task, mass and reach, and of the joints with their limits."""
        words = [
            ("frame", ", ".join(self.frames) + (", floating base fixed" if self.welded else "")),
            ("task", self.task.name),
            ("moving mass", f"{self.mass:.4g} kg"),
            ("reach", f"{self.reach:.4g} m"),
        ]
        for label, names in (("other ends", self.ends), ("locked joints", self.locked)):
            if names:
                words.append((label, shorten(", ".join(names), 100, placeholder=" ...")))
        model = self.model
        limits = *position_limits(model), velocity_limits(model), effort_limits(model)
        columns = zip(self.slides.items(), self.home_angles, *limits, strict=True)
        rows = [
            (name, *(f"{x:.4g}" if np.isfinite(x) else "-" for x in values), _UNITS[slide])
            for (name, slide), *values in columns
        ]
        return Report(f"{self.name}, {model.nv} joints", [Table(words), Table(rows, _HEADER)])

    def friction_at(self, q: np.ndarray) -> Friction:
        """Return the friction at configuration q (nq), under the gravity torque there."""
        if not self.friction.loaded:
            return self.friction
        return self.friction.under(
            pin.computeGeneralizedGravity(self.model, self.model.createData(), q)
        )


@dataclass(frozen=True, eq=False)
class Visual:
    """The visual geometry of a chain, and its collision geometry, read from files at first use.

    Attributes:
        read: function that returns the visual or collision geometry of the whole robot, or None.
        whole: Pinocchio model of the whole robot.
        keep: indices of the joints of the chain in that model.
        q_reference: (nq) configuration at which the other joints are locked.
        before: number of joints in front of the tree, those of a free base.
    """

    read: Callable[[pin.GeometryType], pin.GeometryModel | None]
    whole: pin.Model
    keep: tuple[int, ...]
    q_reference: np.ndarray
    before: int = 0

    @cached_property
    def geometry(self) -> pin.GeometryModel | None:
        """The visual geometry of the chain, or None."""
        shapes = self.read(pin.GeometryType.VISUAL)
        return None if shapes is None else self._reduced(shapes)

    def solids(self) -> tuple[pin.GeometryModel, list[str]] | None:
        """Return the collision geometry of the chain and the link of each shape, or None."""
        found = self.read(pin.GeometryType.COLLISION)
        if found is None or not found.ngeoms:
            return None
        links = [self.whole.frames[part.parentFrame].name for part in found.geometryObjects]
        return self._reduced(found), links

    def _reduced(self, shapes: pin.GeometryModel) -> pin.GeometryModel:
        """Return the shapes of the chain, given those of the whole robot."""
        found = reduced(self.whole, self.keep, self.q_reference, shapes)[1][0]
        for shape in found.geometryObjects:
            shape.parentJoint += self.before
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the meshes; the copy reads them again on demand."""
        return type(self), (self.read, self.whole, self.keep, self.q_reference, self.before)


# A load is picked up or put down, a tool is exchanged

# that is expected of a robot, as a share of its mass; half or twice: docs/default_law.md
LOAD = 0.1
# [s], tolerance for the rounding error of a time that is a sum of periods: a sum of a million of
# them is off by less than half of it
EARLY = 1e-6


@dataclass(frozen=True, eq=False)
class Succession:
    """A robot whose parameters change at given times.

    Attributes:
        robots: the first from the start, each other one from its time on; all have the same chain.
        times: times of the changes [s], ascending, one less than there are robots.
        known: whether the parameters are the true ones; if not, only joints, frame and limits are.
    """

    robots: tuple[Robot, ...]
    times: tuple[float, ...] = ()
    known: bool = True

    @classmethod
    def of(cls, first: Robot, changes: Mapping[float, Robot] | None = None) -> Succession:
        """Return the succession of a first robot and its changes.

        Args:
            first: the robot from the start on.
            changes: time [s] -> robot from then on, in any order.

        Raises:
            InputError: a time that is not positive and finite.
            RobotError: a robot with another chain, frame or task than the first.
        """
        instance(first, Robot, "robot")
        timed = in_time(changes, "changes")
        for time, robot in timed.items():
            check_successor(first, robot, f"changes[{time:g}]")
        return cls((first, *timed.values()), tuple(timed))

    def index(self, t: ArrayLike) -> np.ndarray:
        """Return the index of the robot at each time t (N) [s]."""
        return np.searchsorted(self.times, numbers(t, "t") + EARLY, side="right")

    @property
    def words(self) -> tuple[tuple[float, str], ...]:
        """Time [s] and short description of each change."""
        return tuple(zip(self.times, map(difference, self.robots, self.robots[1:]), strict=True))


def in_time(changes: Mapping[float, Any] | None, where: str) -> dict[float, Any]:
    """Return events by their time [s], sorted.

    Raises:
        InputError: not a mapping, or a time that is not positive and finite.
    """
    timed = mapping(changes, where).items()
    return dict(sorted((positive(t, where, error=InputError), event) for t, event in timed))


def check_successor(before: Robot, after: Robot, where: str) -> None:
    """Refuse a robot that cannot replace another one during a motion.

    Raises:
        RobotError: not a robot, or one with another chain, frame or task.
    """
    instance(after, Robot, where, RobotError)
    ours, theirs = ((one.slides, one.frames, one.task.name) for one in (before, after))
    if ours != theirs:
        raise RobotError(
            "joints, task frame and task cannot change during a motion; before: "
            f"{ours}, after: {theirs}.",
            where=where,
            hint="Derive both robots from the same load() with .changed().",
        )


def difference(before: Robot, after: Robot) -> str:
    """Return a short text of how two robots with the same chain differ, masses in kg."""
    mass = after.mass - before.mass
    words = [] if abs(mass) < 1e-9 else [f"{mass:+.3g} kg"]
    for name in before.frames:
        old, new = (one.of_frame(name).placement(one.q0) for one in (before, after))
        if not old.isApprox(new, 1e-9):
            words.append("tool")
            break
    return ", ".join(words) or "other parameters"
