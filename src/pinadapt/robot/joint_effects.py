"""Damping, friction and rotor inertia of joints, as a description states them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .xml_file import parse_xml

if TYPE_CHECKING:
    from .robot import Robot


def described_effects(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rotor inertias, viscous and Coulomb friction (nv) of a robot's description.

    The rotor inertia is the model's, or that of the attribute ``armature`` of a URDF's <dynamics>,
    which ``Robot.urdf`` writes.
    """
    model = robot.model
    armature = np.array(model.armature, dtype=float)
    if robot.origin is not None:
        root = parse_xml(robot.origin.urdf.text, robot.name)
        stated = {
            joint.get("name", ""): float(dynamics.get("armature", "nan"))
            for joint in root.findall("joint")
            for dynamics in joint.findall("dynamics")
        }
        given = np.array([stated.get(name, np.nan) for name in robot.joint_names])
        armature = np.where(np.isnan(given), armature, given)
    return armature, np.array(model.damping), np.array(model.friction)
