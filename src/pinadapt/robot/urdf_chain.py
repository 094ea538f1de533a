"""A chain that was not read from a URDF, written as one: bodies, joints and the task frame."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from .chain import is_slide, links_of
from .effort_limits import effort_limits
from .position_limits import position_limits
from .urdf_links import Link, words
from .velocity_limits import velocity_limits

if TYPE_CHECKING:
    from .robot import Robot

_UNLIMITED = 1e9  # [rad or m]


def chain_as_urdf(robot: Robot) -> ElementTree.Element:
    """Return the root element of a URDF of the chain alone, without anything to draw.

    A joint without a limit of speed or effort has zero there, as is usual; one without a limit of
    position has 1e9.
    """
    model, root = robot.model, ElementTree.Element("robot", name=robot.name)
    taken = {robot.frame}
    names = [_free("base", taken)]
    ElementTree.SubElement(root, "link", name=names[0])
    for joint, name in enumerate(robot.joint_names, 1):
        names.append(_free(links_of(model, joint)[0], taken))
        link = ElementTree.SubElement(root, "link", name=names[-1])
        Link(link, pin.SE3.Identity()).write(model.inertias[joint].toDynamicParameters())
        element = _joint(root, name, _kind(model, joint), names[-2], names[-1])
        _place(element, model.jointPlacements[joint])
        ElementTree.SubElement(element, "axis", xyz=words(_axis(model, joint)))
    _write_limits(root, robot)
    frame = model.frames[robot.frame_id]
    ElementTree.SubElement(root, "link", name=robot.frame)
    tip = _joint(root, f"{robot.frame}_fixed", "fixed", names[-1], robot.frame)
    _place(tip, frame.placement)
    return root


def _write_limits(root: ElementTree.Element, robot: Robot) -> None:
    """Write limits, friction and rotor inertias of all joints."""
    lower, upper = position_limits(robot.model)
    efforts, speeds = effort_limits(robot), velocity_limits(robot.model)
    for i, joint in enumerate(root.findall("joint")):
        limit = {"effort": _or_zero(efforts[i]), "velocity": _or_zero(speeds[i])}
        if joint.get("type") != "continuous":
            limit["lower"] = words([np.clip(lower[i], -_UNLIMITED, _UNLIMITED)])
            limit["upper"] = words([np.clip(upper[i], -_UNLIMITED, _UNLIMITED)])
        ElementTree.SubElement(joint, "limit", limit)
        effects = {
            "damping": words([robot.friction.viscous[i]]),
            "friction": words([robot.friction.coulomb[i]]),
        }
        if robot.model.armature[i]:
            effects["armature"] = words([robot.model.armature[i]])
        ElementTree.SubElement(joint, "dynamics", effects)


def _joint(
    root: ElementTree.Element, name: str, kind: str, parent: str, child: str
) -> ElementTree.Element:
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _place(joint: ElementTree.Element, placement: pin.SE3) -> None:
    at = {
        "xyz": words(placement.translation),
        "rpy": words(pin.rpy.matrixToRpy(placement.rotation)),
    }
    ElementTree.SubElement(joint, "origin", at)


def _kind(model: pin.Model, joint: int) -> str:
    if is_slide(model.joints[joint]):
        return "prismatic"
    return "continuous" if model.joints[joint].nq == 2 else "revolute"


def _axis(model: pin.Model, joint: int) -> np.ndarray:
    """Return the axis (3) of a joint in its own axes."""
    part = model.joints[joint]
    scratch = part.createData()
    part.calc(scratch, pin.neutral(model))
    S = np.asarray(scratch.S).reshape(6)
    return S[:3] if is_slide(part) else S[3:]


def _or_zero(limit: float) -> str:
    return words([limit if np.isfinite(limit) else 0.0])


def _free(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, and take it."""
    while name in taken:
        name += "_body"
    taken.add(name)
    return name
