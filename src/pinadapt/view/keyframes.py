"""Where the nodes of a scene are: now, or at the moments of an animation."""

from __future__ import annotations

from typing import TypeAlias

import meshcat
import numpy as np
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
