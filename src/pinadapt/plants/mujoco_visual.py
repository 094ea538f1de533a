"""What a robot looks like, in a MuJoCo model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..robot.robot import Robot
from .mujoco_model import mujoco_module, write_place


def draw(spec: Any, bodies: Sequence[Any], robot: Robot) -> None:
    """Hang a robot's visual geometry on the bodies (one a joint, the world first) of a model.

    Nothing of it collides or weighs. Meshes go by their vertices, in whatever format their files
    are; shapes that MuJoCo has not are left out.
    """
    if robot.visual is None:
        return
    for shape in robot.visual.geometryObjects:
        form = _form(spec, str(shape.name), shape.geometry)
        if form is None:
            continue
        geom = bodies[shape.parentJoint].add_geom(
            name=str(shape.name), mass=0.0, contype=0, conaffinity=0, group=2, **form
        )
        geom.rgba = shape.meshColor
        write_place(shape.placement, geom.pos, geom.quat)


def _form(spec: Any, name: str, geometry: Any) -> dict[str, Any] | None:
    """Return what MuJoCo calls a geometry, its mesh added to the model; None where it has none."""
    import coal  # of Pinocchio's, needed by nothing else here

    mj = mujoco_module()
    kinds = mj.mjtGeom
    if isinstance(geometry, coal.Box):
        return {"type": kinds.mjGEOM_BOX, "size": list(geometry.halfSide)}
    if isinstance(geometry, coal.Sphere):
        return {"type": kinds.mjGEOM_SPHERE, "size": [geometry.radius, 0.0, 0.0]}
    if isinstance(geometry, coal.Cylinder | coal.Capsule):
        round_ends = isinstance(geometry, coal.Capsule)
        kind = kinds.mjGEOM_CAPSULE if round_ends else kinds.mjGEOM_CYLINDER
        return {"type": kind, "size": [geometry.radius, geometry.halfLength, 0.0]}
    if not isinstance(geometry, coal.BVHModelBase) or geometry.num_tris < 4:
        return None
    triangles = (geometry.tri_indices(i) for i in range(geometry.num_tris))
    corners = np.array([[t[0], t[1], t[2]] for t in triangles])
    spec.add_mesh(
        name=name,
        uservert=np.array(geometry.vertices()).ravel().tolist(),
        userface=corners.ravel().tolist(),
        inertia=mj.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # it need not be closed
    )
    return {"type": kinds.mjGEOM_MESH, "meshname": name}
