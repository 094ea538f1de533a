"""MJCF, the format of MuJoCo: files read with Pinocchio, and chains written."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .chain import (
    Closures,
    Mimics,
    axis_of,
    check_physical,
    effort_limits,
    frame_id,
    frame_named,
    is_slide,
    links_of,
    position_limits,
)
from .floating_base import BASE_JOINTS
from .urdf import built_shapes, check_numbers, xml_text
from .urdf_writer import digits, first_comment, free_name

_COMPILED = (
    "Let MuJoCo write the compiled model as one plain file: spec = mujoco.MjSpec.from_file(path); "
    "spec.compiler.saveinertial = True; spec.compile(); spec.to_xml()."
)
# Pinocchio ignores these elements without an error; the model would be wrong.
_SKIPPED = ("include", "attach", "replicate", "composite", "flexcomp", "frame", "plugin")
# Pinocchio does not compute the inertia of these shapes.
_NO_INERTIA = ("mesh", "ellipsoid", "hfield", "sdf")
_ROWS = {"connect": 3, "weld": 6}  # coordinates that a loop closes
_NUMBERS = (
    *("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "axis", "range", "ref", "fromto"),
    *("size", "mass", "density", "diaginertia", "fullinertia", "armature", "gravity", "qpos"),
    *("damping", "frictionloss", "scale", "actuatorfrcrange", "anchor", "relpose"),
)


@dataclass(frozen=True)
class Mjcf:
    """An MJCF file of which Pinocchio ignores nothing that changes the model.

    Attributes:
        path: the file.
        root: its root element, without each <equality> that is not active, and those of mocap
            bodies, which are no part of a robot.
    """

    path: Path
    root: ElementTree.Element

    @classmethod
    def read(cls, path: Path, root: ElementTree.Element) -> Mjcf:
        """Check the root element of a file. It is data, which runs nothing.

        Raises:
            RobotError: an element that Pinocchio would ignore, text in place of a number, or a
                negative mass.
        """
        for element in root.iter():
            check_numbers(element, _NUMBERS, None, path)
        for flaw in _flaws(root):
            raise RobotError(f"{flaw}.", where=path, hint=_COMPILED)
        mocap = {body.get("name") for body in root.iter("body") if body.get("mocap") == "true"}
        others = (body.get("name") for body in root.findall("worldbody/body")[1:])
        if names := ", ".join(f"'{name}'" for name in others if name not in mocap):
            warnings.warn(
                f"{path}: Pinocchio reads the first body of <worldbody> alone, without {names}. "
                "Put them into one body.",
                stacklevel=3,
            )
        for equality in root.findall("equality"):
            for part in list(equality):
                ends = {part.get("body1"), part.get("body2")}
                if part.get("active") == "false" or mocap & ends:
                    equality.remove(part)
        return cls(path, root)

    @property
    def mimics(self) -> Mimics:
        """The joints that an <equality> couples to others."""
        found = {}
        for part in self.root.findall("equality/joint"):
            offset, ratio, *_ = map(float, [*part.get("polycoef", "0 1").split(), "0"])
            found[part.get("joint1", "")] = part.get("joint2", ""), ratio, offset
        return found

    @property
    def _loops(self) -> list[ElementTree.Element]:
        """The elements <connect> and <weld>."""
        return [part for part in self.root.findall("equality/*") if part.tag in _ROWS]

    @property
    def closures(self) -> Closures:
        """The frames of the loops: their sites, or frames that ``model`` adds."""
        return tuple(
            (loop.get("site1", f"loop_{i}_a"), loop.get("site2", f"loop_{i}_b"), _ROWS[loop.tag])
            for i, loop in enumerate(self._loops)
        )

    def passive(self, model: pin.Model) -> tuple[str, ...]:
        """Return the joints that no actuator moves; none if the file has no actuators of joints."""
        driven = _driven(self.root, self.mimics)
        names = model.names[1:] if driven else ()
        return tuple(name for name in names if name not in driven)

    def model(self) -> pin.Model:
        """Build the model, with frames where loops are closed, which meet at the pose "qpos0".

        A warning names the motors without ``actuatorfrcrange``: ranges of actuators are not read.

        Raises:
            RobotError: Pinocchio cannot read it, or a loop is of bodies that it does not have.
        """
        try:
            model = pin.buildModelFromMJCF(str(self.path))
        except Exception as error:
            raise RobotError(
                f"Pinocchio cannot read this MJCF file: {' '.join(str(error).split())}",
                where=self.path,
                hint=_COMPILED,
            ) from error
        driven = _driven(self.root, self.mimics)
        efforts = effort_limits(model)[model.idx_vs[1:]]
        named = zip(model.names[1:], np.isfinite(efforts), strict=True)
        if unlimited := [name for name, limited in named if name in driven and not limited]:
            warnings.warn(
                f"{self.path}: no actuatorfrcrange, taken as unlimited: {', '.join(unlimited)}.",
                stacklevel=3,
            )
        for option in self.root.findall("option[@gravity]"):
            model.gravity.linear = np.array(option.get("gravity", "").split(), dtype=float)
        data = model.createData()
        pin.framesForwardKinematics(model, data, model.referenceConfigurations["qpos0"])
        for names, loop in zip(self.closures, self._loops, strict=True):
            if loop.get("site1") is not None:
                continue
            bodies = [
                frame_id(model, "universe" if body == "world" else body)
                for body in (loop.get("body1", "world"), loop.get("body2", "world"))
            ]
            for name, body, at in zip(names, bodies, _meeting(loop, data, *bodies), strict=False):
                carrier = model.frames[body]
                frame = pin.Frame(
                    name,
                    carrier.parentJoint,
                    body,
                    carrier.placement * at,
                    pin.FrameType.SENSOR,  # no end of a chain
                )
                model.addFrame(frame, False)
        return model

    def geometry(self, model: pin.Model, kind: pin.GeometryType) -> pin.GeometryModel:
        """Return the visual or collision geometry; nothing, and a warning, if a mesh is missing."""
        return built_shapes(self.path, pin.buildGeomFromMJCF, model, str(self.path), kind)


def keyframe(model: pin.Model) -> np.ndarray:
    """Return the configuration (nq) of the keyframe "home", else of the first, else the neutral."""
    poses = {pose.key(): pose.data() for pose in model.referenceConfigurations}
    first = next(iter(poses.values()), pin.neutral(model))
    return np.array(poses.get("home", first))


def _flaws(root: ElementTree.Element) -> Iterator[str]:
    """Yield what Pinocchio would ignore or misread."""
    for element in root.iter():
        if element.tag in _SKIPPED:
            yield f"Pinocchio does not read <{element.tag}>"
        if float(element.get("mass", "0")) < 0.0:
            yield f"<{element.tag}> has a negative mass, {element.get('mass')} kg"
    if root.find(".//default/equality[@active]") is not None:
        yield "a default says whether an <equality> is active; it is not read"
    jointed = [*root.findall(".//body[joint]"), *root.findall(".//body[freejoint]")]
    moving = {each for body in jointed for each in body.iter("body")}
    for body in root.iter("body"):
        if not body.get("name"):
            yield "a <body> has no name; Pinocchio ignores such bodies and all that they carry"
        shapes = [g for g in body.findall("geom") if "0" not in (g.get("mass"), g.get("density"))]
        unknown = any(g.get("mesh") is not None or g.get("type") in _NO_INERTIA for g in shapes)
        if body in moving and body.find("inertial") is None and unknown:
            yield (
                f"body '{body.get('name')}' has no <inertial>, and Pinocchio does not compute the "
                "inertia of its shapes"
            )


def _driven(root: ElementTree.Element, coupled: Mimics) -> set[str | None]:
    """Return the joints that actuators move, by themselves or a tendon, and whom these follow."""
    actuators = root.findall("actuator/*")
    found = {each.get(word) for each in actuators for word in ("joint", "jointinparent")}
    tendons = {each.get("tendon") for each in actuators} - {None}
    for tendon in root.findall("tendon/fixed"):
        if tendon.get("name") in tendons:
            found |= {joint.get("joint") for joint in tendon.findall("joint")}
    found |= {leader for joint, (leader, *_) in coupled.items() if joint in found}
    return found - {None}


def _meeting(loop: ElementTree.Element, data: pin.Data, a: int, b: int) -> tuple[pin.SE3, pin.SE3]:
    """Return where a loop is closed in its bodies' frames a and b, placed as at "qpos0"."""
    between = data.oMf[a].actInv(data.oMf[b])
    if loop.tag == "connect":
        at = pin.SE3(np.eye(3), np.array(loop.get("anchor", "0 0 0").split(), dtype=float))
        return at, between.actInv(at)
    pose = np.array(loop.get("relpose", "0 1 0 0 0 0 0").split(), dtype=float)
    w, *xyz = pose[3:]
    return pin.XYZQUATToSE3([*pose[:3], *xyz, w]) if pose[3:].any() else between, pin.SE3.Identity()


def mjcf_text(robot: Any, *, free_joint: bool = True) -> str:
    """Return the text of an MJCF file of the chain of a ``Robot`` alone, without shapes.

    Joints have limits, ``damping``, ``frictionloss`` and ``armature``; each has a motor, limited to
    its effort. Task frames and contacts are sites. A free base has a free joint; without
    ``free_joint`` the six joints of the model.

    Raises:
        RobotError: a body without a physical inertia.
    """
    model = robot.model
    friction = robot.friction
    root = ElementTree.Element("mujoco", model=robot.name)
    words = "The chain alone, without shapes."
    shafts = (shaft.name(robot.joint_names) for shaft in friction.shafts)
    if lost := ", ".join([*friction.special, *shafts, *map(str, robot.constraints)]):
        words += f" Not in this file: {lost}."
    root.append(first_comment(robot, words))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", gravity=digits(model.gravity.linear))
    sites = dict.fromkeys([*robot.frames, *(contact.frame for contact in robot.contacts)])
    taken = {*sites, "world"}
    base = ElementTree.SubElement(root, "worldbody")
    if list(model.parents)[1:].count(0) > 1:  # of several bodies at the base one would be read
        base = ElementTree.SubElement(base, "body", name=free_name("base", taken))
    bodies = [base]
    motors = ElementTree.Element("actuator")
    columns = zip(*position_limits(model), effort_limits(model), strict=True)
    for index, (name, (low, high, effort)) in enumerate(
        zip(robot.joint_names, columns, strict=True), 1
    ):
        if name in BASE_JOINTS[:-1] and free_joint:
            bodies.append(base)
            continue
        body = ElementTree.SubElement(
            bodies[model.parents[index]],
            "body",
            {
                "name": free_name(links_of(model, index)[0], taken),
                **_at(model.jointPlacements[index]),
            },
        )
        bodies.append(body)
        _write_inertia(body, model.inertias[index])
        if name in BASE_JOINTS and free_joint:
            ElementTree.SubElement(body, "freejoint", name=free_name("free_base", taken))
            continue
        joint = ElementTree.SubElement(
            body,
            "joint",
            name=name,
            type="slide" if is_slide(model.joints[index]) else "hinge",
            axis=digits(axis_of(model, index)),
            damping=digits(friction.viscous[index - 1]),
            frictionloss=digits(friction.coulomb[index - 1]),
            armature=digits(model.armature[index - 1]),
        )
        if np.isfinite([low, high]).all():
            joint.set("range", digits([low, high]))
        motor = ElementTree.SubElement(motors, "motor", name=f"{name}_motor", joint=name)
        if np.isfinite(effort):
            motor.set("ctrlrange", digits([-effort, effort]))
            joint.set("actuatorfrcrange", digits([-effort, effort]))  # as robots are read
    for name in sites:
        frame = frame_named(model, name)
        ElementTree.SubElement(
            bodies[frame.parentJoint], "site", {"name": name, **_at(frame.placement)}
        )
    root.append(motors)
    ElementTree.indent(root)
    return xml_text(root) + "\n"


def _at(placement: pin.SE3) -> dict[str, str]:
    """Return the attributes pos and quat (wxyz) of a placement."""
    x, y, z, w = pin.SE3ToXYZQUAT(placement)[3:]
    return {"pos": digits(placement.translation), "quat": digits([w, x, y, z])}


def _write_inertia(body: ElementTree.Element, inertia: pin.Inertia) -> None:
    """Write mass, centre of mass and inertia about it.

    Raises:
        RobotError: the inertia is not physical.
    """
    check_physical(inertia, body.get("name", ""), "mjcf")
    moments = inertia.inertia
    ElementTree.SubElement(
        body,
        "inertial",
        pos=digits(inertia.lever),
        mass=digits(inertia.mass),
        fullinertia=digits([*np.diag(moments), *moments[np.triu_indices(3, 1)]]),
    )
