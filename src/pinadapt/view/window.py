"""What stands in for the window of a ``meshcat.Visualizer``: messages, in their order.

A message is a command of meshcat, in its own wire format, or a note to the page, in JSON, which
alone begins with a brace. No server is started.
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

_STILL = 1e-9  # [m, or 1] what moves less needs no keyframes
_FINENESS = 2.0**14  # steps in a metre, or in 1: numbers with few digits compress well


class Poses:
    """Nodes are placed at once, where they are at the first of the moments given."""

    def move(
        self,
        node: Node,
        position: np.ndarray,
        quaternion: np.ndarray | None = None,
        scale: np.ndarray | None = None,
    ) -> None:
        """Place a node in its parent's axes at every moment.

        Args:
            node: what to move.
            position: (F, 3) [m].
            quaternion: (F, 4) xyzw, or None not to turn it.
            scale: (F, 3), or None not to stretch it.
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
    """The moments at which nodes are placed; between them the viewer interpolates."""

    def __init__(self, t: np.ndarray) -> None:
        """Choose the moments t (F) [s], from the first on."""
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
        """Let everything run in real time, again and again; nothing happens where nothing moves."""
        if self._animation.clips:
            root.set_animation(self._animation, play=True, repetitions=float("inf"))

    def _add(self, node: Node, name: str, kind: str, values: np.ndarray | None) -> None:
        if values is None or np.ptp(values, axis=0).max() < _STILL:
            return
        clip = self._animation.clips.setdefault(
            node.path, AnimationClip(fps=1)
        )  # one frame a second: times are seconds
        rounded = np.round(values * _FINENESS) / _FINENESS
        clip.tracks[name] = AnimationTrack(name, kind, list(self._times), rounded.tolist())


class Window(ABC):
    """Takes what ``meshcat.Visualizer(window=...)`` sends, and notes to the page."""

    def send(self, command: Any) -> None:
        """Take a meshcat command."""
        lowered = command.lower()
        key = lowered["type"], lowered["path"], lowered.get("property")
        self.keep(key, umsgpack.packb(lowered, force_float_precision="single"))

    def note(self, key: Any, **content: Any) -> None:
        """Take a note; the names in it say what the page does, see ``page.html``."""
        self.keep(("note", key), json.dumps(content, allow_nan=False).encode())

    def copy(self, source: Node, target: Node, *, as_ghost: bool = False) -> None:
        """Show the object of one node at another one as well, perhaps in the ghost's material."""
        paths = {"source": source.path.lower(), "target": target.path.lower()}
        self.note(paths["target"], copy={**paths, "ghost": as_ghost})

    @abstractmethod
    def keep(self, key: Any, message: bytes) -> None:
        """Keep a message; ``key`` is the same for one that takes the place of another."""


def framed(message: bytes) -> bytes:
    """Return a message with its length before it, as the page reads them."""
    return len(message).to_bytes(4, "big") + message
