"""Loading a robot: from any description to one chain with a task and a home pose."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import LARGEST, arithmetic, flag, instance, name_list, vector
from ..description.chain import (
    ENDS,
    chain_joints,
    check_joints,
    check_mass_matrix,
    check_position_limits,
    configuration_from_angles,
    frame_id,
    is_free_flyer,
    reduce_to_chain,
)
from ..description.description import Description, Source, describe
from ..description.missing_inertia import with_solid_points
from ..description.urdf import Origin
from ..description.xacro import XacroArguments
from ..exceptions import RobotError, did_you_mean
from ..tasks.frame import IMAGE, TASKS, FrameTask
from ..tasks.task import JointTask, Task
from . import changes
from .changes import FRICTION_ATTRIBUTES, Friction
from .home import MountingPlane, conditioning, find_home, home_inside_limits
from .robot import Robot, Visual

JOINT = "joint"  # the name of the task of the joints
_MOST_TRIED = 8  # ends of chains that are tried as the task frame
_SUGGESTED = 4  # of them, named where a frame does not exist
_LARGEST, PLANES = "xyz", ("xy", "xz", "yz")
# Words in names of frames: tools and feet, fingers, sensors.
_TOOLS = (
    *("tcp", "tool", "tip", "ee", "end", "flange", "foot", "sole", "toe"),
    *("contact", "grasp", "pinch", "attach"),
)
_FINGER = re.compile(r"finger|thumb|(^|[^a-z])jaw")
_SENSOR = re.compile(r"camera|optical|lidar|laser|sensor|acceler|(^|[^a-z])(imu|lens|range|gyro)")


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
    pixel: float | None = None,
) -> Robot:
    """Load a robot as the open chain from its base to one frame.

    Arguments that are not given are chosen by the same rules for every source. ``print(robot)``
    shows the choice, and the other frames at which a chain could end.

    Args:
        source: path of a URDF, xacro or MJCF file, name in the catalogue or in the package
            robot_descriptions, ``pin.Model`` or ``RobotWrapper``; it is not changed.
        frame: task frame; default: that of the catalogue, else the end of a chain that looks most
            like a tool, see ``end_links``.
        task: "xy", "xz", "yz", "xyz" or "pose" of the frame, or "joint" for the joint positions;
            default: that of the catalogue, else "xyz", or the best conditioned plane if the chain
            cannot move its frame in all of xyz.
        locked: joints of the chain to lock at the reference configuration of the description.
            Joints off the chain are always locked.
        q0: home pose, one value per joint of the chain (nv) [rad or m]; default: that of the
            catalogue, else the reference configuration of the description if it is well
            conditioned, else a searched pose, see ``find_home``. For a joint task: the reference
            configuration if it is inside the joint limits, else their middle.
        gravity: (3) [m/s^2] in world axes; default: that of the model.
        weld_root: True fixes a floating base at the reference configuration, False refuses it;
            default: True for files, False for objects. In the catalogue, bases are always fixed.
        xacro: arguments of a xacro file, name -> text, number or bool.
        mass: mass of the whole robot, its base included [kg]; bodies that are described without
            mass share what the other bodies leave, see ``missing_inertia``. Where a joint would
            move without inertia, point masses become balls of aluminium, with a warning.
        joint_effects: take damping, friction and rotor inertia of the joints from the description.
            By default friction is zero, as most descriptions contain placeholder values.
        pixel: of the task "image", the picture of the frame in a camera: about the length [m] that
            a pixel covers at the arm; a factor of five does not matter. See ``Robot.filmed_by``.

    Raises:
        RobotError: missing file, bad XML, unknown frame or joint, floating base, mimic or
            unsupported joints, a lower joint limit above the upper one, a singular mass matrix, too
            few joints for the task or more than 100, wrong sizes or NaN.
    """
    for given, where in ((frame, "frame"), (task, "task")):
        instance(given, str | None, where, RobotError)
    if (task == IMAGE) != (pixel is not None):
        raise RobotError(
            'the task "image", and no other one, needs the length [m] that a pixel covers.',
            where="pixel",
            hint="Give pixel=0.002 for 2 mm, or say which cameras there are: Robot.filmed_by.",
        )
    if pixel is not None:
        task = None
    locked = name_list(locked, "locked", RobotError)
    found = describe(source, xacro=xacro, mass=mass)
    still = _with_one_position(found.model)
    found = _locked_at(found, still)
    weld = found.from_file if weld_root is None else flag(weld_root, "weld_root")
    wanted = _Wanted(
        task or found.task, [*found.locked, *locked], q0, gravity, weld or found.weld_root
    )
    ends, known = end_links(found.model, found.mimics), frame or found.frame
    if known:
        _check_frame(found.model, known, ends)
    frames = [known] if known else choose_frames(found.model, ends, task)
    robot = _first_able(frames, lambda name: _load_chain(found, name, ends, wanted))
    chain = chain_joints(found.model, frame_id(found.model, robot.frame))
    if names := [str(found.model.names[index]) for index in chain if index in still]:
        warnings.warn(
            f"{robot.name}: lower and upper limit are equal for {', '.join(names)}: locked there.",
            stacklevel=2,
        )
    if flag(joint_effects, "joint_effects"):
        robot = _with_joint_effects(robot)
    return robot if pixel is None else robot.filmed_by(pixel=pixel)


def _with_one_position(model: pin.Model) -> dict[int, float]:
    """Return joint -> position [rad or m] of those whose limits are equal, and not zero."""
    found = {}
    for index, joint in enumerate(model.joints):
        if index and joint.nq == 1:  # the first is the universe
            low = float(model.lowerPositionLimit[joint.idx_q])
            high = float(model.upperPositionLimit[joint.idx_q])
            if low == high and low != 0.0 and abs(low) < LARGEST:
                found[index] = low
    return found


def _locked_at(found: Description, positions: Mapping[int, float]) -> Description:
    """Return a description with more joints locked, at positions [rad or m]."""
    q = found.q_reference.copy()
    for index, position in positions.items():
        q[found.model.joints[index].idx_q] = position
    names = [str(found.model.names[index]) for index in positions]
    return replace(found, q_reference=q, locked=(*found.locked, *names))


@dataclass(frozen=True)
class _Wanted:
    """The arguments of ``load`` that apply to any frame."""

    task: str | None
    locked: Sequence[str]
    q0: ArrayLike | None
    gravity: ArrayLike | None
    weld_root: bool


def _load_chain(found: Description, name: str, ends: Sequence[str], wanted: _Wanted) -> Robot:
    """Return the robot whose chain ends at a frame."""
    keep = _kept_joints(found, name, wanted.locked, wanted.weld_root)
    model = reduce_to_chain(found.model, keep, found.q_reference)
    check_position_limits(model)
    if wanted.gravity is not None:
        model.gravity.linear = vector(wanted.gravity, 3, "gravity", error=RobotError, fills=False)
    poses, welded = _reference_poses(found, model, keep), _floats(found.model, name)
    tip, mounted = frame_id(model, name), not (welded or found.weld_root)
    plane = MountingPlane.of(model, tip, poses[0]) if mounted else None
    chosen, home = choose_task(model, tip, wanted.task, poses, plane)
    robot = Robot(
        found.name,
        model,
        name,
        chosen,
        home,
        Friction.none(model.nv),
        Visual(found.visual, found.model, tuple(keep), found.q_reference, found.collision),
        ends=tuple(end for end in ends if end != name),
        locked=_off_chain(found.model, keep),
        welded=welded,
        mounting=plane,
        origin=None if found.urdf is None else Origin(found.urdf, model.copy()),
    )
    if wanted.q0 is not None:
        robot = robot.at(wanted.q0)
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (3, model.nv))
    at = [robot.q0, *(configuration_from_angles(model, sample) for sample in samples)]
    try:
        check_mass_matrix(model, at)
    except RobotError:
        solid = with_solid_points(model, found.name)
        if solid is None:
            raise
        check_mass_matrix(solid, at)
        origin = None if found.urdf is None else Origin(found.urdf, solid.copy())
        robot = replace(robot, model=solid, origin=origin)
    return robot


def _check_frame(model: pin.Model, name: str, ends: Sequence[str]) -> None:
    """Check that a frame exists.

    Raises:
        RobotError: it does not; the message suggests the closest name and the likely ends.
    """
    try:
        frame_id(model, name)
    except RobotError as error:
        likely = f"Likely ends of the chain: {', '.join(ends[:_SUGGESTED])}." if ends else None
        raise RobotError(error.what, where=error.where, hint=likely) from None


def _kept_joints(
    found: Description, frame: str, locked: Sequence[str], weld_root: bool
) -> list[int]:
    """Return the joints from base to frame that are not locked; unsupported ones are refused."""
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
            f"joints {mimics} mimic other joints; the control laws need independent joints.",
            where=found.name,
            hint="Lock them with `locked`, or choose a frame before them.",
        )
    if not keep:
        raise RobotError(
            f"no joint moves frame '{frame}' relative to the base.",
            where=found.name,
            hint="Choose a frame further from the base, or lock fewer joints.",
        )
    return keep


def _floats(model: pin.Model, frame: str) -> bool:
    """Return whether a free-flyer lies between the base and a frame."""
    joints = chain_joints(model, frame_id(model, frame))
    return any(is_free_flyer(model.joints[joint]) for joint in joints)


def _off_chain(model: pin.Model, keep: Sequence[int]) -> tuple[str, ...]:
    """Return the names of the joints that are not kept, without free-flyers."""
    kept = set(keep)
    return tuple(
        str(model.names[joint])
        for joint in range(1, model.njoints)
        if joint not in kept and not is_free_flyer(model.joints[joint])
    )


def _reference_poses(found: Description, model: pin.Model, keep: Sequence[int]) -> list[Any]:
    """Return the reference and the neutral pose (nq) of the chain."""
    parts = [
        found.q_reference[j.idx_q : j.idx_q + j.nq] for j in (found.model.joints[k] for k in keep)
    ]
    return [np.concatenate(parts), pin.neutral(model)]


def _with_joint_effects(robot: Robot) -> Robot:
    """Return a robot with the rotor inertias and the friction of its description."""
    model = robot.model
    stated = {} if robot.origin is None else robot.origin.urdf.armatures()
    armature = [
        stated.get(name, float(rotor))
        for name, rotor in zip(robot.joint_names, model.armature, strict=True)
    ]
    friction = Friction(np.array(model.damping), np.array(model.friction))
    own: dict[str, Any] = {}
    for name in FRICTION_ATTRIBUTES:
        found = {} if robot.origin is None else robot.origin.urdf.joint_effects(name)
        usual = zip(robot.joint_names, getattr(friction, name), strict=True)
        own[name] = np.array([found.get(joint, default) for joint, default in usual])
    return robot.changed(armature=armature, friction=replace(friction, **own))


# The choice of a frame


def choose_frames(model: pin.Model, ends: Sequence[str], task: str | None) -> list[str]:
    """Return the task frames to try, best candidate first: the ends of chains, see ``end_links``.

    For a joint task this is the last frame of the model if no chain has two joints.

    Raises:
        RobotError: a task of the frame, and no chain has two joints.
    """
    if ends:
        return list(ends[:_MOST_TRIED])
    if task == JOINT:
        return [str(model.frames[-1].name)]
    raise RobotError(
        "no link is moved by two independent joints or more.",
        where=str(model.name),
        hint='Name a frame, or choose task="joint".',
    )


def _first_able(frames: Sequence[str], make: Callable[[str], Robot]) -> Robot:
    """Return the robot of the first frame whose chain is able to do the task.

    Raises:
        RobotError: no chain is able, then the error of the first frame; or any other error.
    """
    refused: list[RobotError] = []
    for frame in frames:
        try:
            return make(frame)
        except RobotError as error:
            if error.where != "task":
                raise
            refused.append(error)
    raise refused[0]


def end_links(model: pin.Model, mimics: Collection[str] = ()) -> list[str]:
    """Return the ends of chains of two or more joints, the best candidate for a task frame first.

    An end is an outermost link or operational frame, or a palm: a link that carries several joints,
    with shorter chains behind it than before it. The order is: names of a tool or a foot, palms,
    other names, fingers, sensors. Among equals, the frame with more joints before it comes first;
    among fingers, the one with fewer. Frames behind mimic joints or joints with several degrees of
    freedom are left out. A floating base counts as fixed.
    """
    parents = {frame.parentFrame for frame in model.frames}
    carried = Counter(f.parentFrame for f in model.frames if f.type == pin.FrameType.JOINT)
    before = cache(partial(_independent_joints, model, frozenset(mimics)))
    depth = cache(partial(_joints_behind, model))
    found = []
    for index, frame in enumerate(model.frames):
        if frame.type not in ENDS:
            continue
        joint = int(frame.parentJoint)
        palm = carried[index] >= 2 and depth(joint) < len(model.supports[joint]) - 1
        if (palm or index not in parents) and before(joint) >= 2:
            found.append((*_rank(str(frame.name), palm, before(joint)), index))
    return [str(model.frames[index].name) for *_, index in sorted(found)]


def _rank(name: str, palm: bool, joints: int) -> tuple[int, bool, int]:
    """Return the sort key of an end with this number of joints before it; the best is least."""
    name = name.lower()
    tool = any(word.startswith(_TOOLS) for word in re.split(r"[^a-z0-9]+", name))
    if _SENSOR.search(name):
        return 3, not tool, -joints
    if _FINGER.search(name) and not palm:
        return 2, not tool, joints
    return 0 if tool else 1, not palm, -joints


def _joints_behind(model: pin.Model, joint: int) -> int:
    """Return the length of the longest chain of joints behind a joint."""
    before = len(model.supports[joint])
    return max((len(model.supports[j]) for j in model.subtrees[joint]), default=before) - before


def _independent_joints(model: pin.Model, mimics: Collection[str], joint: int) -> int:
    """Return how many joints move the body of a joint, 0 if one of them is not supported."""
    joints = [j for j in model.supports[joint] if j > 0 and not is_free_flyer(model.joints[j])]
    try:
        check_joints(model, joints)
    except RobotError:
        return 0
    return 0 if any(str(model.names[joint]) in mimics for joint in joints) else len(joints)


# The choice of a task


def choose_task(
    model: pin.Model,
    frame: int,
    task: str | None,
    poses: Sequence[np.ndarray],
    plane: MountingPlane | None,
) -> tuple[Task, np.ndarray]:
    """Return the task and a home pose (nq) for it.

    By default the task is "xyz", or the best conditioned plane if the chain cannot do "xyz".

    Args:
        model: of the chain.
        frame: index of the task frame.
        task: name of the task, or None.
        poses: (nq) poses of the description, preferred as home.
        plane: the mounting plane, from which the home pose keeps a distance, or None.

    Raises:
        RobotError: unknown task, too few joints, or a task Jacobian that is always singular.
    """
    if task is not None:
        return _with_home(model, frame, task, poses, plane)
    found, refused = [], None
    for name in (_LARGEST, *PLANES):
        try:
            found.append(_with_home(model, frame, name, poses, plane))
        except RobotError as error:
            refused = error
        if name == _LARGEST and found:
            return found[0]
    if not found:
        assert refused is not None  # as nothing was found
        raise refused
    return max(found, key=lambda both: _conditioning(model, frame, *both))


def _with_home(
    model: pin.Model,
    frame: int,
    name: str,
    poses: Sequence[np.ndarray],
    plane: MountingPlane | None,
) -> tuple[Task, np.ndarray]:
    task = task_named(name, model)
    if model.nv < task.size:
        raise RobotError(
            f"task '{name}' has {task.size} coordinates, but the chain to "
            f"'{model.frames[frame].name}' has only {model.nv} joints.",
            where="task",
            hint="Choose a frame further from the base, or a task with fewer coordinates.",
        )
    if isinstance(task, FrameTask):
        return task, find_home(model, frame, task.rows, poses, plane)
    return task, home_inside_limits(model, poses)


def _conditioning(model: pin.Model, frame: int, task: Task, home: np.ndarray) -> float:
    assert isinstance(task, FrameTask)  # a plane
    return conditioning(model, model.createData(), frame, task.rows, home)[1]


def task_named(name: str, model: pin.Model) -> Task:
    """Return a task of a chain by its name: one of ``TASKS``, or "joint".

    Raises:
        RobotError: unknown name; the message suggests the nearest.
    """
    if name == JOINT:
        return JointTask.of_chain(model)
    if name not in TASKS:
        names = [*TASKS, JOINT]
        raise RobotError(
            f"no task is called '{name}'; choose from {names}.{did_you_mean(name, names)}",
            where="task",
            hint="Load the robot, then say which cameras it has: Robot.filmed_by."
            if name == IMAGE
            else None,
        )
    return TASKS[name]
