"""Loading a robot: from any description to one chain with a task and a home pose."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import arithmetic, flag, instance, name_list, vector, word
from ..description.chain import (
    ENDS,
    chain_joints,
    check_joints,
    check_mass_matrix,
    check_position_limits,
    configuration_from_angles,
    frame_id,
    is_free_flyer,
    is_independent,
    reduced,
)
from ..description.description import Description, Source, describe
from ..description.floating_base import BASE_JOINTS, with_base_joints
from ..description.missing_inertia import with_solid_points
from ..description.urdf import Origin
from ..description.xacro import XacroArguments
from ..exceptions import RobotError
from ..tasks.frame import COM, IMAGE, TASKS, ComTask, FrameTask
from ..tasks.task import JointTask, Task
from . import changes
from .changes import FRICTION_ATTRIBUTES, Friction
from .constraints import (
    DEPENDENT,
    Constraint,
    Contact,
    Coupling,
    Loop,
    consistent,
    independent,
    parts_of,
)
from .home import MountingPlane, find_home, home_inside_limits, singular_values
from .robot import Robot, Visual

FIXED, FREE = "fixed", "free"
JOINT = "joint"  # the name of the task of the joints
PLANES = ("xy", "xz", "yz")
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
    frames: str | Sequence[str] = (),
    task: str | None = None,
    locked: str | Sequence[str] = (),
    q0: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    xacro: XacroArguments | None = None,
    mass: float | None = None,
    joint_effects: bool = False,
    pixel: float | None = None,
    base: str = FIXED,
    contacts: Iterable[Contact | Mapping[str, Any] | str] = (),
    loops: Iterable[Loop | Mapping[str, Any]] = (),
    passive: str | Sequence[str] = (),
) -> Robot:
    """Load a robot: the chain from its base to one frame, or the whole tree of its joints.

    It is the whole tree for the task "joint" without a frame, and for a free base. With several
    frames it is the tree of the chains to them, see ``tasks.FrameTask``.

    Arguments that are not given are chosen by the same rules for every source. ``print(robot)``
    shows the choice, and the other frames at which a chain could end.

    Args:
        source: path of a URDF, xacro or MJCF file, name in the catalogue or in the package
            robot_descriptions, ``pin.Model`` or ``RobotWrapper``; it is not changed.
        frame: task frame; default: that of the catalogue, else the end of a chain that looks most
            like a tool, see ``end_links``.
        frames: task frames that one controller moves, in place of ``frame``, in their order of
            priority: where not all can be followed, the first ones are.
        task: "xy", "xz", "yz", "xyz" or "pose" of the frame, "joint" for the joint positions, or
            "com" for the centre of mass of a free base and the frame's orientation; default: that
            of the catalogue, else "xyz", or the best conditioned plane if the chain cannot move
            its frame in all of xyz.
        locked: joints of the chain to lock at the reference configuration of the description.
            Joints off the chain are always locked.
        q0: home pose, one value per joint of the chain (nv) [rad or m]; default: that of the
            catalogue, else the reference configuration of the description if it is well
            conditioned, else a searched pose, see ``find_home``. For a joint task: the reference
            configuration if it is inside the joint limits, else their middle.
        gravity: (3) [m/s^2] in world axes; default: that of the model.
        xacro: arguments of a xacro file, name -> text, number or bool.
        mass: mass of the whole robot, its base included [kg]; bodies that are described without
            mass share what the other bodies leave, see ``missing_inertia``. Where a joint would
            move without inertia, point masses become balls of aluminium, with a warning.
        joint_effects: take damping, friction and rotor inertia of the joints from the description.
            By default friction is zero, as most descriptions contain placeholder values.
        pixel: of the task "image", the picture of the frame in a camera: about the length [m] that
            a pixel covers at the arm; a factor of five does not matter. See ``Robot.filmed_by``.
        base: "fixed", at the reference configuration if the description has a floating one, or
            "free" for a robot that stands: q begins with the base's position, yaw,
            pitch and roll, which no motor moves. The task is then the pose of the root link, unless
            a frame is given.
        contacts: frames of point feet, or ``Contact``, on which a robot with a free base stands.
        loops: frames that move alike, see ``Loop``; the whole tree is loaded then. Those of an MJCF
            file, <connect> and <weld>, come on top wherever the whole tree is loaded, and also if
            joints without an actuator move the frame; other chains open them, with a warning.
        passive: joints of a tree without a motor, which a loop moves; on top of those for which an
            MJCF file has no actuator, if it has any.

    Raises:
        RobotError: missing file, bad XML, unknown frame or joint, mimic or
            unsupported joints, a lower joint limit above the upper one, a singular mass matrix, too
            few joints for the task or more than 100, wrong sizes or NaN; loops that do not close
            near the home pose, or constraints under which motors, or the rows of the task, cannot
            move independently there.
    """
    instance(frame, str | None, "frame", RobotError)
    if task is not None:
        word(task, (*TASKS, IMAGE, JOINT), "task")
    named = name_list(frames, "frames", RobotError)
    if frame is not None and named:
        raise RobotError("give one frame, or several, not both.", where="frames")
    feet = parts_of(Contact, contacts, "contacts")
    closed = parts_of(Loop, loops, "loops")
    every: dict[str, list[Any]] = {
        "frames": named,
        "contacts": [foot.frame for foot in feet],
        "loops": [(part.frame_a, part.frame_b, *part.rows) for part in closed],
    }
    for where, names in every.items():
        if len(set(names)) != len(names):
            raise RobotError(f"one is given twice in {names}.", where=where)
    if frame is not None:
        named = [frame]
    if (task == IMAGE) != (pixel is not None):
        raise RobotError(
            'the task "image", and no other one, needs the length [m] that a pixel covers.',
            where="pixel",
            hint="Give pixel=0.002 for 2 mm, or say which cameras there are: Robot.filmed_by.",
        )
    found = describe(source, xacro, mass)
    free = word(base, (FIXED, FREE), "base") == FREE
    known = named or name_list(found.frame or (), "frame")
    idle = tuple(name_list(passive, "passive", RobotError))
    if len(named) > 1 and task in (JOINT, COM):
        raise RobotError(
            "several frames are controlled by their positions or poses, not by the joints or the "
            "centre of mass.",
            where="frames",
        )
    if not free and (feet or task == COM):
        raise RobotError(
            "contacts, and the task of the centre of mass, are for a free base.",
            where="base",
            hint='base="free".',
        )
    model = found.model
    ends = end_links(model, found.mimics)
    first = (known or ends)[:1] if found.closures else []
    moving = [joint for name in first for joint in chain_joints(model, frame_id(model, name))]
    hangs = any(model.names[joint] in found.passive for joint in moving)  # in loops
    if hangs:
        named = named or first
    whole = free or closed or hangs or (not known and task == JOINT)
    if idle and not whole:
        raise RobotError(
            "every joint of a chain has a motor.", where="passive", hint='Choose task="joint".'
        )
    if whole:
        for name in idle:
            word(name, list(model.names)[1:], "passive")
        closed += tuple(Loop(a, b, tuple(range(rows))) for a, b, rows in found.closures)
        idle += found.passive
    elif found.closures:
        warnings.warn(
            f"{found.name}: {len(found.closures)} kinematic loops closed by <equality> are opened; "
            'task="joint", or a frame that they move, keeps them.',
            stacklevel=3,
        )
    found = replace(
        found,
        task=found.task if task in (None, IMAGE) else task,
        locked=(*found.locked, *name_list(locked, "locked", RobotError)),
        passive=idle,
    )
    refused = None
    for choice in [named] if whole else [known] if known else [[end] for end in ends]:
        try:
            robot = _load_chain(found, choice, ends, q0, free, closed + feet)
            break
        except RobotError as error:  # of the first choice, where no chain is able to do the task
            if error.where != "task":
                raise
            refused = refused or error
    else:
        raise refused or RobotError(
            "no outermost link is moved by two joints or more that are all independent.",
            where=found.name,
            hint='Name a frame, or choose task="joint".',
        )
    if gravity is not None:
        robot.model.gravity.linear = vector(gravity, 3, "gravity", error=RobotError, fills=False)
    if flag(joint_effects, "joint_effects"):
        robot = _with_joint_effects(robot)
    return robot if pixel is None else robot.filmed_by(pixel=pixel)


def _load_chain(
    found: Description,
    frames: list[str],
    ends: Sequence[str],
    q0: ArrayLike | None,
    free: bool,
    constraints: tuple[Constraint, ...],
) -> Robot:
    """Return the robot of the chains to some frames, or of the whole tree; see ``load``.

    Args:
        found: the description, with the chosen task, or None for the default, and all joints that
            are locked or have no motor.
        frames: none for the whole tree.
        ends: other frames at which a chain could end.
        q0: home pose, or None.
        free: whether the base is; the whole tree is kept then, with a frame too. If not, a
            floating base is fixed.
        constraints: loops and contacts, with which the whole tree is kept.
    """
    described = found.model
    whole = free or constraints or not frames
    joints = set(range(1, described.njoints))
    floating = {joint for joint in joints if is_free_flyer(described.joints[joint])}
    locks = {changes.joint_id(described, name, "locked") for name in found.locked}
    chain = joints
    if not whole:
        tips = [frame_id(described, name) for name in frames]
        chain = {joint for tip in tips for joint in chain_joints(described, tip)}
    keep = sorted(chain - floating - locks)
    check_joints(described, keep, () if whole else found.mimics)
    if not keep:
        what = f"frame '{frames[0]}'" if frames else "anything"
        raise RobotError(
            f"no joint moves {what} relative to the base.",
            where=found.name,
            hint="Choose a frame further from the base, or lock fewer joints.",
        )
    reference = found.q_reference.copy()
    for joint in floating if free else ():
        at = described.joints[joint].idx_q
        reference[at : at + 7] = [0.0] * 6 + [1.0]  # the base's joints say where it is
    model = reduced(described, keep, reference)[0]
    if not frames:
        links = (each.name for each in model.frames if each.type == pin.FrameType.BODY)
        frames = [next(links) if free else (*ends, model.frames[-1].name)[0]]
    model = with_base_joints(model) if free else model
    tips = [frame_id(model, name) for name in frames]
    check_position_limits(model)
    parts = [described.joints[joint] for joint in keep]
    shown = np.concatenate([reference[j.idx_q : j.idx_q + j.nq] for j in parts])
    plane = MountingPlane()
    if not (floating or found.frame or whole or len(frames) > 1):
        plane = MountingPlane.of(model, tips[0], shown)
    couplings = []
    for name, leader in found.mimics.items():
        if model.existJointName(name):
            if not model.existJointName(leader[0]):
                raise RobotError(f"'{name}' follows '{leader[0]}'; lock both.", where="locked")
            couplings.append(Coupling(name, *leader))
    constraints = *couplings, *constraints
    if free:
        chosen = _task_named(found.task or "pose", model)
        home = home_inside_limits(model, [np.concatenate([np.zeros(6), shown])])
    else:
        chosen, home = choose_task(model, tips, found.task, [shown, pin.neutral(model)], plane)
    if isinstance(chosen, ComTask):
        chosen = replace(chosen, model=model.copy(), frame=tips[0])
    if len(frames) > 1 and isinstance(chosen, FrameTask):
        chosen = chosen.of_frames(dict(zip(frames, tips, strict=True)))
    if q0 is not None and constraints:  # near which they hold
        angles = vector(q0, model.nv, "q0", names=list(model.names)[1:], error=RobotError)
        home = configuration_from_angles(model, angles)
    home = consistent(model, home, constraints)
    constraints = independent(model, home, constraints)
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (3, model.nv))
    at = [home, *(configuration_from_angles(model, sample) for sample in samples)]
    try:
        check_mass_matrix(model, at)
    except RobotError:
        model = with_solid_points(model, found.name)
        check_mass_matrix(model, at)
    robot = Robot(
        found.name,
        model,
        frames[0],
        chosen,
        home,
        Friction().of(model),
        Visual(found.geometry, described, tuple(keep), reference, len(BASE_JOINTS) * free),
        ends=tuple(end for end in ends if end not in frames),
        locked=tuple(described.names[j] for j in sorted(joints - floating - {*keep})),
        welded=bool(floating) and not free,
        mounting=plane,
        origin=None if found.urdf is None else Origin(found.urdf, model.copy()),
        constraints=constraints,
        passive=found.passive,
    )
    J = np.zeros((0, model.nv))
    if isinstance(chosen, JointTask):
        J = np.eye(model.nv)[robot.motors]
        robot = replace(robot, task=JointTask.of_joints(model, robot.motors))
    elif isinstance(chosen, FrameTask) and (chosen.frames or chosen.name == COM):
        J = chosen.linear_map(model, model.createData(), tips[0], home)[1]
    A = robot.constrained.jacobian(home)
    both = np.vstack([J, A])
    if len(J) and np.linalg.matrix_rank(both, DEPENDENT * np.linalg.norm(both)) < len(both):
        raise RobotError(
            f"{len(J)} {'motors' if chosen.name == JOINT else 'rows of the task'} cannot move "
            f"independently: constraints leave {model.nv - len(A)} motions at home.",
            where="task",
            hint="Name joints without a motor, passive=[...], fewer frames, or another q0.",
        )
    return robot if q0 is None or constraints else robot.at(q0)


def _with_joint_effects(robot: Robot) -> Robot:
    """Return a robot with the rotor inertias and the friction of its description."""
    model = robot.model
    names = robot.joint_names
    stated = dict[str, Any]()
    if robot.origin is not None:
        for attribute in ("armature", *FRICTION_ATTRIBUTES):
            stated[attribute] = robot.origin.urdf.joint_effect(attribute, names)
    rotors = stated.pop("armature", {})
    armature = [rotors.get(n, x) for n, x in zip(names, model.armature, strict=True)]
    friction = Friction(np.array(model.damping), np.array(model.friction), **stated)
    return robot.changed(armature=armature, friction=friction)


# The choice of a frame


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
    found = []
    for index, frame in enumerate(model.frames):
        if frame.type in ENDS:
            joint = frame.parentJoint
            name = frame.name
            chain = chain_joints(model, index)
            depth = len(model.supports[joint])
            moves = all(is_independent(model, each, mimics) for each in chain)
            deepest = (len(model.supports[other]) for other in model.subtrees[joint])
            behind = max(deepest, default=0) - depth  # the universe has no subtree
            palm = carried[index] >= 2 and behind < depth - 1
            if moves and len(chain) >= 2 and (palm or index not in parents):
                found.append((*_rank(name.lower(), palm, len(chain)), index, name))
    return [name for *_, name in sorted(found)]


def limbs(robot: Robot) -> list[str]:
    """Return an end of each arm and leg of the description, best candidate first.

    More than half of the joints before an end, two at least, belong to no limb before it, and as
    many as a third of the longest limb has: fingers, heads and casters are none.
    """
    assert robot.drawn is not None
    model = robot.drawn.whole
    found = {}
    taken = set[int]()
    for name in (robot.frame, *robot.ends):
        own = set(chain_joints(model, frame_id(model, name)))
        new = own - taken
        if len(new) >= max(2, len(own) // 2 + 1) and not _SENSOR.search(name.lower()):
            found[name] = len(new)
            taken |= own
    return [name for name, size in found.items() if 3 * size >= max(found.values())]


def _rank(name: str, palm: bool, joints: int) -> tuple[int, bool, int]:
    """Return the sort key of an end with this number of joints before it; the best is least."""
    tool = any(word.startswith(_TOOLS) for word in re.split(r"[^a-z0-9]+", name))
    if _SENSOR.search(name):
        return 3, not tool, -joints
    if _FINGER.search(name) and not palm:
        return 2, not tool, joints
    return 0 if tool else 1, not palm, -joints


# The choice of a task


def choose_task(
    model: pin.Model,
    frames: Sequence[int],
    task: str | None,
    poses: Sequence[np.ndarray],
    plane: MountingPlane,
) -> tuple[Task, np.ndarray]:
    """Return the task and a home pose (nq) for it.

    By default the task is "xyz", or the best conditioned plane if a chain cannot do "xyz".

    Args:
        model: of the chain.
        frames: indices of the task frames, all of which have this task.
        task: name of the task, or None.
        poses: (nq) poses of the description, preferred as home.
        plane: the mounting plane, from which the home pose keeps a distance.

    Raises:
        RobotError: too few joints, or a task Jacobian that is always singular.
    """
    planes = PLANES if task is None and len(frames) == 1 else ()
    found = []
    for name in (task or "xyz", *planes):
        chosen = _task_named(name, model)
        coordinates = len(frames) * chosen.size
        try:
            if model.nv < coordinates:
                names = "', '".join(model.frames[frame].name for frame in frames)
                raise RobotError(
                    f"task '{name}' has {coordinates} coordinates, but the chain to '{names}' has "
                    f"only {model.nv} joints.",
                    where="task",
                    hint="Choose a frame further from the base, or a task with fewer coordinates.",
                )
            if not isinstance(chosen, FrameTask):
                return chosen, home_inside_limits(model, poses)
            home = find_home(model, frames, chosen.rows, poses, plane)
        except RobotError as error:
            refused = error
            continue
        if name not in planes:
            return chosen, home
        ((largest, *_, smallest),) = singular_values(model, frames, chosen.rows, [home])
        found.append((smallest / largest, chosen, home))
    if not found:
        raise refused
    return max(found, key=lambda each: each[0])[1:]


def _task_named(name: str, model: pin.Model) -> Task:
    """Return a task of a chain by its name: one of ``TASKS``, or "joint"."""
    return JointTask.of_joints(model) if name == JOINT else TASKS[name]
