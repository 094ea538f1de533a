"""Where a chain may end: the links at the tips of a robot's tree."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from functools import cache, partial

import pinocchio as pin

from ..exceptions import RobotError
from .chain import check_joints, is_free_flyer

_ENDS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
_TOOLS = (
    "tcp",
    "tool",
    "tip",
    "ee",
    "end",
    "flange",
    "foot",
    "sole",
    "toe",
    "contact",
    "grasp",
    "pinch",
    "attach",
)  # of names that say "work here"
_FINGER = re.compile(r"finger|thumb|(^|[^a-z])jaw")
_SENSOR = re.compile(
    r"camera|optical|lidar|laser|sensor|acceler|(^|[^a-z])(imu|lens|range|gyro)"
)  # in names of what lies further out, but is not what works


def end_links(model: pin.Model, mimics: Collection[str] = ()) -> list[str]:
    """Return the ends of chains that two or more joints can move, the likeliest task frame first.

    An end is an outermost link or operational frame, or a palm: a link that carries several joints,
    with fewer behind it than before it. Those named like a tool or a foot come first, fingers and
    then sensors last, palms before the others; those with more joints before them lead, but of
    fingers the one that moves least. What lies behind mimic joints or joints of several degrees of
    freedom is left out; a floating base counts as welded.
    """
    parents = {frame.parentFrame for frame in model.frames}
    carried = Counter(f.parentFrame for f in model.frames if f.type == pin.FrameType.JOINT)
    before = cache(partial(_independent_joints, model, frozenset(mimics)))
    depth = cache(partial(_joints_behind, model))
    found = []
    for index, frame in enumerate(model.frames):
        if frame.type not in _ENDS:
            continue
        joint = int(frame.parentJoint)
        palm = carried[index] >= 2 and depth(joint) < len(model.supports[joint]) - 1
        if (palm or index not in parents) and before(joint) >= 2:
            found.append((*_rank(str(frame.name), palm, before(joint)), index))
    return [str(model.frames[index].name) for *_, index in sorted(found)]


def _rank(name: str, palm: bool, joints: int) -> tuple[int, bool, int]:
    """Return what sorts an end with this number of joints before it; the likeliest is least."""
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
    """Return how many joints move what a joint carries, 0 where one of them is not supported."""
    joints = [j for j in model.supports[joint] if j > 0 and not is_free_flyer(model.joints[j])]
    try:
        check_joints(model, joints)
    except RobotError:
        return 0
    return 0 if any(str(model.names[joint]) in mimics for joint in joints) else len(joints)
