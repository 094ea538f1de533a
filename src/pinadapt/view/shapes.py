"""Colours, materials and the few shapes that are not in a robot's description."""

from __future__ import annotations

from typing import Any

import numpy as np
from meshcat.geometry import MeshLambertMaterial, TriangularMeshGeometry

# From the palette of Okabe and Ito, which colour-blind readers tell apart.
TRUE, BELIEVED, DESIRED, LOAD, BONES = 0xD55E00, 0x0072B2, 0x009E73, 0xE69F00, 0x5A6472
_SIDES = 8  # of a tube


def solid(colour: int) -> MeshLambertMaterial:
    """Return an opaque material."""
    return MeshLambertMaterial(color=colour, emissive=colour, emissiveIntensity=0.35)


def ghost(opacity: float = 0.4, colour: int = BELIEVED) -> MeshLambertMaterial:
    """Return a translucent material that is hidden where it coincides with a solid one."""
    behind: dict[str, Any] = {
        "depthWrite": False,
        "polygonOffset": True,
        "polygonOffsetFactor": 2,
        "polygonOffsetUnits": 8,
    }
    return MeshLambertMaterial(
        color=colour, emissive=colour, emissiveIntensity=0.35, opacity=opacity, side=0, **behind
    )


def tube(points: np.ndarray, radius: float) -> TriangularMeshGeometry:
    """Return a tube along points (N >= 2, 3) [m], one prism a step, in the order of the path."""
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
    """Return position, quaternion, scale (F, 3 or 4): a unit cylinder from 0 to ends (F, 3) [m]."""
    lengths = np.maximum(np.linalg.norm(ends, axis=1, keepdims=True), 1e-9)
    x, y, z = (ends / lengths).T
    quaternion = np.stack(
        [z, np.zeros_like(x), -x, 1.0 + y + 1e-9], axis=1
    )  # turns y into (x, y, z), xyzw
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return (
        0.5 * ends,
        quaternion,
        np.hstack([np.full_like(lengths, radius), lengths, np.full_like(lengths, radius)]),
    )
