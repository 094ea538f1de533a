"""Writing a robot as URDF: the text that it was read from, with the changed numbers."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from .._version import __version__
from ..exceptions import RobotError
from .chain import (
    effort_limits,
    frame_id,
    is_physical,
    is_slide,
    links_of,
    position_limits,
    velocity_limits,
)
from .urdf import Origin, parse_xml, xml_text
from .xacro import Packages

_MOVED = 1e-12  # [m] below which a translation counts as unchanged
_TURNED = 1e-9  # the same of an entry of a rotation
_SAME = 1e-9  # relative difference of inertias that counts as rounding
_HALVINGS = 30  # how often the inertia kept by the other links of a body is halved at most
_LEAST_RADIUS = 1e-3  # [m] of gyration, of a link that never moves
_UNLIMITED = 1e9  # [rad or m], written for a joint without position limits
_ENTRIES = {
    **{"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)},
    **{"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)},
}


@dataclass(frozen=True, eq=False)
class WrittenChain:
    """The data of a robot that a URDF holds.

    Attributes:
        name: of the robot.
        model: Pinocchio model of the chain.
        frame: name of the task frame.
        viscous, coulomb: (nv) joint friction [N m s/rad or N s/m], [N m or N].
        origin: the URDF that the robot was read from, or None.
        remark: for the first comment.
        effects: further effects of the joints, name of an attribute -> (nv) numbers, which only
            ``load(..., joint_effects=True)`` reads.
    """

    name: str
    model: pin.Model
    frame: str
    viscous: np.ndarray
    coulomb: np.ndarray
    origin: Origin | None = None
    remark: str = ""
    effects: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, from the base."""
        return [str(name) for name in self.model.names[1:]]

    @property
    def tip(self) -> pin.Frame:
        """The task frame."""
        return self.model.frames[frame_id(self.model, self.frame)]


def urdf_text(chain: WrittenChain, *, shapes: bool = True) -> str:
    """Return the text of a URDF that Pinocchio and MuJoCo read; see ``Robot.urdf``.

    Raises:
        RobotError: a changed body without a physical inertia, or a source file that is missing.
    """
    if chain.origin is None:
        root, changed = chain_as_urdf(chain), "everything, as it was not read from a URDF"
    else:
        edited = _Edited(chain, chain.origin)
        root, changed = edited.root, _change_text(edited.changes())
    for link in () if shapes else root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    note = f" Written by pinadapt {__version__}. Changed: {changed}. "
    note += f"{chain.remark} " if chain.remark else ""
    own = ["armature"] if chain.model.armature.any() else []
    if own := [*own, *chain.effects]:
        note += (
            f"URDF does not define {', '.join(own)}: these attributes of dynamics are read by "
            "pinadapt only; others ignore them. "
        )
    root.insert(0, ElementTree.Comment(note.replace("--", "- -")))
    ElementTree.indent(root)
    return xml_text(root) + "\n"


def _change_text(changes: list[tuple[str, str]]) -> str:
    """Return a text of the changes, grouped by kind."""
    kinds = dict.fromkeys(kind for kind, _ in changes)
    named = {kind: ", ".join(name for other, name in changes if other == kind) for kind in kinds}
    return "; ".join(f"{kind} of {names}" for kind, names in named.items()) or "nothing"


# Editing the URDF of the origin


class _Edited:
    """The URDF of an origin while it is changed into that of a robot with the same joints."""

    def __init__(self, chain: WrittenChain, origin: Origin) -> None:
        urdf = origin.urdf
        self.root = parse_xml(urdf.text, str(urdf.path))
        self.chain, self.described = chain, origin.model
        self.packages = urdf.packages
        self.links = {link.get("name", ""): link for link in self.root.findall("link")}
        self.joints = {joint.get("name", ""): joint for joint in self.root.findall("joint")}
        self.placed = {
            str(frame.name): (int(frame.parentJoint), frame.placement.copy())
            for frame in self.described.frames
            if frame.type == pin.FrameType.BODY and str(frame.name) in self.links
        }

    def changes(self) -> list[tuple[str, str]]:
        """Write everything that differs; return the kind and the name of each change."""
        changed = [*self._place_joints(), *self._place_tool(), *self._fill_bodies()]
        changed += [*self._write_joint_effects(), *self._mend_fixed_links()]
        _find_files(self.root, self.packages)
        return changed

    def _place_joints(self) -> list[tuple[str, str]]:
        changed = []
        pairs = zip(
            self.chain.joint_names,
            self.chain.model.jointPlacements[1:],
            self.described.jointPlacements[1:],
            strict=True,
        )
        for name, now, before in pairs:
            if _differ(now, before):
                self._set_origin(self.joints[name], now)
                changed.append(("placement", name))
        return changed

    def _place_tool(self) -> list[tuple[str, str]]:
        """Move the task frame.

        If it is a last link on a fixed joint, that joint is moved; else a new link is added.
        """
        name, frame = self.chain.frame, self.chain.tip
        before = self.described.frames[frame_id(self.described, name)]
        if not _differ(frame.placement, before.placement):
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
        carrier = _end(self.joints[self.chain.joint_names[-1]], "child")
        ElementTree.SubElement(self.root, "link", name=new)
        fixed = ElementTree.SubElement(self.root, "joint", name=f"{new}_fixed", type="fixed")
        ElementTree.SubElement(fixed, "parent", link=carrier)
        ElementTree.SubElement(fixed, "child", link=new)
        local = self.placed[carrier][1].actInv(frame.placement)
        at = {"xyz": digits(local.translation), "rpy": digits(pin.rpy.matrixToRpy(local.rotation))}
        ElementTree.SubElement(fixed, "origin", at)
        return [("task frame, a new link", new)]

    def _fill_bodies(self) -> list[tuple[str, str]]:
        changed = []
        for joint, name in enumerate(self.chain.joint_names, 1):
            main = _end(self.joints[name], "child")
            rigid = {
                link: Link(self.links[link], placement)
                for link, (carrier, placement) in self.placed.items()
                if carrier == joint
            }
            others = [part for link, part in rigid.items() if link != main]
            ten = np.array(self.chain.model.inertias[joint].toDynamicParameters())
            if distribute(ten, rigid[main], others, name):
                changed.append(("inertia", main))
        return changed

    def _write_joint_effects(self) -> list[tuple[str, str]]:
        chain, changed = self.chain, []
        rows = zip(
            chain.joint_names,
            chain.viscous,
            chain.coulomb,
            np.where(chain.model.armature == self.described.armature, 0.0, chain.model.armature),
            strict=True,
        )
        for name, *numbers in rows:
            for attribute, number in zip(("damping", "friction", "armature"), numbers, strict=True):
                dynamics = self.joints[name].find("dynamics")
                old = 0.0 if dynamics is None else float(dynamics.get(attribute, "0"))
                if number and number != old:
                    child(self.joints[name], "dynamics").set(attribute, digits([number]))
                    changed.append((attribute, name))
        for attribute, values in chain.effects.items():
            for name, number in zip(chain.joint_names, values, strict=True):
                child(self.joints[name], "dynamics").set(attribute, digits([number]))
            changed.append((attribute, "all joints"))
        return changed

    def _mend_fixed_links(self) -> list[tuple[str, str]]:
        """Give links that never move an inertia that MuJoCo accepts, where theirs is impossible."""
        mended = []
        for name, (carrier, placement) in self.placed.items():
            if carrier:
                continue
            if Link(self.links[name], placement).mend():
                mended.append(("impossible inertia", name))
        return mended

    def _set_origin(self, joint: ElementTree.Element, placement: pin.SE3) -> None:
        """Set the placement of a joint, given in the axes of the moving joint before it.

        Angles that are the same up to rounding keep the digits of the description.
        """
        local = self.placed[_end(joint, "parent")][1].actInv(placement)
        described = placement_of_element(joint)
        origin = child(joint, "origin")
        origin.set("xyz", digits(local.translation))
        if np.abs(described.rotation - local.rotation).max() > _TURNED:
            origin.set("rpy", digits(pin.rpy.matrixToRpy(local.rotation)))


def _differ(one: pin.SE3, other: pin.SE3) -> bool:
    """Return whether two placements differ by more than rounding."""
    moved = np.abs(one.translation - other.translation).max()
    return bool(moved > _MOVED or np.abs(one.rotation - other.rotation).max() > _TURNED)


def _find_files(root: ElementTree.Element, packages: Packages) -> None:
    """Make the paths of meshes and textures absolute, so that the URDF can be stored anywhere.

    An element for MuJoCo makes it accept absolute paths.
    """
    named = [e for tag in ("mesh", "texture") for e in root.iter(tag) if e.get("filename")]
    for element in named:
        file = packages.file(element.get("filename", ""))
        if file is not None:
            element.set("filename", str(file))
    if named and root.find("mujoco") is None:
        extension = ElementTree.SubElement(root, "mujoco")
        ElementTree.SubElement(extension, "compiler", strippath="false")


# Inertia of the links that form one rigid body


@dataclass(frozen=True, eq=False)
class Link:
    """One of the links that form a rigid body.

    Attributes:
        element: its element in the URDF.
        placement: its placement in the axes of the joint that moves the body.
    """

    element: ElementTree.Element
    placement: pin.SE3

    def read(self) -> np.ndarray:
        """Return its ten inertial parameters (10) at the joint; zeros if it has no inertia."""
        inertial = self.element.find("inertial")
        if inertial is None:
            return np.zeros(10)
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        at = placement_of_element(inertial)
        matrix = np.zeros((3, 3))
        for name, (i, j) in _ENTRIES.items():
            value = 0.0 if inertia is None else float(inertia.get(name, "0"))
            matrix[i, j] = matrix[j, i] = value
        kilograms = 0.0 if mass is None else float(mass.get("value", "0"))
        body = pin.Inertia(kilograms, np.zeros(3), matrix)
        return np.array((self.placement * at).act(body).toDynamicParameters())

    def write(self, ten: np.ndarray) -> None:
        """Set its ten inertial parameters (10), given at the joint."""
        body = self.placement.actInv(pin.Inertia.FromDynamicParameters(ten))
        inertial = self.element.find("inertial")
        if inertial is None:
            inertial = ElementTree.SubElement(self.element, "inertial")
        child(inertial, "origin").attrib.update(xyz=digits(body.lever), rpy="0 0 0")
        child(inertial, "mass").set("value", digits([body.mass]))
        inertia = child(inertial, "inertia")
        for name, (i, j) in _ENTRIES.items():
            inertia.set(name, digits([body.inertia[i, j]]))

    def mend(self) -> bool:
        """Give it a small possible inertia, if it has mass and no body has its; return if so."""
        ten = self.read()
        if not ten[0] > 0.0 or is_physical(ten):
            return False
        centre = ten[1:4] / ten[0]
        about = np.abs(np.diag(pin.Inertia.FromDynamicParameters(ten).inertia)).max()
        ball = max(float(about), ten[0] * _LEAST_RADIUS**2) * np.eye(3)
        self.write(np.array(pin.Inertia(ten[0], centre, ball).toDynamicParameters()))
        return True


def distribute(ten: np.ndarray, main: Link, others: Sequence[Link], body: str) -> bool:
    """Distribute ten inertial parameters (10) over the links of a body; return if they changed.

    The main link takes the total minus the inertia of the others. If that is not physical, the
    others keep only half of their inertia, then a quarter and so on. As the total is physical, this
    ends.

    Args:
        ten: inertial parameters of the whole body, at its joint.
        main: the link that takes the difference.
        others: the other links of the body.
        body: name of the joint, for messages.

    Raises:
        RobotError: the total is not physical.
    """
    before = main.read() + sum((link.read() for link in others), np.zeros(10))
    mended = [link.mend() for link in others]  # MuJoCo refuses the file otherwise
    kept = [(link, link.read()) for link in others]
    rest = sum((part for _, part in kept), np.zeros(10))
    if not any(mended) and np.allclose(before, ten, rtol=_SAME, atol=_SAME * np.abs(ten).max()):
        return False
    for halvings in range(_HALVINGS):
        share = 0.5**halvings
        if is_physical(ten - share * rest):
            main.write(ten - share * rest)
            for link, part in kept if halvings else ():
                if part.any():
                    link.write(share * part)
            return True
    raise RobotError(
        f"the inertia of the body that joint '{body}' moves is not physical: no distribution of "
        "mass has it.",
        where="urdf",
        hint='The adaptation "natural" keeps all bodies physical.',
    )


# Writing a chain that comes from no URDF


def chain_as_urdf(chain: WrittenChain) -> ElementTree.Element:
    """Return the root element of a URDF of the chain alone, without shapes.

    For a joint without velocity or effort limit, 0 is written, as is usual; without position
    limits, 1e9.
    """
    model, root = chain.model, ElementTree.Element("robot", name=chain.name)
    taken = {chain.frame}
    names = [free_name("base", taken)]
    ElementTree.SubElement(root, "link", name=names[0])
    for joint, name in enumerate(chain.joint_names, 1):
        names.append(free_name(links_of(model, joint)[0], taken))
        link = ElementTree.SubElement(root, "link", name=names[-1])
        Link(link, pin.SE3.Identity()).write(model.inertias[joint].toDynamicParameters())
        element = _joint(root, name, _kind(model, joint), names[-2], names[-1])
        _place(element, model.jointPlacements[joint])
        ElementTree.SubElement(element, "axis", xyz=digits(axis_of(model, joint)))
    _write_limits(root, chain)
    frame = chain.tip
    ElementTree.SubElement(root, "link", name=chain.frame)
    tip = _joint(root, f"{chain.frame}_fixed", "fixed", names[-1], chain.frame)
    _place(tip, frame.placement)
    return root


def _write_limits(root: ElementTree.Element, chain: WrittenChain) -> None:
    """Write limits, friction and rotor inertias of all joints."""
    lower, upper = position_limits(chain.model)
    efforts, speeds = effort_limits(chain.model), velocity_limits(chain.model)
    for i, joint in enumerate(root.findall("joint")):
        limit = {"effort": _or_zero(efforts[i]), "velocity": _or_zero(speeds[i])}
        if joint.get("type") != "continuous":
            limit["lower"] = digits([np.clip(lower[i], -_UNLIMITED, _UNLIMITED)])
            limit["upper"] = digits([np.clip(upper[i], -_UNLIMITED, _UNLIMITED)])
        ElementTree.SubElement(joint, "limit", limit)
        effects = {
            "damping": digits([chain.viscous[i]]),
            "friction": digits([chain.coulomb[i]]),
        }
        if chain.model.armature[i]:
            effects["armature"] = digits([chain.model.armature[i]])
        effects |= {name: digits([values[i]]) for name, values in chain.effects.items()}
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
        "xyz": digits(placement.translation),
        "rpy": digits(pin.rpy.matrixToRpy(placement.rotation)),
    }
    ElementTree.SubElement(joint, "origin", at)


def _kind(model: pin.Model, joint: int) -> str:
    if is_slide(model.joints[joint]):
        return "prismatic"
    return "continuous" if model.joints[joint].nq == 2 else "revolute"


def axis_of(model: pin.Model, joint: int) -> np.ndarray:
    """Return the axis (3) of a joint in the joint frame."""
    part = model.joints[joint]
    scratch = part.createData()
    part.calc(scratch, pin.neutral(model))
    S = np.asarray(scratch.S).reshape(6)
    return S[:3] if is_slide(part) else S[3:]


def _or_zero(limit: float) -> str:
    return digits([limit if np.isfinite(limit) else 0.0])


def free_name(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, and add it to those taken."""
    while name in taken:
        name += "_body"
    taken.add(name)
    return name


# XML elements


def placement_of_element(element: ElementTree.Element) -> pin.SE3:
    """Return the placement that the <origin> of an element states."""
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    xyz, rpy = (np.array([float(w) for w in given.get(k, "0 0 0").split()]) for k in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _end(joint: ElementTree.Element, end: str) -> str:
    """Return the name of the link at an end of a joint, "parent" or "child"."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    """Return the child element with a tag; it is added if missing."""
    found = element.find(tag)
    return ElementTree.SubElement(element, tag) if found is None else found


def digits(numbers: Sequence[float] | np.ndarray) -> str:
    """Return numbers as text, with all digits."""
    return " ".join(repr(float(number)) for number in numbers)
