"""Writing a chain as MJCF, the format of MuJoCo: bodies, joints with friction, and motors."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .._version import __version__
from ..exceptions import RobotError
from .chain import effort_limits, is_physical, is_slide, links_of, position_limits
from .urdf import xml_text
from .urdf_writer import WrittenChain, axis_of, digits, free_name

_LARGEST = 1e3  # [rad or m] position limits beyond which there are none


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
    return xml_text(root, chain.name) + "\n"


def _at(placement: pin.SE3) -> dict[str, str]:
    """Return the attributes pos and quat (wxyz) of a placement."""
    x, y, z, w = pin.SE3ToXYZQUAT(placement)[3:]
    return {"pos": digits(placement.translation), "quat": digits([w, x, y, z])}


def _write_inertia(body: ElementTree.Element, inertia: pin.Inertia, joint: str) -> None:
    """Write mass, centre of mass and inertia about it.

    Raises:
        RobotError: no body has them.
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
