"""The shapes of a description as meshcat draws them, lighter where a page could not hold them.

Every mesh is held once, however often it is shown. Where all of them are too heavy together, the
heaviest lose triangles, texture and the colours of their parts, until they fit.
"""

from __future__ import annotations

import gzip
from typing import Any

import coal
import fast_simplification
import meshcat
import numpy as np
import pinocchio as pin
from meshcat.geometry import MeshPhongMaterial, TriangularMeshGeometry

from .artist import Artist
from .keyframes import Node
from .window import Window

BUDGET = 4.6e6  # [bytes] roughly packed; a page takes up to four thirds of that in its text
_TRIANGLE = 25.0  # [bytes] of one, packed


class _Tray(Window):
    """Messages by the number of the shape that they draw."""

    def __init__(self) -> None:
        self.shape = 0
        self.messages: dict[int, tuple[Any, bytes]] = {}

    def keep(self, key: Any, message: bytes) -> None:
        self.messages[self.shape] = key, message


def draw_shapes(root: Node, visual: pin.GeometryModel, model: pin.Model) -> None:
    """Draw each shape k at ``joint i/shape k`` below a node, its joint i."""
    visual, tray = visual.copy(), _Tray()
    artist = Artist(model, None, visual)
    artist.initViewer(viewer=meshcat.Visualizer.view_into(tray, root.path))
    first: dict[Any, Node] = {}
    copies: list[tuple[Node, Node]] = []
    shapes = list(visual.geometryObjects)
    for number, shape in enumerate(shapes):
        place = root[f"joint {shape.parentJoint}"][f"shape {number}"]
        place.set_transform(scaled_placement(shape))
        mesh = shape.meshPath, tuple(shape.meshColor), shape.overrideMaterial
        if shape.meshPath and mesh in first:
            copies.append((first[mesh], place))
            continue
        first[mesh] = place
        tray.shape, shape.name = number, f"shape {number}"
        artist.viewerVisualGroupName = f"joint {shape.parentJoint}"
        artist.loadViewerGeometryObject(shape, pin.GeometryType.VISUAL)
    _fit(root, tray, shapes)
    for key, message in tray.messages.values():
        root.window.keep(key, message)
    for source, target in copies:
        root.window.copy(source, target)


def scaled_placement(shape: pin.GeometryObject) -> np.ndarray:
    """Return where a shape is, in its joint's axes, with its scale (4, 4) [m]."""
    return np.asarray(shape.placement.homogeneous @ np.diag([*shape.meshScale, 1.0]))


def _fit(root: Node, tray: _Tray, shapes: list[pin.GeometryObject]) -> None:
    """Make the heaviest meshes lighter until all fit."""
    weights = {number: _weight(message) for number, (_, message) in tray.messages.items()}
    excess = sum(weights.values()) - BUDGET
    most = int(BUDGET / (_TRIANGLE * max(len(weights), 1)))
    for number in sorted(weights, key=lambda k: -weights[k]):
        if excess <= 0.0:
            break
        shape = shapes[number]
        if isinstance(shape.geometry, coal.BVHModelBase):
            tray.shape, node = number, root[f"joint {shape.parentJoint}"][shape.name]
            place = meshcat.Visualizer.view_into(tray, node.path)
            place.set_object(_lighter(shape, most), _material(shape))
            excess -= weights[number] - _weight(tray.messages[number][1])


def _weight(message: bytes) -> int:
    """Return roughly how much of a page a message takes [bytes]."""
    return len(gzip.compress(message, compresslevel=1))


def _lighter(shape: pin.GeometryObject, most: int) -> TriangularMeshGeometry:
    """Return the triangles of a mesh before its scale, about so many at most."""
    mesh = shape.geometry
    vertices = np.array(mesh.vertices(), dtype=np.float32) / np.asarray(shape.meshScale)
    corners = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    faces = np.array([[corner[0], corner[1], corner[2]] for corner in corners], dtype=np.int32)
    if len(faces) > most:
        vertices, faces = fast_simplification.simplify(
            vertices.astype(np.float32), faces, target_count=most
        )
    return TriangularMeshGeometry(vertices, faces)


def _material(shape: pin.GeometryObject) -> MeshPhongMaterial:
    red, green, blue = (int(255 * part) for part in shape.meshColor[:3])
    return MeshPhongMaterial(color=red << 16 | green << 8 | blue, flatShading=True)
