"""What is drawn of the contacts of a robot that stands: friction cones, soles, chosen forces."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from meshcat.geometry import Box, Cylinder
from scipy.spatial.transform import Rotation

from ..controller.controller import Controller
from ..controller.state import Sample
from ..exceptions import ImplausibleError
from ..robot.robot import Robot
from .drawing import CONE, FORCE, Keyframes, Node, overlay, rod

HIDDEN = 1e-4  # scale of what is too small to be seen; half or twice: neither is


def chosen_forces(
    controller: Controller, samples: Sequence[Sample], frames: Sequence[int] | np.ndarray = (0,)
) -> np.ndarray:
    """Return the forces and torques (N, c, 6) that a controller chose, see ``contact_forces``.

    Zero at a sample that it had to bridge, and at one without a torque, whose state is not its own.

    Args:
        controller: the controller.
        samples: N of them; for none the row of one is returned.
        frames: those that are asked for; the others are zero.
    """
    found = np.zeros((max(len(samples), 1), len(controller.kinematics.robot.contacts), 6))
    for k in frames if len(samples) and found.size else ():
        s = samples[k]
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
        self._contacts, self._size = robot.contacts, size
        weight = robot.mass * np.linalg.norm(robot.model.gravity.linear)
        self._length = size / weight if weight else 0.0
        self._nodes = [node[contact.frame] for contact in robot.contacts]
        for contact, own in zip(robot.contacts, self._nodes, strict=True):
            own["cone"].set_object(Cylinder(1.0, 0.0, 1.0, 0.0), overlay(0.3, CONE))
            own["force"].set_object(Cylinder(1.0, 0.0, 0.0, 1.0), overlay(1.0, FORCE))
            if contact.sole is not None:
                sole = [2.0 * half for half in contact.sole]
                own["sole"].set_object(Box([*sole, 0.01 * size]), overlay(0.5, CONE))

    def place(self, places: np.ndarray, forces: np.ndarray, poses: Keyframes) -> None:
        """Move everything to the contacts' placements (F, c, 4, 4) and forces (F, c, 6)."""
        parts: Any = self._contacts, self._nodes, places.swapaxes(0, 1), forces.swapaxes(0, 1)
        for contact, node, place, force in zip(*parts, strict=True):
            at, f, m = place[:, :3, 3], force[:, :3], force[:, 3:]
            normal = np.broadcast_to([0.0, 0.0, 1.0], at.shape)
            if contact.sole is not None:
                normal = place[:, :3, 2]
                poses.move(node["sole"], at, Rotation.from_matrix(place[:, :3, :3]))
            bears = (f * normal).sum(axis=1, keepdims=True)
            stands = np.where(bears > 0.0, 1.0, HIDDEN)
            pressed = at + np.cross(normal, m) / np.where(bears > 0.0, bears, 1.0)
            height = 0.25 * self._size * stands
            ends = pressed + height * normal
            poses.move(node["cone"], *rod(pressed, ends, contact.friction * height))
            thick = 0.03 * self._size * stands
            poses.move(node["force"], *rod(pressed, pressed + self._length * f, thick))
