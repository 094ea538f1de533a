"""Where a chain may end: the links at the tips of a robot's tree."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection

import pinocchio as pin

from ..exceptions import RobotError
from .chain import chain_joints, check_joints, is_free_flyer

_WORDS = (
    "tcp",
    "tool",
    "tip",
    "ee",
    "end",
    "flange",
    "foot",
    "sole",
    "contact",
)  # of names that say "work here"


def end_links(model: pin.Model, mimics: Collection[str] = ()) -> list[str]:
    """Return the end links that two or more joints can move, the likeliest task frame first.

    An end is an outermost link, or a palm: one that carries several joints, with fewer behind it
    than before it. Links named like a tool or a foot come first, then palms, then the others; those
    with more joints before them lead. Links behind mimic joints or joints of several degrees of
    freedom are left out; a floating base counts as welded.
    """
    parents = {frame.parentFrame for frame in model.frames}
    carried = Counter(f.parentFrame for f in model.frames if f.type == pin.FrameType.JOINT)
    found = []
    for index, frame in enumerate(model.frames):
        palm = carried[index] >= 2 and _has_fewer_behind(model, frame.parentJoint)
        if frame.type == pin.FrameType.BODY and (palm or index not in parents):
            joints = _independent_joints(model, index, mimics)
            words = re.split(r"[^a-z0-9]+", frame.name.lower())
            if joints >= 2:
                found.append(
                    (not any(word.startswith(_WORDS) for word in words), not palm, -joints, index)
                )
    return [str(model.frames[index].name) for *_, index in sorted(found)]


def _has_fewer_behind(model: pin.Model, joint: int) -> bool:
    """Tell whether each chain behind a joint has fewer joints than the one to it."""
    before = len(model.supports[joint]) - 1
    behind = max((len(model.supports[j]) - 1 - before for j in model.subtrees[joint]), default=0)
    return behind < before


def _independent_joints(model: pin.Model, frame: int, mimics: Collection[str]) -> int:
    """Return how many joints move a frame, 0 where one of them is not supported."""
    joints = [
        joint for joint in chain_joints(model, frame) if not is_free_flyer(model.joints[joint])
    ]
    try:
        check_joints(model, joints)
    except RobotError:
        return 0
    return 0 if any(str(model.names[joint]) in mimics for joint in joints) else len(joints)
