"""Motion of the nodes of a scene, as meshcat plays it."""

from __future__ import annotations

from typing import TypeAlias

import meshcat
import numpy as np
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from scipy.spatial.transform import Rotation

Node: TypeAlias = meshcat.Visualizer

_STILL = 1e-9  # [m, or 1] what moves less needs no keyframes


class Keyframes:
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
        """Place a node in its parent's axes at every moment.

        Args:
            node: what to move.
            position: (F, 3) [m].
            quaternion: (F, 4) xyzw, or None not to turn it.
            scale: (F, 3), or None not to stretch it.
        """
        quaternion = (
            np.tile([0.0, 0.0, 0.0, 1.0], (len(position), 1)) if quaternion is None else quaternion
        )
        scale = np.ones((len(position), 3)) if scale is None else scale
        first = np.eye(4)
        first[:3, :3] = Rotation.from_quat(quaternion[0]).as_matrix() * scale[0]
        first[:3, 3] = position[0]
        node.set_transform(first)
        self._add(node, "position", "vector3", position)
        self._add(node, "quaternion", "quaternion", quaternion)
        self._add(node, "scale", "vector3", scale)

    def move_rigidly(self, node: Node, placements: np.ndarray) -> None:
        """Place a node at placements (F, 4, 4) [m] in its parent's axes."""
        self.move(node, placements[:, :3, 3], Rotation.from_matrix(placements[:, :3, :3]).as_quat())

    def play(self, root: Node) -> None:
        """Let everything run in real time, again and again; nothing happens where nothing moves."""
        if self._animation.clips:
            root.set_animation(self._animation, play=True, repetitions=float("inf"))

    def _add(self, node: Node, name: str, kind: str, values: np.ndarray) -> None:
        if np.ptp(values, axis=0).max() < _STILL:
            return
        clip = self._animation.clips.setdefault(
            node.path, AnimationClip(fps=1)
        )  # one frame a second: times are seconds
        clip.tracks[name] = AnimationTrack(name, kind, list(self._times), values.tolist())
