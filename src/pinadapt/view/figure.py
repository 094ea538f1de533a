"""One robot of a scene: its own shapes, or a stick figure, and its tool."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from meshcat.geometry import Cylinder, Material, Sphere

from .artist import Artist
from .keyframes import Keyframes, Node
from .motion import Motion
from .page import Page
from .shapes import rod


@dataclass(frozen=True, eq=False)
class Figure:
    """How one robot is drawn, below one node.

    Attributes:
        node: the robot's root in the scene.
        motion: where its joints are.
        keys: the moments.
        size: a length of the whole scene, to which thicknesses are relative [m].
    """

    node: Node
    motion: Motion
    keys: Keyframes
    size: float

    def joint(self, index: int) -> Node:
        """Return the node that moves with a joint; 0 is the base."""
        return self.node[f"joint {index}"]

    def move(self) -> None:
        """Let every joint's node follow the motion."""
        for index in range(self.motion.joints.shape[1]):
            self.keys.move_rigidly(self.joint(index), self.motion.joints[:, index])

    def add_visuals(self, visual: pin.GeometryModel, model: pin.Model) -> None:
        """Draw the shapes of a description, in their own colours."""
        visual = visual.copy()
        artist = Artist(model, None, visual)
        artist.initViewer(viewer=self.node)
        for index, shape in enumerate(visual.geometryObjects):
            artist.viewerVisualGroupName = f"joint {shape.parentJoint}"
            shape.name = f"shape {index}"
            artist.loadViewerGeometryObject(shape, pin.GeometryType.VISUAL)
            stretch = np.diag([*shape.meshScale, 1.0])
            self.joint(shape.parentJoint)[shape.name].set_transform(
                shape.placement.homogeneous @ stretch
            )

    def share_visuals(self, other: Figure, visual: pin.GeometryModel, page: Page) -> None:
        """Draw the shapes of another figure, in the ghost's material; the page holds them once."""
        for index, shape in enumerate(visual.geometryObjects):
            place = f"joint {shape.parentJoint}/shape {index}"
            self.node[place].set_transform(
                shape.placement.homogeneous @ np.diag([*shape.meshScale, 1.0])
            )
            page.show_as_ghost(other.node[place].path.lower(), self.node[place].path.lower())

    def stick_figure(
        self, material: Material, thickness: float, joints: Iterable[int] | None = None
    ) -> None:
        """Draw a sphere at each of the joints, by default all, and a rod to it from its parent."""
        ball = Sphere(1.6 * thickness * self.size)
        for index in range(len(self.motion.parents)) if joints is None else joints:
            self.joint(index)["ball"].set_object(ball, material)
            parent = self.joint(self.motion.parents[index])
            self._rod(parent[f"rod {index}"], self.motion.origins[:, index], material, thickness)

    def tool(self, material: Material, thickness: float) -> None:
        """Draw a rod from the last joint to the tool, and a sphere there."""
        carrier = self.joint(self.motion.last)
        self._rod(carrier["tool"], self.motion.tool, material, thickness)
        carrier["tip"].set_object(Sphere(2.4 * thickness * self.size), material)
        self.keys.move(carrier["tip"], self.motion.tool)

    def _rod(self, node: Node, ends: np.ndarray, material: Material, thickness: float) -> None:
        if np.abs(ends).max() > 1e-6:
            node.set_object(Cylinder(1.0), material)
            self.keys.move(node, *rod(ends, thickness * self.size))
