"""One robot of a scene: its own shapes, or a stick figure, its tool and what it carries."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from meshcat.geometry import Cylinder, Material, Sphere

from ..robot.robot import Robot
from .keyframes import Node, Poses
from .meshes import draw_shapes, scaled_placement
from .motion import Motion
from .shapes import rod
from .window import Window

_STEEL = 7850.0  # [kg/m^3]


class Figure:
    """How one robot is drawn, below one node: first what there is, then where it is.

    Attributes:
        node: the robot's root in the scene.
        robot: whose joints and shapes these are.
        size: a length of the whole scene, to which thicknesses are relative [m].
    """

    def __init__(self, node: Node, robot: Robot, size: float) -> None:
        """Draw nothing yet."""
        self.node, self.robot, self.size = node, robot, size
        self._last = int(robot.model.frames[robot.frame_id].parentJoint)
        self._rods: list[tuple[Node, int | None, float]] = []

    def joint(self, index: int) -> Node:
        """Return the node that moves with a joint; 0 is the base."""
        return self.node[f"joint {index}"]

    def place(self, motion: Motion, poses: Poses) -> None:
        """Move everything to where the motion has it."""
        for index in range(motion.joints.shape[1]):
            poses.move_rigidly(self.joint(index), motion.joints[:, index])
        for node, end, radius in self._rods:
            ends = motion.tool if end is None else motion.origins[:, end]
            poses.move(node, *rod(ends, radius))
        poses.move(self.joint(self._last)["tip"], motion.tool)

    def add_visuals(self, visual: pin.GeometryModel) -> None:
        """Draw the shapes of a description, in their own colours."""
        draw_shapes(self.node, visual, self.robot.model)

    def share_visuals(self, other: Figure, visual: pin.GeometryModel, window: Window) -> None:
        """Draw the shapes of another figure, in the ghost's material; the page holds them once."""
        for index, shape in enumerate(visual.geometryObjects):
            place = self._shape(index, shape)
            place.set_transform(scaled_placement(shape))
            window.copy(other._shape(index, shape), place, as_ghost=True)

    def stick_figure(
        self, material: Material, thickness: float, joints: Iterable[int] | None = None
    ) -> None:
        """Draw a sphere at each of the joints, by default all, and a rod to it from its parent."""
        ball = Sphere(1.6 * thickness * self.size)
        parents = [int(parent) for parent in self.robot.model.parents]
        for index in range(len(parents)) if joints is None else joints:
            self.joint(index)["ball"].set_object(ball, material)
            if index:
                self._rod(self.joint(parents[index])[f"rod {index}"], index, material, thickness)

    def tool(self, material: Material, thickness: float) -> None:
        """Draw a rod from the last joint to the tool, and a sphere there."""
        carrier = self.joint(self._last)
        self._rod(carrier["tool"], None, material, thickness)
        carrier["tip"].set_object(Sphere(2.4 * thickness * self.size), material)

    def load(self, number: int) -> Node:
        """Return the node of the loads of a robot, one of those that follow each other."""
        return self.joint(self._last)[f"load {number}"]

    def add_loads(self, number: int, loads: Iterable[pin.Inertia], material: Material) -> None:
        """Draw each load (axes of the last joint) as a ball of steel of its mass."""
        for k, load in enumerate(loads):
            ball = self.load(number)[f"{k}"]
            ball.set_object(Sphere(float(np.cbrt(0.75 / np.pi * load.mass / _STEEL))), material)
            place = np.eye(4)
            place[:3, 3] = load.lever
            ball.set_transform(place)

    def _shape(self, number: int, shape: pin.GeometryObject) -> Node:
        return self.joint(int(shape.parentJoint))[f"shape {number}"]

    def _rod(self, node: Node, index: int | None, material: Material, thickness: float) -> None:
        node.set_object(Cylinder(1.0), material)
        self._rods.append((node, index, thickness * self.size))
