"""Windows for ``meshcat.Visualizer`` that collect its messages instead of starting a server.

A message is a meshcat command in its wire format, or a note to the page in JSON. Only a note begins
with a brace, which tells the two apart.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from typing import Any, TypeAlias

import meshcat
import numpy as np
import umsgpack
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from scipy.spatial.transform import Rotation

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
