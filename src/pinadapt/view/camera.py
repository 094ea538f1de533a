"""From where to look at a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Camera:
    """A box to look at, and from where.

    Attributes:
        target: (3) centre of the box [m], world axes.
        direction: (3) unit vector from the centre towards the eye, world axes.
        box: (3) half the box's extent to the right, upwards and towards the eye [m].
    """

    target: np.ndarray
    direction: np.ndarray
    box: np.ndarray

    @property
    def size(self) -> float:
        """Half the larger side of the picture [m]."""
        return float(self.box[:2].max())


def camera_for(points: np.ndarray, path: np.ndarray) -> Camera:
    """Choose a view of a robot from its front, a little aside, that shows the path well.

    Args:
        points: (N, 3) what has to be in the picture [m].
        path: (M, 3) the tool's path [m].
    """
    right, up, direction = _axes(path)
    seen = points @ np.stack([right, up, direction], axis=1)  # (N, 3) along the picture's axes
    low, high = seen.min(axis=0), seen.max(axis=0)
    target = np.stack([right, up, direction], axis=1) @ (0.5 * (low + high))
    half = 0.5 * (high - low)
    return Camera(
        target, direction, half + 0.2 * max(float(half.max()), 1e-3)
    )  # bodies are thicker than their joints


def _axes(path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (3) to the right, up and to the eye, from the plane of the path."""
    centre = path.mean(axis=0)
    normal = np.linalg.svd(path - centre)[2][-1] if len(path) > 2 else np.array([0.0, 0.0, 1.0])
    front = centre[:2] if np.linalg.norm(centre[:2]) > 1e-6 else np.array([1.0, 0.0])
    upright = abs(normal[2]) < 0.7
    if upright:
        front = normal[:2] * (1.0 if normal[:2] @ front >= 0.0 else -1.0)
    azimuth = np.arctan2(front[1], front[0]) - np.radians(35.0)
    elevation = np.radians(20.0 if upright else 50.0)
    c, s = np.cos(azimuth), np.sin(azimuth)
    direction = np.array([np.cos(elevation) * c, np.cos(elevation) * s, np.sin(elevation)])
    right = np.array([-s, c, 0.0])
    return right, np.cross(direction, right), direction
