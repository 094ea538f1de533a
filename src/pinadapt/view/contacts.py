"""What is drawn of the contacts of a robot that stands: friction cones, soles, chosen forces."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from meshcat.geometry import Box, Cylinder
from scipy.spatial.transform import Rotation

from .._checks import ROUNDING
from ..controller.controller import Controller
from ..controller.state import Sample
from ..description.chain import frame_named
from ..exceptions import ImplausibleError
from ..robot.robot import Robot
from .drawing import Colour, Keyframes, Node, overlay, rod

HIDDEN = ROUNDING  # scale of what is not seen


def chosen_forces(controller: Controller, samples: Sequence[Sample]) -> np.ndarray:
    """Return the forces and torques (N, c, 6) that a controller chose, see ``contact_forces``.

    Zero at a sample that it had to bridge, and at one without a torque, whose state is not its own.
    """
    found = np.zeros((len(samples), len(controller.kinematics.robot.contacts), 6))
    for k, s in enumerate(samples if found.size else ()):
        if np.isfinite(s.torque).all():
            with suppress(ImplausibleError):
                found[k] = controller.contact_forces(s.state, s.measurement, s.desired)
    return found


class DrawnContacts:
    """The contacts in the scene, below one node; the weight is as long as half of the picture."""

    def __init__(self, node: Node, robot: Robot, size: float) -> None:
        """Draw soles, friction cones, and spikes for the forces.

        Args:
            node: root of the contacts.
            robot: that stands on them.
            size: half of the picture [m].
        """
        self._node = node
        self._robot = robot
        self._size = size
        self._length = size / max(robot.mass * np.linalg.norm(robot.model.gravity.linear), 1e-9)
        for contact in robot.contacts:
            own = node[contact.frame]
            own["cone"].set_object(Cylinder(1.0, 0.0, 1.0, 0.0), overlay(0.3, Colour.CONE))
            own["force"].set_object(Cylinder(1.0, 0.0, 0.0, 1.0), overlay(1.0, Colour.FORCE))
            if contact.sole is not None:
                length, width = contact.sole
                own["sole"].set_object(
                    Box([2 * length, 2 * width, 0.01]), overlay(0.5, Colour.CONE)
                )

    def place(self, motion: np.ndarray, forces: np.ndarray, poses: Keyframes) -> None:
        """Move everything to where a motion of the robot has it, with forces (F, c, 6)."""
        for contact, force in zip(self._robot.contacts, forces.swapaxes(0, 1), strict=True):
            node = self._node[contact.frame]
            frame = frame_named(self._robot.model, contact.frame)
            moved = motion[:, frame.parentJoint] @ frame.placement.homogeneous
            at = moved[:, :3, 3]
            f, m = np.split(force, 2, axis=1)
            normal = np.eye(3)[2]
            if contact.sole is not None:
                normal = moved[:, :3, 2]
                poses.move(node["sole"], at, Rotation.from_matrix(moved[:, :3, :3]))
            bears = (f * normal).sum(axis=1, keepdims=True)
            size = self._size * np.where(bears > 0.0, 1.0, HIDDEN)
            pressed = at + np.cross(normal, m) / np.maximum(bears, 1e-9)
            high = 0.25 * size
            poses.move(
                node["cone"], *rod(pressed, pressed + high * normal, contact.friction * high)
            )
            poses.move(node["force"], *rod(pressed, pressed + self._length * f, 0.03 * size))
