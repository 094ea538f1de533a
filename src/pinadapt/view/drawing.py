"""What meshcat is given: messages for a window, materials, shapes and their places.

A message is a meshcat command in its wire format, or a note to the page in JSON. Only a note begins
with a brace, which distinguishes the two.
"""

from __future__ import annotations

import json
import re
from enum import IntEnum
from threading import Lock
from typing import Any, TypeAlias

import meshcat
import numpy as np
import pinocchio as pin
import umsgpack
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from meshcat.geometry import MeshLambertMaterial, TriangularMeshGeometry
from pinocchio.visualize import MeshcatVisualizer
from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry
from scipy.spatial.transform import Rotation


class Colour(IntEnum):
    """From the palette of Okabe and Ito, which colour-blind readers can distinguish."""

    TRUE = 0xD55E00
    ESTIMATED = 0x0072B2
    DESIRED = 0x009E73
    LOAD = 0xE69F00
    BONES = 0x5A6472
    FORCE = 0xCC79A7
    CONE = 0x56B4E9


class Window:
    """Keeps the latest message of each key, in order of arrival.

    It receives the commands of ``meshcat.Visualizer(window=...)``, and notes to the page.

    Attributes:
        count: of all messages so far.
    """

    def __init__(self) -> None:
        """Make a window without messages."""
        self._latest: dict[Any, tuple[int, bytes]] = {}
        self._lock = Lock()
        self.count = 0

    def send(self, command: Any) -> None:
        """Receive a meshcat command."""
        lowered = command.lower()
        key = lowered["type"], lowered["path"], lowered.get("property")
        self._keep(key, umsgpack.packb(lowered, force_float_precision="single"))

    def note(self, key: Any, **content: Any) -> None:
        """Add a note to the page, with keys that the function ``note`` of ``page.html`` handles."""
        self._keep(("note", key), json.dumps(content, allow_nan=False).encode())

    def copy(self, source: Node, target: Node, *, as_ghost: bool = False) -> None:
        """Draw the object of one node at another node too, on request in the ghost's material."""
        place = target.path.lower()
        self.note(place, copy={"source": source.path.lower(), "target": place, "ghost": as_ghost})

    def _keep(self, key: Any, message: bytes) -> None:
        with self._lock:
            self._latest.pop(key, None)
            self.count += 1
            self._latest[key] = self.count, message

    def since(self, count: int) -> tuple[int, bytes]:
        """Return how many messages there are, and those after the first ``count``.

        Each is preceded by its length in 4 bytes, as the page reads it.
        """
        with self._lock:
            return self.count, b"".join(
                len(message).to_bytes(4, "big") + message
                for number, message in self._latest.values()
                if number > count
            )


def solid(colour: int, opacity: float = 1.0, **options: Any) -> MeshLambertMaterial:
    """Return a material, opaque by default, with options of three.js."""
    return MeshLambertMaterial(
        color=colour, opacity=opacity, emissive=colour, emissiveIntensity=0.35, **options
    )


def overlay(opacity: float, colour: int) -> MeshLambertMaterial:
    """Return a material that is seen through everything else."""
    return solid(colour, opacity, transparent=True, depthTest=False)


def ghost(opacity: float = 0.4, colour: int = Colour.ESTIMATED) -> MeshLambertMaterial:
    """Return a translucent material, hidden where a solid one is at about the same place.

    About the same is within half a per cent of the picture's depth, 160 steps of its depth buffer.
    Without that, patches of a robot that is known to a millimetre would appear blue.
    """
    return solid(
        colour,
        opacity,
        side=0,
        depthWrite=False,
        polygonOffset=True,
        polygonOffsetFactor=4,
        polygonOffsetUnits=160,
    )


def rod(
    start: np.ndarray, end: np.ndarray, radius: float | np.ndarray
) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """Return positions (F, 3), rotations (F) and scales (F, 3) of rods between points.

    A unit cylinder, placed so, is a rod from ``start`` to ``end`` (F, 3) of a radius, one number or
    (F, 1) [m].
    """
    lengths = np.maximum(np.linalg.norm(end - start, axis=1), 1e-9)
    x, y, z = (end - start).T / lengths
    # rotates the y axis, along which the cylinder lies, to (x, y, z)
    rotation = Rotation.from_quat(np.column_stack([z, 0.0 * x, -x, 1.0 + y + 1e-9]))
    scale = np.broadcast_to(radius, end.shape).copy()
    scale[:, 1] = lengths
    return 0.5 * (start + end), rotation, scale


def tube(points: np.ndarray, radius: float) -> TriangularMeshGeometry:
    """Return a tube along points (N, 3) [m], N >= 2: one prism per step, in order of the path."""
    sides = 8
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = radius * np.array([np.sin(angle), 0.0 * angle, np.cos(angle)])
    _, rotation, _ = rod(points[:-1], points[1:], radius)
    rings = (rotation.as_matrix() @ ring).swapaxes(1, 2)  # (N-1, sides, 3)
    vertices = np.concatenate([points[:-1, None] + rings, points[1:, None] + rings], axis=1)
    i = np.arange(sides)
    j = np.roll(i, -1)
    faces = np.hstack([[i, j, i + sides], [j, j + sides, i + sides]]).T
    first = 2 * sides * np.arange(len(points) - 1)[:, None, None]
    return TriangularMeshGeometry(vertices.reshape(-1, 3), (first + faces).reshape(-1, 3))


class _AnyImage(set[Any]):
    """Contains everything."""

    def __contains__(self, item: object) -> bool:
        return True


class Artist(MeshcatVisualizer):
    """Pinocchio's visualizer, which draws Collada meshes without the images that they name.

    A page would show these to everybody who gets it, and they may be any file of this machine.
    """

    def loadMeshFromFile(self, shape: pin.GeometryObject) -> Any:  # Pinocchio's name
        """Return a mesh; a Collada mesh without images, and without coordinates on them."""
        if not shape.meshPath.lower().endswith(".dae"):
            return super().loadMeshFromFile(shape)
        mesh = DaeMeshGeometry(shape.meshPath, _AnyImage())  # reads no image that is in the set
        mesh.img_resources = {}
        plain = re.sub(r"<library_images>.*?</library_images>", "", mesh.dae_raw, flags=re.S)
        plain = re.sub(r"<texture\b[^>]*?(/>|>.*?</texture>)", TEXTURED, plain, flags=re.S)
        # the viewer merges the parts of a mesh only if all of them have coordinates on images
        mesh.dae_raw = plain.replace('semantic="TEXCOORD"', 'semantic="UNUSED"')
        return mesh


TEXTURED = "<color>0.8 0.8 0.8 1</color>"  # in place of an image


def draw_shapes(root: Node, twin: Node, visual: pin.GeometryModel, model: pin.Model) -> None:
    """Draw each shape k of joint i at ``joint i/shape k`` below a node; equal meshes once.

    Below its twin each is drawn as a ghost.
    """
    visual = visual.copy()
    first = dict[Any, Node]()
    artist = Artist(model, None, visual)
    artist.initViewer(viewer=root)
    for number, shape in enumerate(visual.geometryObjects):
        joint = f"joint {shape.parentJoint}"
        shape.name = f"shape {number}"
        place = root[joint][shape.name]
        shadow = twin[joint][shape.name]
        for node in (place, shadow):
            node.set_transform(shape.placement.homogeneous @ np.diag([*shape.meshScale, 1.0]))
        mesh = shape.meshPath, tuple(shape.meshColor), shape.overrideMaterial
        if shape.meshPath and mesh in first:
            root.window.copy(first[mesh], place)
        else:
            first[mesh] = place
            artist.viewerVisualGroupName = joint
            artist.loadViewerGeometryObject(shape, pin.GeometryType.VISUAL)
        root.window.copy(place, shadow, as_ghost=True)


Node: TypeAlias = meshcat.Visualizer


class Keyframes:
    """Places nodes at several moments, between which the viewer interpolates, or at one."""

    def __init__(self, t: np.ndarray) -> None:
        """Take the moments t (F) [s]; the animation starts at the first."""
        self._times = (t - t[0]).tolist()
        self._animation = Animation()

    def move(
        self,
        node: Node,
        position: np.ndarray,
        rotation: Rotation | None = None,
        scale: np.ndarray | float = 1.0,
    ) -> None:
        """Place a node in its parent's axes.

        Args:
            node: the node.
            position: (F, 3) [m].
            rotation: (F); None for none.
            scale: (F, 3), (F, 1) or one number.
        """
        turns = Rotation.identity(len(position)) if rotation is None else rotation
        sizes = np.broadcast_to(scale, position.shape)
        node.set_transform(pin.SE3(turns[0].as_matrix() * sizes[0], position[0]).homogeneous)
        for name, kind, values in (
            ("position", "vector3", position),
            ("quaternion", "quaternion", turns.as_quat()),
            ("scale", "vector3", sizes),
        ):
            if np.ptp(values, axis=0).max() < 1e-9:
                continue
            # one frame per second, so that frame numbers are times in seconds
            clip = self._animation.clips.setdefault(node.path, AnimationClip(fps=1))
            rounded = np.round(values * 2**14) / 2**14  # compresses well
            clip.tracks[name] = AnimationTrack(name, kind, self._times, rounded.tolist())

    def play(self, root: Node) -> None:
        """Play the animation in real time and repeat it; do nothing if no node moves."""
        if self._animation.clips:
            root.set_animation(self._animation, play=True, repetitions=float("inf"))
