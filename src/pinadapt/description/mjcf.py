"""MJCF, the format of MuJoCo: files read with Pinocchio, and chains written."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from .._version import __version__
from ..exceptions import RobotError
from .chain import effort_limits, is_physical, is_slide, links_of, position_limits
from .urdf import flaw_of_numbers, read_xml, xml_text
from .urdf_writer import WrittenChain, axis_of, digits, free_name

_LARGEST = 1e3  # [rad or m] position limits beyond which there are none
_COMPILED = (
    "Let MuJoCo write the compiled model as one plain file: mujoco.mj_saveLastXML(path, model)."
)
# Pinocchio ignores these elements without an error; the model would be wrong.
_SKIPPED = ("include", "attach", "replicate", "composite", "flexcomp", "frame", "plugin")
# Pinocchio does not compute the inertia of these shapes.
_NO_INERTIA = ("mesh", "ellipsoid", "hfield", "sdf")
_NUMBERS = (
    *("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "axis", "range", "ref", "fromto"),
    *("size", "mass", "density", "diaginertia", "fullinertia", "armature", "gravity", "qpos"),
    *("damping", "frictionloss", "scale", "actuatorfrcrange"),
)


@dataclass(frozen=True)
class Mjcf:
    """An MJCF file of which Pinocchio ignores nothing that changes the model.

    Attributes:
        path: the file.
        coupled: names of joints that an <equality> couples to others.
        gravity: (3) [m/s^2] in world axes.
    """

    path: Path
    coupled: frozenset[str]
    gravity: tuple[float, ...]

    @classmethod
    def read(cls, path: Path, root: ElementTree.Element) -> Mjcf:
        """Check the root element of a file. It is data, which runs nothing.

        Raises:
            RobotError: an element that Pinocchio would ignore, or text in place of a number.
        """
        for flaw in _flaws(root):
            raise RobotError(flaw, where=str(path), hint=_COMPILED)
        loops = [element.tag for kind in ("connect", "weld") for element in root.iter(kind)]
        if loops:
            warnings.warn(
                f"{path}: {len(loops)} kinematic loops closed by <equality> are opened.",
                stacklevel=3,
            )
        coupled = (joint.get("joint1", "") for joint in root.findall("equality/joint"))
        texts = [option.get("gravity", "") for option in root.findall("option")]
        gravity = next((text for text in texts if text), "0 0 -9.81")
        return cls(path, frozenset(coupled), tuple(map(float, gravity.split())))

    def model(self) -> pin.Model:
        """Build the model.

        Raises:
            RobotError: Pinocchio cannot read it.
        """
        try:
            model = pin.buildModelFromMJCF(str(self.path))
        except Exception as error:
            raise _unreadable(error, self.path) from error
        model.gravity.linear = np.array(self.gravity)
        return model

    def geometry(self, kind: pin.GeometryType) -> pin.GeometryModel:
        """Return the visual or collision geometry, without shapes whose mesh file is missing.

        Raises:
            RobotError: Pinocchio cannot read it.
        """
        with TemporaryDirectory() as folder:
            complete = Path(folder) / self.path.name
            root = read_xml(self.path)
            _leave_out_missing_meshes(root, self.path)
            complete.write_text(xml_text(root), encoding="utf-8")
            try:
                return pin.buildGeomFromMJCF(self.model(), str(complete), kind)
            except Exception as error:
                raise _unreadable(error, self.path) from error

    def mimics(self) -> frozenset[str]:
        """Return the names of the joints that are coupled to another joint."""
        return self.coupled


def _unreadable(error: Exception, path: Path) -> RobotError:
    lines = [line for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    reason = lines[-1].removeprefix("message: ").rstrip(".")
    return RobotError(
        f"Pinocchio cannot read this MJCF file: {reason}.", where=str(path), hint=_COMPILED
    )


def _leave_out_missing_meshes(root: ElementTree.Element, path: Path) -> None:
    """Make all file paths in an MJCF absolute, and remove shapes whose mesh file is missing.

    A warning lists the missing files.
    """
    compiler = root.find("compiler")
    options = {} if compiler is None else compiler.attrib
    start = path.resolve().parent
    missing = {}
    for asset in root.iter("asset"):
        for kind in ("mesh", "texture"):
            above = start / options.get(f"{kind}dir", options.get("assetdir", ""))
            for thing in asset.findall(kind):
                file = above / thing.get("file", "")
                if kind == "mesh" and thing.get("file") and not file.is_file():
                    missing[thing.get("name", file.stem)] = str(file)
                    asset.remove(thing)
                elif thing.get("file"):
                    thing.set("file", str(file))
    for body in root.iter():
        for geom in [geom for geom in body.findall("geom") if geom.get("mesh") in missing]:
            body.remove(geom)
    if missing:
        files = ", ".join(missing.values())
        warnings.warn(f"{path}: not drawn, as these mesh files are missing: {files}.", stacklevel=3)


def keyframe(model: pin.Model) -> np.ndarray:
    """Return the configuration (nq) of the keyframe "home", else of the first, else the neutral."""
    poses = {pose.key(): pose.data() for pose in model.referenceConfigurations}
    first = next(iter(poses.values()), pin.neutral(model))
    return np.array(poses.get("home", first))


def _flaws(root: ElementTree.Element) -> Iterator[str]:
    """Yield what Pinocchio would ignore or misread."""
    for element in root.iter():
        if element.tag in _SKIPPED:
            yield f"Pinocchio does not read <{element.tag}>."
        for name in _NUMBERS:
            text = element.get(name)
            flaw = text is not None and flaw_of_numbers(text)
            if flaw:
                yield f"<{element.tag}> '{element.get('name', '')}': {name}=\"{text}\" {flaw}."
    for body in root.iter("body"):
        if not body.get("name"):
            yield "a <body> has no name; Pinocchio ignores such bodies and all that they carry."
        shapes = [geom for geom in body.findall("geom") if _has_no_inertia(geom)]
        if body.find("inertial") is None and shapes:
            yield (
                f"body '{body.get('name')}' has no <inertial>, and Pinocchio does not compute the "
                "inertia of its shapes."
            )


def _has_no_inertia(geom: ElementTree.Element) -> bool:
    massless = "0" in (geom.get("mass"), geom.get("density"))
    return not massless and (geom.get("mesh") is not None or geom.get("type") in _NO_INERTIA)


@dataclass(frozen=True)
class WrittenShaft:
    """A motor that turns with two joints.

    Attributes:
        name: of the shaft.
        joints: names of the joints.
        factors: of their velocities in that of the shaft.
        armature, viscous, coulomb: of the shaft.
    """

    name: str
    joints: tuple[str, str]
    factors: tuple[float, float]
    armature: float
    viscous: float
    coulomb: float


def mjcf_text(
    chain: WrittenChain, offset: np.ndarray, shafts: Sequence[WrittenShaft] = (), lost: str = ""
) -> str:
    """Return the text of an MJCF file of a chain alone, without shapes.

    Joints have limits, ``damping``, ``frictionloss`` and ``armature``; each has a motor, limited to
    its effort. A constant torque is an actuator without gain, after the motors, and a shaft of two
    joints is a fixed tendon. The task frame is a site.

    Args:
        chain: what is written.
        offset: (nv) constant torques that resist the motors [N m or N].
        shafts: motors that turn with two joints.
        lost: words for the effects that MJCF does not have, for the first comment.

    Raises:
        RobotError: a body without a physical inertia.
    """
    model, root = chain.model, ElementTree.Element("mujoco", model=chain.name)
    note = f" Written by pinadapt {__version__}. The chain alone, without shapes. "
    note += f"{chain.remark} " if chain.remark else ""
    note += f"MJCF does not have: {lost}. " if lost else ""
    root.append(ElementTree.Comment(note.replace("--", "- -")))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", gravity=digits(model.gravity.linear))
    body, taken = ElementTree.SubElement(root, "worldbody"), {chain.frame, "world"}
    motors = ElementTree.Element("actuator")
    efforts = effort_limits(model)
    for joint, name in enumerate(chain.joint_names, 1):
        link = free_name(links_of(model, joint)[0], taken)
        at = _at(model.jointPlacements[joint])
        body = ElementTree.SubElement(body, "body", {"name": link, **at})
        _write_inertia(body, model.inertias[joint], name)
        _write_joint(body, chain, joint)
        motor = ElementTree.SubElement(motors, "motor", name=f"{name}_motor", joint=name)
        if np.isfinite(effort := efforts[joint - 1]):
            motor.set("ctrlrange", digits([-effort, effort]))
    tip = chain.tip
    ElementTree.SubElement(body, "site", {"name": chain.frame, **_at(tip.placement)})
    tendons = ElementTree.Element("tendon")
    for shaft in shafts:
        fixed = ElementTree.SubElement(tendons, "fixed", name=shaft.name)
        numbers = (
            ("damping", shaft.viscous),
            ("frictionloss", shaft.coulomb),
            ("armature", shaft.armature),
        )
        for attribute, number in numbers:
            fixed.set(attribute, digits([number]))
        for joint_name, factor in zip(shaft.joints, shaft.factors, strict=True):
            ElementTree.SubElement(fixed, "joint", joint=joint_name, coef=digits([factor]))
    for name, torque in zip(chain.joint_names, offset, strict=True):
        if torque:
            constant = {"name": f"{name}_offset", "joint": name, "biastype": "affine"}
            constant |= {"gainprm": "0", "biasprm": digits([-torque, 0.0, 0.0])}
            ElementTree.SubElement(motors, "general", constant)
    root.extend([part for part in (tendons, motors) if len(part)])
    ElementTree.indent(root)
    return xml_text(root) + "\n"


def _at(placement: pin.SE3) -> dict[str, str]:
    """Return the attributes pos and quat (wxyz) of a placement."""
    x, y, z, w = pin.SE3ToXYZQUAT(placement)[3:]
    return {"pos": digits(placement.translation), "quat": digits([w, x, y, z])}


def _write_inertia(body: ElementTree.Element, inertia: pin.Inertia, joint: str) -> None:
    """Write mass, centre of mass and inertia about it.

    Raises:
        RobotError: the inertia is not physical.
    """
    if not is_physical(np.array(inertia.toDynamicParameters())):
        raise RobotError(
            f"the inertia of the body that joint '{joint}' moves is not physical: no distribution "
            "of mass has it, and MuJoCo refuses it.",
            where="mjcf",
        )
    matrix = inertia.inertia
    full = [matrix[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    ElementTree.SubElement(
        body,
        "inertial",
        pos=digits(inertia.lever),
        mass=digits([inertia.mass]),
        fullinertia=digits(full),
    )


def _write_joint(body: ElementTree.Element, chain: WrittenChain, joint: int) -> None:
    """Write the joint that moves a body."""
    model, name = chain.model, chain.joint_names[joint - 1]
    lower, upper = (limit[joint - 1] for limit in position_limits(model))
    written = {
        "name": name,
        "type": "slide" if is_slide(model.joints[joint]) else "hinge",
        "axis": digits(axis_of(model, joint)),
        "damping": digits([chain.viscous[joint - 1]]),
        "frictionloss": digits([chain.coulomb[joint - 1]]),
        "armature": digits([model.armature[joint - 1]]),
    }
    if model.joints[joint].nq == 1 and -_LARGEST < lower < upper < _LARGEST:
        written["range"] = digits([lower, upper])
    ElementTree.SubElement(body, "joint", written)
