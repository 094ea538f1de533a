"""Inertia for bodies that the description leaves without: solids of one common density.

A body is everything that moves with one joint. A body without mass is modelled by its shapes: the
collision shapes if they are all solids (boxes, cylinders, spheres, capsules, closed meshes), else
the visual shapes if those are; else the collision or visual shapes with the convex hull of each
mesh. A body without shapes is a rod from its joint to the furthest frame or joint fixed to the
body, or a ball if that distance is zero. The mass of the robot minus the described mass is
distributed with one density over these volumes. Every inertia is that of a solid and therefore
physically consistent.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import coal
import numpy as np
import pinocchio as pin

from .._checks import positive
from ..exceptions import RobotError
from .chain import links_of, massless_joints

_DENSITY = 2700.0  # [kg/m^3] of aluminium
_FLANGE = 0.01  # mass of a last body without any, as a share of that of the others
_POINT = 1e-12  # [m^2] of inertia over mass: that of a point
_SLENDER = 0.05  # radius of rods and balls, relative to the longest rod
_LEAST = 0.1  # [m] length of the longest rod if all are zero


def with_inertias(
    model: pin.Model,
    geometry: Callable[[pin.GeometryType], pin.GeometryModel | None],
    mass: float,
    name: str,
) -> pin.Model:
    """Return a copy of a model in which all bodies have inertia and the robot has a given mass.

    The base counts as well: if it is described without mass, its shapes get their share, which does
    not affect the motion. A warning states the masses that were assigned.

    Args:
        model: of the whole robot.
        geometry: reads the visual or collision geometry.
        mass: of the whole robot [kg].
        name: of the robot, for messages.

    Raises:
        RobotError: the mass is not positive and finite, or not above the described mass; or every
            body has a mass already.
    """
    lacking = massless_joints(model)
    described = sum(body.mass for body in model.inertias)
    _check(mass, described, lacking, name)
    base = [0] if model.inertias[0].mass <= 0.0 else []
    solids = _solids(model, geometry, [*base, *lacking])
    rods = _rods(model, [joint for joint in lacking if joint not in solids])
    density = (mass - described) / sum(s.mass for s in [*solids.values(), *rods.values()])
    model = model.copy()
    for joint, solid in {**solids, **rods}.items():
        heavy = pin.Inertia(density * solid.mass, solid.lever, density * solid.inertia)
        if joint > 0:
            model.inertias[joint] = heavy
    warnings.warn(_summary(model, solids, rods, mass - described, density, name), stacklevel=3)
    return model


def with_solid_points(model: pin.Model, name: str) -> pin.Model | None:
    """Return a copy of a model with balls of aluminium for point masses; None if it has none.

    Descriptions round a small inertia to zero, and a joint about an axis through the mass then
    moves without inertia. A last body without mass, such as a flange, gets a ball of a hundredth of
    the mass of the others, at its joint. A warning states what was assigned.

    Args:
        model: of the chain.
        name: of the robot, for the warning.
    """
    balls = {
        joint: pin.Inertia(body.mass, body.lever, np.zeros((3, 3)))
        for joint in range(1, model.njoints)
        if (body := model.inertias[joint]).mass > 0.0
        and np.abs(body.inertia).max() <= _POINT * body.mass
    }
    masses = [float(model.inertias[joint].mass) for joint in range(1, model.njoints)]
    bare = model.njoints - 1 if masses[-1:] == [0.0] and all(masses[:-1]) and masses[:-1] else None
    if bare is not None:
        balls[bare] = pin.Inertia(_FLANGE * sum(masses), np.zeros(3), np.zeros((3, 3)))
    if not balls:
        return None
    model, words = model.copy(), []
    for joint, body in balls.items():
        radius = (3.0 * body.mass / (4.0 * np.pi * _DENSITY)) ** (1.0 / 3.0)
        moment = 0.4 * body.mass * radius**2
        model.inertias[joint] = pin.Inertia(body.mass, body.lever, moment * np.eye(3))
        mass = f"{body.mass:.2g} kg, " if joint == bare else ""
        words.append(f"{links_of(model, joint)[0]} {mass}{moment:.2g} kg m^2")
    warnings.warn(
        f"{name}: these links are described without inertia and get that of a ball of aluminium: "
        f"{'; '.join(words)}.",
        stacklevel=3,
    )
    return model


def _check(mass: float, described: float, lacking: Sequence[int], name: str) -> None:
    positive(mass, "mass", error=RobotError)
    if not lacking:
        raise RobotError(
            f"every body of '{name}' already has a mass in the description, {described:.4g} kg in "
            "total.",
            where="mass",
            hint="Omit mass. Robot.changed(inertial_scale=...) scales the described masses.",
        )
    if mass <= described:
        raise RobotError(
            f"{mass:g} kg is given for the whole robot, but the description already contains "
            f"{described:.4g} kg; nothing is left for the bodies without mass.",
            where="mass",
            hint="Give the mass of the whole robot, its base included.",
        )


def _summary(
    model: pin.Model,
    solids: dict[int, pin.Inertia],
    rods: dict[int, pin.Inertia],
    spread: float,
    density: float,
    name: str,
) -> str:
    """Return which body got which mass [kg]."""

    def each(joints: dict[int, pin.Inertia]) -> str:
        """Return the first link of each body with its mass."""
        return ", ".join(
            f"{links_of(model, i)[0]} {density * solid.mass:.3g}" for i, solid in joints.items()
        )

    parts = [f"{spread:.4g} kg distributed over the bodies without inertia [kg]"]
    parts += [f"solids of their shapes: {each(solids)}"] if solids else []
    parts += [f"rods or balls, as they have no shapes: {each(rods)}"] if rods else []
    return f"{name}: {'; '.join(parts)}."


def _solids(
    model: pin.Model,
    geometry: Callable[[pin.GeometryType], pin.GeometryModel | None],
    joints: Sequence[int],
) -> dict[int, pin.Inertia]:
    """Return joint -> its body as a solid of 1 kg/m^3, for bodies with a shape of some volume."""
    found: dict[int, pin.Inertia] = {}
    read = [geometry(pin.GeometryType.COLLISION), geometry(pin.GeometryType.VISUAL)]
    for solid, wanted in ((_as_it_is, all), (_hull, any)):
        for things in [shapes.geometryObjects for shapes in read if shapes is not None]:
            for joint in [joint for joint in joints if joint not in found]:
                mine = [thing for thing in things if thing.parentJoint == joint]
                parts = [(thing.placement, solid(thing.geometry)) for thing in mine]
                placed = [placement.act(part) for placement, part in parts if part is not None]
                if placed and wanted(part is not None for _, part in parts):
                    found[joint] = sum(placed[1:], placed[0])
    return found


def _as_it_is(shape: coal.CollisionGeometry) -> pin.Inertia | None:
    """Return a shape as a solid of 1 kg/m^3; None for a mesh that is open, flat or inside out."""
    if isinstance(shape, coal.BVHModelBase) and not _is_closed(shape):
        return None
    return _filled(shape)


def _hull(shape: coal.CollisionGeometry) -> pin.Inertia | None:
    """Return a shape, a mesh as its convex hull, as a solid of 1 kg/m^3; None without volume."""
    if not isinstance(shape, coal.BVHModelBase):
        return _filled(shape)
    if _is_flat(np.asarray(shape.vertices())):
        return None
    shape.buildConvexHull(True, "Qt")
    return None if shape.convex is None else _filled(shape.convex)


def _filled(shape: coal.CollisionGeometry) -> pin.Inertia | None:
    """Return a shape as a solid of 1 kg/m^3, or None if it has no volume."""
    volume = shape.computeVolume()
    moments = np.asarray(shape.computeMomentofInertiaRelatedToCOM())
    if not (np.isfinite(volume) and volume > 0.0 and np.linalg.eigvalsh(moments)[0] > 0.0):
        return None
    return pin.Inertia(volume, np.asarray(shape.computeCOM()), moments)


def _is_flat(vertices: np.ndarray) -> bool:
    """Return whether points (N, 3) lie in a plane, so that their convex hull has no volume."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(vertices) < 4 or bool(extents[2] <= 1e-6 * extents[0])


def _is_closed(mesh: coal.BVHModelBase) -> bool:
    """Return whether a mesh is closed: each edge belongs to two triangles, in opposite directions.

    Formats such as STL repeat the vertices of each triangle; equal vertices are merged first.
    """
    vertices = np.asarray(mesh.vertices())
    grain = 1e-6 * np.ptp(vertices, axis=0).max()
    _, same = np.unique(np.round(vertices / grain), axis=0, return_inverse=True)
    triangles = [mesh.tri_indices(k) for k in range(mesh.num_tris)]
    corners = same.reshape(-1)[[[triangle[i] for i in range(3)] for triangle in triangles]]
    edges = np.vstack([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    there, back = (np.unique(e, axis=0, return_counts=True) for e in (edges, edges[:, ::-1]))
    return all(np.array_equal(a, b) for a, b in zip(there, back, strict=True))


def _rods(model: pin.Model, joints: Sequence[int]) -> dict[int, pin.Inertia]:
    """Return joint -> its body as a rod or ball of 1 kg/m^3, all with the same radius."""
    ends = {joint: _furthest(model, joint) for joint in range(1, model.njoints)}
    longest = max(map(np.linalg.norm, ends.values()), default=0.0) or _LEAST
    return {joint: _rod(ends[joint], _SLENDER * float(longest)) for joint in joints}


def _furthest(model: pin.Model, joint: int) -> np.ndarray:
    """Return the position (3) [m] of the joint or frame on a body furthest from its joint.

    It is in the axes of that joint.
    """
    fixed = [f.placement.translation for f in model.frames if f.parentJoint == joint]
    carried = [model.jointPlacements[child].translation for child in model.children[joint]]
    return np.array(max([np.zeros(3), *fixed, *carried], key=np.linalg.norm))


def _rod(end: np.ndarray, radius: float) -> pin.Inertia:
    """Return a cylinder of 1 kg/m^3 from the origin to ``end`` (3) [m]; a ball if it is short."""
    length = float(np.linalg.norm(end))
    if length <= radius:
        ball = coal.Sphere(radius)
        return pin.Inertia(
            ball.computeVolume(), np.zeros(3), np.array(ball.computeMomentofInertia())
        )
    rod = coal.Cylinder(radius, length)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length).matrix()
    along = pin.Inertia(rod.computeVolume(), np.zeros(3), np.array(rod.computeMomentofInertia()))
    return pin.SE3(turn, 0.5 * end).act(along)
