"""What meshcat is given: messages for a window, materials, shapes and their places.

A message is a meshcat command in its wire format, or a note to the page in JSON. Only a note begins
with a brace, which distinguishes the two.
"""

from __future__ import annotations

import gzip
import json
import warnings
import xml.etree.ElementTree as ElementTree
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, TypeAlias

import coal
import fast_simplification
import meshcat
import numpy as np
import pinocchio as pin
import umsgpack
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from meshcat.geometry import MeshLambertMaterial, MeshPhongMaterial, TriangularMeshGeometry
from pinocchio.visualize import MeshcatVisualizer
from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry
from scipy.spatial.transform import Rotation

# From the palette of Okabe and Ito, which colour-blind readers can distinguish.
TRUE, ESTIMATED, DESIRED, LOAD, BONES = 0xD55E00, 0x0072B2, 0x009E73, 0xE69F00, 0x5A6472


class Window(ABC):
    """Receives the commands of ``meshcat.Visualizer(window=...)``, and notes to the page."""

    def send(self, command: Any) -> None:
        """Receive a meshcat command."""
        lowered = command.lower()
        key = lowered["type"], lowered["path"], lowered.get("property")
        self.keep(key, umsgpack.packb(lowered, force_float_precision="single"))

    def note(self, key: Any, **content: Any) -> None:
        """Add a note to the page, with keys that the function ``note`` of ``page.html`` handles."""
        self.keep(("note", key), json.dumps(content, allow_nan=False).encode())

    def copy(self, source: Node, target: Node, *, as_ghost: bool = False) -> None:
        """Draw the object of one node at another node too, on request in the ghost's material."""
        paths = {"source": source.path.lower(), "target": target.path.lower()}
        self.note(paths["target"], copy={**paths, "ghost": as_ghost})

    @abstractmethod
    def keep(self, key: Any, message: bytes) -> None:
        """Store a message; one with the same ``key`` as an earlier message replaces it."""


def framed(message: bytes) -> bytes:
    """Return a message preceded by its length in 4 bytes, as the page reads it."""
    return len(message).to_bytes(4, "big") + message


_SIDES = 8  # of a tube


def solid(colour: int) -> MeshLambertMaterial:
    """Return an opaque material."""
    return MeshLambertMaterial(color=colour, emissive=colour, emissiveIntensity=0.35)


def ghost(opacity: float = 0.4, colour: int = ESTIMATED) -> MeshLambertMaterial:
    """Return a translucent material, hidden where a solid one is at about the same place.

    About the same is within half a per cent of the picture's depth, 160 steps of its depth buffer.
    Without that, patches of a robot that is known to a millimetre would appear blue.
    """
    behind: dict[str, Any] = {
        "depthWrite": False,
        "polygonOffset": True,
        "polygonOffsetFactor": 4,
        "polygonOffsetUnits": 160,
    }
    return MeshLambertMaterial(
        color=colour, emissive=colour, emissiveIntensity=0.35, opacity=opacity, side=0, **behind
    )


def tube(points: np.ndarray, radius: float) -> TriangularMeshGeometry:
    """Return a tube along points (N, 3) [m], N >= 2: one prism per step, in order of the path."""
    steps = np.diff(points, axis=0)
    along = steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-12)
    aside = np.cross(along, np.where(np.abs(along[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-12)
    angle = 2.0 * np.pi * np.arange(_SIDES)[None, :, None] / _SIDES
    ring = radius * (
        np.cos(angle) * aside[:, None] + np.sin(angle) * np.cross(along, aside)[:, None]
    )  # (N-1, sides, 3)
    vertices = np.concatenate([points[:-1, None] + ring, points[1:, None] + ring], axis=1)
    i = np.arange(_SIDES)
    j = (i + 1) % _SIDES
    faces = np.vstack(
        [np.stack([i, j, i + _SIDES], axis=1), np.stack([j, j + _SIDES, i + _SIDES], axis=1)]
    )
    first = 2 * _SIDES * np.arange(len(steps))
    return TriangularMeshGeometry(
        vertices.reshape(-1, 3), (first[:, None, None] + faces).reshape(-1, 3)
    )


def rod(ends: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position (F, 3), quaternion xyzw (F, 4) and scale (F, 3) of rods from 0 to ends.

    A unit cylinder, placed so, is a rod from the origin to ``ends`` (F, 3) [m].
    """
    lengths = np.maximum(np.linalg.norm(ends, axis=1, keepdims=True), 1e-9)
    x, y, z = (ends / lengths).T
    # rotates the y axis, along which the cylinder lies, to (x, y, z)
    quaternion = np.stack([z, np.zeros_like(x), -x, 1.0 + y + 1e-9], axis=1)
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return (
        0.5 * ends,
        quaternion,
        np.hstack([np.full_like(lengths, radius), lengths, np.full_like(lengths, radius)]),
    )


_MESHES = "meshes"


class Artist(MeshcatVisualizer):
    """Pinocchio's visualizer, but Collada meshes only read images from the robot's folder."""

    def loadMeshFromFile(self, shape: pin.GeometryObject) -> Any:  # Pinocchio's name
        """Return a mesh, without images that are missing or outside of the robot's folder."""
        path = Path(shape.meshPath)
        strange = strange_images(path) if path.suffix.lower() == ".dae" else []
        if not strange:
            return super().loadMeshFromFile(shape)
        warnings.warn(
            f"{path}: the images {strange} are missing or outside of the robot's folder, "
            f"{robot_folder(path)}. The mesh is drawn without them.",
            stacklevel=2,
        )
        # meshcat does not read the images that it is given here
        mesh = DaeMeshGeometry(str(path), {Path(name) for name in strange})
        for name in strange:
            mesh.dae_raw = mesh.dae_raw.replace(f">{name}<", "><")
        return mesh


def robot_folder(mesh: Path) -> Path:
    """Return the folder of the robot that a mesh belongs to, with symbolic links resolved.

    That is the mesh's ROS package; else the parent of the nearest folder above it that is called
    "meshes"; else the mesh's own folder.
    """
    folders = mesh.resolve().parents
    for folder in folders:
        if (folder / "package.xml").is_file():
            return folder
    return next((folder.parent for folder in folders if folder.name == _MESHES), folders[0])


def strange_images(mesh: Path) -> list[str]:
    """Return the images of a Collada mesh that are not files inside of its robot's folder.

    Symbolic links are resolved; a URL is not a file.
    """
    here, folder = mesh.parent, robot_folder(mesh)
    strange = set()
    for library in ElementTree.parse(mesh).iter():
        if library.tag.rpartition("}")[2] != "library_images":
            continue
        for element in library.iter():
            name = (element.text or "") if "init_from" in element.tag else ""
            image = (here / name).resolve()
            if name and not (image.is_file() and image.is_relative_to(folder)):
                strange.add(name)
    return sorted(strange)


BUDGET = 4.6e6  # [bytes] of all shapes, compressed; as text in a page they take 4/3 of it
_TRIANGLE = 25.0  # [bytes] of a triangle, compressed


class _Tray(Window):
    """Keeps messages by the number of the shape that they draw."""

    def __init__(self) -> None:
        self.shape = 0
        self.messages: dict[int, tuple[Any, bytes]] = {}

    def keep(self, key: Any, message: bytes) -> None:
        """Keep the message of the present shape, with its key."""
        self.messages[self.shape] = key, message


def draw_shapes(root: Node, visual: pin.GeometryModel, model: pin.Model) -> None:
    """Draw each shape k of joint i at ``joint i/shape k`` below a node."""
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
    """Return the placement of a shape in its joint's axes, times its scale (4, 4) [m]."""
    return np.asarray(shape.placement.homogeneous @ np.diag([*shape.meshScale, 1.0]))


def _fit(root: Node, tray: _Tray, shapes: list[pin.GeometryObject]) -> None:
    """Simplify the largest meshes until all messages are within the budget."""
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
    """Return about how many bytes a message takes in a page."""
    return len(gzip.compress(message, compresslevel=1))


def _lighter(shape: pin.GeometryObject, most: int) -> TriangularMeshGeometry:
    """Return the unscaled triangles of a mesh, simplified to at most about ``most``."""
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


Node: TypeAlias = meshcat.Visualizer

_STILL = 1e-9  # [m or 1] values that change by less get no keyframes
_FINENESS = 2.0**14  # steps per metre, or per 1: rounded numbers compress well


class Poses:
    """Places nodes without animation, at the first of the given poses."""

    def move(
        self,
        node: Node,
        position: np.ndarray,
        quaternion: np.ndarray | None = None,
        scale: np.ndarray | None = None,
    ) -> None:
        """Place a node in its parent's axes.

        Args:
            node: the node.
            position: (F, 3) [m], one for each of F moments.
            quaternion: (F, 4) xyzw; None for no rotation.
            scale: (F, 3); None for no scaling.
        """
        first = np.eye(4)
        if quaternion is not None:
            first[:3, :3] = Rotation.from_quat(quaternion[0]).as_matrix()
        if scale is not None:
            first[:3, :3] *= scale[0]
        first[:3, 3] = position[0]
        node.set_transform(first)

    def move_rigidly(self, node: Node, placements: np.ndarray) -> None:
        """Place a node at placements (F, 4, 4) [m] in its parent's axes."""
        self.move(node, placements[:, :3, 3], Rotation.from_matrix(placements[:, :3, :3]).as_quat())


class Keyframes(Poses):
    """Places nodes at several moments; the viewer interpolates between them."""

    def __init__(self, t: np.ndarray) -> None:
        """Take the moments t (F) [s]; the animation starts at the first."""
        self._times = (t - t[0]).tolist()
        self._animation = Animation()

    def move(
        self,
        node: Node,
        position: np.ndarray,
        quaternion: np.ndarray | None = None,
        scale: np.ndarray | None = None,
    ) -> None:
        """Place a node in its parent's axes at every moment, as ``Poses.move``."""
        super().move(node, position, quaternion, scale)
        self._add(node, "position", "vector3", position)
        self._add(node, "quaternion", "quaternion", quaternion)
        self._add(node, "scale", "vector3", scale)

    def play(self, root: Node) -> None:
        """Play the animation in real time and repeat it; do nothing if no node moves."""
        if self._animation.clips:
            root.set_animation(self._animation, play=True, repetitions=float("inf"))

    def _add(self, node: Node, name: str, kind: str, values: np.ndarray | None) -> None:
        if values is None or np.ptp(values, axis=0).max() < _STILL:
            return
        # one frame per second, so that frame numbers are times in seconds
        clip = self._animation.clips.setdefault(node.path, AnimationClip(fps=1))
        rounded = np.round(values * _FINENESS) / _FINENESS
        clip.tracks[name] = AnimationTrack(name, kind, list(self._times), rounded.tolist())
