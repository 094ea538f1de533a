"""Writing a robot as URDF: the text that it was read from, with the changed numbers."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import ROUNDING
from .._version import __version__
from .chain import (
    axis_of,
    check_physical,
    effort_limits,
    frame_named,
    is_physical,
    is_slide,
    links_of,
    position_limits,
    velocity_limits,
)
from .floating_base import BASE_JOINTS
from .urdf import ENTRIES, Origin, Urdf, child, xml_text
from .xacro import Packages


def first_comment(robot: Any, words: str) -> Any:
    """Return the first comment of a file of a ``Robot``."""
    text = " ".join(f"Written by pinadapt {__version__}. {words} {robot.remark}".split())
    return ElementTree.Comment(f" {text.replace('--', '- -')} ")


def urdf_text(robot: Any, shapes: bool) -> str:
    """Return the text of a URDF of a ``Robot`` that Pinocchio and MuJoCo read.

    Raises:
        RobotError: a changed body without a physical inertia, or a source file that is missing.
    """
    edited = _Edited(robot, robot.origin or _skeleton(robot))
    root = edited.written()
    words = "" if robot.origin else "The chain alone, without shapes."
    words += f" To be loaded with the frame {', '.join(edited.frames)}."
    for link in () if shapes else root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    if shafts := ", ".join(shaft.name(robot.joint_names) for shaft in robot.friction.shafts):
        words += f" Not in a URDF: the motors that turn with {shafts}."
    root.insert(0, first_comment(robot, words))
    ElementTree.indent(root)
    return xml_text(root) + "\n"


class _Edited:
    """The URDF of an origin while it is changed into that of a robot with the same joints."""

    def __init__(self, robot: Any, origin: Origin) -> None:
        self.root = origin.urdf.root
        self.packages = origin.urdf.packages
        self.robot = robot
        self.described = origin.model
        self.joints = {joint.get("name", ""): joint for joint in self.root.findall("joint")}
        self.links = {link.get("name", ""): link for link in self.root.findall("link")}

    def written(self) -> ElementTree.Element:
        """Write everything that differs; return the root element."""
        model = self.robot.model
        own = [
            (index, name)
            for index, name in enumerate(self.robot.joint_names, 1)
            if name not in BASE_JOINTS
        ]
        for index, name in own:
            now = model.jointPlacements[index]
            if not _same(now, self.described.jointPlacements[index]):
                self._place(self.joints[name], now)
        self.frames = [self._place_tool(name) for name in self.robot.frames]
        for index in range(1, model.njoints):
            self._write_inertia(index)
        friction = self.robot.friction
        usual = {"damping": friction.viscous, "friction": friction.coulomb}
        if not np.array_equal(model.armature, self.described.armature):
            usual["armature"] = model.armature
        effects = {n: values for n, values in usual.items() if friction.present or values.any()}
        for attribute, values in (effects | friction.special).items():
            for index, name in own:
                stated = child(self.joints[name], "dynamics").attrib
                value = values[index - 1]
                if float(stated.get(attribute, "nan")) != value:
                    stated[attribute] = digits(value)
                    stated |= {"damping": "0", "friction": "0"} | stated  # URDF asks for both
        self.packages.find_files(self.root)
        if self.root.find("mujoco") is None and next(self.root.iter("mesh"), None) is not None:
            extension = ElementTree.SubElement(self.root, "mujoco")  # which accepts absolute paths
            ElementTree.SubElement(extension, "compiler", strippath="false")
        return self.root

    def _place_tool(self, name: str) -> str:
        """Move a task frame: the joint of a last link without mass, else a new link; return it."""
        frame = frame_named(self.robot.model, name)
        if name in self.links and _same(frame.placement, self._placement(name)):
            return name
        parents = {_end(joint, "parent") for joint in self.joints.values()}
        for joint in self.joints.values():
            last = _end(joint, "child") == name not in parents and joint.get("type") == "fixed"
            if last and not _read_inertia(self.links[name]).mass:
                self._place(joint, frame.placement)
                return name
        new = f"{name}_learned" if name in self.links else name
        carrier = links_of(self.described, frame.parentJoint)[0]
        ElementTree.SubElement(self.root, "link", name=new)
        self._place(_joint(self.root, f"{new}_fixed", "fixed", carrier, new), frame.placement)
        return new

    def _placement(self, name: str) -> pin.SE3:
        """Return the placement of a link or frame in the axes of the moving joint before it."""
        return frame_named(self.described, name).placement

    def _place(self, joint: ElementTree.Element, placement: pin.SE3) -> None:
        """Set the placement of a joint, given in the axes of the moving joint before it.

        Angles that are the same up to rounding keep their digits.
        """
        placement = self._placement(_end(joint, "parent")).actInv(placement)
        before = _read_origin(joint).rotation
        origin = child(joint, "origin")
        origin.set("xyz", digits(placement.translation))
        if np.abs(before - placement.rotation).max() > ROUNDING:
            origin.set("rpy", digits(pin.rpy.matrixToRpy(placement.rotation)))

    def _write_inertia(self, index: int) -> None:
        """Write what changed of a body to its first link.

        Where that has no physical inertia then, it has that of the body, the others lose theirs.

        Raises:
            RobotError: the inertia of the body is not physical.
        """
        now = self.robot.model.inertias[index].toDynamicParameters()
        before = self.described.inertias[index].toDynamicParameters()
        if np.allclose(now, before, rtol=ROUNDING, atol=ROUNDING * np.abs(now).max()):
            return
        names = links_of(self.described, index)
        check_physical(self.robot.model.inertias[index], names[0], "urdf")
        first = self.links[names[0]]
        placement = self._placement(names[0])
        changed = placement.act(_read_inertia(first)).toDynamicParameters() + now - before
        if not is_physical(changed):
            changed = now
            for link in map(self.links.__getitem__, names):
                for inertial in link.findall("inertial"):
                    link.remove(inertial)
        body = placement.actInv(pin.Inertia.FromDynamicParameters(changed))
        inertial = child(first, "inertial")
        child(inertial, "origin").attrib.update(xyz=digits(body.lever), rpy="0 0 0")
        child(inertial, "mass").set("value", digits(body.mass))
        for entry, number in zip(ENTRIES, body.inertia[np.triu_indices(3)], strict=True):
            child(inertial, "inertia").set(entry, digits(number))


def _read_inertia(link: ElementTree.Element) -> pin.Inertia:
    """Return the inertia that a link states, in its axes; zero if there is none."""
    inertial = link.find("inertial")
    if inertial is None:
        return pin.Inertia.Zero()
    stated = child(inertial, "inertia")
    entries = [float(stated.get(name, "0")) for name in ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")]
    mass = float(child(inertial, "mass").get("value", "0"))
    body = pin.Inertia(mass, np.zeros(3), pin.Symmetric3(np.array(entries)).matrix())
    return _read_origin(inertial).act(body)


def _read_origin(element: ElementTree.Element) -> pin.SE3:
    """Return the placement that the <origin> of an element states."""
    given = child(element, "origin").attrib
    xyz, rpy = (np.array(given.get(k, "0 0 0").split(), dtype=float) for k in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _same(one: pin.SE3, other: pin.SE3) -> bool:
    """Return whether two placements differ by rounding only."""
    return bool(np.abs(one.homogeneous - other.homogeneous).max() <= ROUNDING)


def _skeleton(robot: Any) -> Origin:
    """Return a URDF of the joints alone, with their limits, without placements, inertias, effects.

    For a joint without velocity or effort limit, 0 is written, as is usual; without position
    limits, 1e9.
    """
    model = robot.model
    root = ElementTree.Element("robot", name=robot.name)
    taken = set(robot.frames)
    links = [free_name("base", taken)]
    ElementTree.SubElement(root, "link", name=links[0])
    lower, upper = np.clip(position_limits(model), -1e9, 1e9)
    effort, velocity = np.nan_to_num([effort_limits(model), velocity_limits(model)], posinf=0.0)
    limits = {"effort": effort, "velocity": velocity, "lower": lower, "upper": upper}
    for index, name in enumerate(robot.joint_names, 1):
        part = model.joints[index]
        kind = "prismatic" if is_slide(part) else "continuous" if part.nq == 2 else "revolute"
        links.append(free_name(links_of(model, index)[0], taken))
        ElementTree.SubElement(root, "link", name=links[-1])
        joint = _joint(root, name, kind, links[model.parents[index]], links[-1])
        ElementTree.SubElement(joint, "axis", xyz=digits(axis_of(model, index)))
        ElementTree.SubElement(
            joint, "limit", {name: digits(values[index - 1]) for name, values in limits.items()}
        )
    for frame in robot.frames:
        carrier = links[frame_named(model, frame).parentJoint]
        ElementTree.SubElement(root, "link", name=frame)
        _joint(root, f"{frame}_fixed", "fixed", carrier, frame)
    urdf = Urdf(Path(), xml_text(root), Packages(Path()))
    return Origin(urdf, urdf.model())


def _joint(
    root: ElementTree.Element, name: str, kind: str, parent: str, carried: str
) -> ElementTree.Element:
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=carried)
    return joint


def free_name(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, and add it to those taken."""
    while name in taken:
        name += "_body"
    taken.add(name)
    return name


def _end(joint: ElementTree.Element, end: str) -> str:
    """Return the name of the link at an end of a joint, "parent" or "child"."""
    return child(joint, end).get("link", "")


def digits(numbers: ArrayLike) -> str:
    """Return one or several numbers as text, with all digits."""
    return " ".join(repr(float(number)) for number in np.ravel(numbers))
