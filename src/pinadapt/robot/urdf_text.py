"""A robot as URDF: the text it was read from with the numbers in which it differs."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from .._version import __version__
from .chain import frame_id
from .origin import Origin
from .packages import Packages
from .urdf_chain import chain_as_urdf
from .urdf_links import Link, child, distribute, placement_of_element, words
from .xml_file import parse_xml, xml_text

if TYPE_CHECKING:
    from .robot import Robot

_MOVED = 1e-12  # [m] below which a translation is as described


def urdf_text(robot: Robot, *, shapes: bool = True) -> str:
    """Return the text of a URDF that Pinocchio and MuJoCo read; see ``Robot.urdf``.

    Raises:
        RobotError: a changed body that no distribution of mass has, or a source that is gone.
    """
    if robot.origin is None:
        root, changed = chain_as_urdf(robot), "everything: it comes from no URDF"
    else:
        edited = _Edited(robot, robot.origin)
        root, changed = edited.root, _in_words(edited.changes())
    for link in () if shapes else root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    note = f" Written by pinadapt {__version__}. Changed: {changed}. "
    if robot.model.armature.any():
        note += (
            "URDF has no place for rotor inertias: the attribute armature [kg m^2 or kg] of "
            "dynamics, which Pinocchio and MuJoCo skip, is read by pinadapt alone. "
        )
    root.insert(0, ElementTree.Comment(note.replace("--", "- -")))
    ElementTree.indent(root)
    return xml_text(root, robot.name) + "\n"


class _Edited:
    """The URDF of an origin, on the way to be that of another robot with the same chain."""

    def __init__(self, robot: Robot, origin: Origin) -> None:
        urdf = origin.urdf
        self.root = parse_xml(urdf.text, str(urdf.path))
        self.robot, self.described = robot, origin.model
        self.packages = urdf.packages
        self.links = {link.get("name", ""): link for link in self.root.findall("link")}
        self.joints = {joint.get("name", ""): joint for joint in self.root.findall("joint")}
        self.placed = {
            str(frame.name): (int(frame.parentJoint), frame.placement.copy())
            for frame in self.described.frames
            if frame.type == pin.FrameType.BODY and str(frame.name) in self.links
        }

    def changes(self) -> list[tuple[str, str]]:
        """Write everything that differs; return what did, as a kind and a name each."""
        changed = [*self._place_joints(), *self._place_tool(), *self._fill_bodies()]
        changed += self._write_joint_effects()
        find_files(self.root, self.packages)
        return changed

    def _place_joints(self) -> list[tuple[str, str]]:
        changed = []
        pairs = zip(
            self.robot.joint_names,
            self.robot.model.jointPlacements[1:],
            self.described.jointPlacements[1:],
            strict=True,
        )
        for name, now, before in pairs:
            if np.abs(now.translation - before.translation).max() > _MOVED:
                self._set_origin(self.joints[name], now)
                changed.append(("placement", name))
        return changed

    def _place_tool(self) -> list[tuple[str, str]]:
        """Move the task frame by its own fixed joint, or by a new one where it is no last link."""
        name, frame = self.robot.frame, self.robot.model.frames[self.robot.frame_id]
        before = self.described.frames[frame_id(self.described, name)]
        if np.abs(frame.placement.translation - before.placement.translation).max() <= _MOVED:
            return []
        own = (j for j in self.joints.values() if name in (_end(j, "child"), j.get("name")))
        joint = next(own, None)
        tip = None if joint is None else _end(joint, "child")
        last = all(_end(other, "parent") != tip for other in self.joints.values())
        if joint is not None and tip is not None and joint.get("type") == "fixed" and last:
            self._set_origin(joint, frame.placement)
            self.placed[tip] = int(frame.parentJoint), frame.placement.copy()
            return [("placement", name)]
        new = f"{name}_learned" if name in self.links else name
        carrier = _end(self.joints[self.robot.joint_names[-1]], "child")
        ElementTree.SubElement(self.root, "link", name=new)
        fixed = ElementTree.SubElement(self.root, "joint", name=f"{new}_fixed", type="fixed")
        ElementTree.SubElement(fixed, "parent", link=carrier)
        ElementTree.SubElement(fixed, "child", link=new)
        local = self.placed[carrier][1].actInv(frame.placement)
        at = {"xyz": words(local.translation), "rpy": words(pin.rpy.matrixToRpy(local.rotation))}
        ElementTree.SubElement(fixed, "origin", at)
        return [("task frame, a new link", new)]

    def _fill_bodies(self) -> list[tuple[str, str]]:
        changed = []
        for joint, name in enumerate(self.robot.joint_names, 1):
            main = _end(self.joints[name], "child")
            rigid = {
                link: Link(self.links[link], placement)
                for link, (carrier, placement) in self.placed.items()
                if carrier == joint
            }
            others = [part for link, part in rigid.items() if link != main]
            ten = np.array(self.robot.model.inertias[joint].toDynamicParameters())
            if distribute(ten, rigid[main], others, name):
                changed.append(("inertia", main))
        return changed

    def _write_joint_effects(self) -> list[tuple[str, str]]:
        robot, changed = self.robot, []
        rows = zip(
            robot.joint_names,
            robot.friction.viscous,
            robot.friction.coulomb,
            np.where(robot.model.armature == self.described.armature, 0.0, robot.model.armature),
            strict=True,
        )
        for name, *numbers in rows:
            for attribute, number in zip(("damping", "friction", "armature"), numbers, strict=True):
                dynamics = self.joints[name].find("dynamics")
                old = 0.0 if dynamics is None else float(dynamics.get(attribute, "0"))
                if number and number != old:
                    child(self.joints[name], "dynamics").set(attribute, words([number]))
                    changed.append((attribute, name))
        return changed

    def _set_origin(self, joint: ElementTree.Element, placement: pin.SE3) -> None:
        """Move a joint to a translation in the axes of the moving joint before it; not turn it."""
        local = self.placed[_end(joint, "parent")][1].actInv(placement)
        described = placement_of_element(joint)
        assert np.allclose(described.rotation, local.rotation, atol=1e-6)
        child(joint, "origin").set("xyz", words(local.translation))


def find_files(root: ElementTree.Element, packages: Packages) -> None:
    """Write the whole path of each mesh and texture that is found, so that the text may move.

    MuJoCo is told by its own element to take such paths as they are.
    """
    named = [e for tag in ("mesh", "texture") for e in root.iter(tag) if e.get("filename")]
    for element in named:
        file = packages.file(element.get("filename", ""))
        if file is not None:
            element.set("filename", str(file))
    if named and root.find("mujoco") is None:
        extension = ElementTree.SubElement(root, "mujoco")
        ElementTree.SubElement(extension, "compiler", strippath="false")


def _in_words(changes: list[tuple[str, str]]) -> str:
    """Return changes in words, those of one kind together."""
    kinds = dict.fromkeys(kind for kind, _ in changes)
    named = {kind: ", ".join(name for other, name in changes if other == kind) for kind in kinds}
    return "; ".join(f"{kind} of {names}" for kind, names in named.items()) or "nothing"


def _end(joint: ElementTree.Element, end: str) -> str:
    """Return the name of the link at an end of a joint, "parent" or "child"."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
