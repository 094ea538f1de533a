"""Inertia for bodies that the description leaves without: solids of one common density.

A body is everything that moves with one joint. A body without mass is modelled by its collision
shapes, else by its visual shapes, a mesh by its convex hull. A body without shapes is a rod from
its joint to the furthest frame or joint fixed to the body, or a ball if that distance is zero. The
mass of the robot minus the described mass is distributed with one density over these volumes. Every
inertia is that of a solid and therefore physically consistent.
"""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Callable

import coal
import numpy as np
import pinocchio as pin

from .._checks import positive
from ..exceptions import RobotError
from .chain import links_of, massless_joints

# radius of rods and balls, relative to the longest rod; half, twice: their mass is a quarter, four
# times as large beside bodies with shapes
_SLENDER = 0.05


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
    if positive(mass, "mass", error=RobotError) <= described or not lacking:
        raise RobotError(
            f"the description of '{name}' has {described:.4g} kg already, and {len(lacking)} "
            f"moving bodies without mass; nothing of {mass:g} kg is left for them.",
            where="mass",
            hint="Give the mass of the whole robot, its base included, if bodies lack theirs. "
            "Robot.changed(inertial_scale=...) scales the described masses.",
        )
    wanted = [*lacking, *[0] * (model.inertias[0].mass <= 0.0)]
    solids: dict[int, pin.Inertia] = {}
    for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION):  # the later count
        placed = defaultdict[int, pin.Inertia](pin.Inertia.Zero)
        shapes = geometry(kind)
        for part in shapes.geometryObjects if shapes else ():
            joint = part.parentJoint
            if joint in wanted and (solid := _solid(part.geometry)) is not None:
                placed[joint] += part.placement.act(solid)
        solids |= placed
    ends = {joint: _furthest(model, joint) for joint in range(1, model.njoints)}
    radius = _SLENDER * max(map(np.linalg.norm, ends.values()))
    rods = {joint: _rod(ends[joint], radius) for joint in lacking if joint not in solids}
    bodies = solids | rods
    density = (mass - described) / sum(body.mass for body in bodies.values())
    model = model.copy()
    words = []
    for joint, body in bodies.items():
        rod = ", a rod or ball as it has no shapes" if joint in rods else ""
        words.append(f"{links_of(model, joint)[0]} {density * body.mass:.3g}{rod}")
        if joint > 0:
            model.inertias[joint] = pin.Inertia(
                density * body.mass, body.lever, density * body.inertia
            )
    warnings.warn(
        f"{name}: {mass - described:.4g} kg distributed over bodies by their shapes [kg]: "
        f"{'; '.join(words)}.",
        stacklevel=3,
    )
    return model


def with_solid_points(model: pin.Model, name: str) -> pin.Model:
    """Return a copy of a model with balls of aluminium for point masses.

    Descriptions round a small inertia to zero, and a joint about an axis through the mass then
    moves without inertia. A last body without mass, such as a flange, gets a ball of a hundredth of
    the mass of the others, at its joint. A warning states what was assigned.

    Args:
        model: of the chain.
        name: of the robot, for the warning.
    """
    model = model.copy()
    words = []
    flange = 0.01 * sum(body.mass for body in model.inertias[1:])
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        mass = body.mass or (flange if joint == model.njoints - 1 else 0.0)
        if mass > 0.0 and np.abs(body.inertia).max() <= 1e-12 * mass:  # [m^2], that of a point
            ball = pin.Inertia.FromSphere(mass, np.cbrt(3.0 * mass / (4.0 * np.pi * 2700.0)))
            ball.lever = body.lever
            model.inertias[joint] = ball
            words.append(f"{links_of(model, joint)[0]} {mass:.2g} kg")
    if words:
        warnings.warn(
            f"{name}: these links are described without inertia and get that of a ball of "
            f"aluminium: {', '.join(words)}.",
            stacklevel=3,
        )
    return model


def convex_hull(mesh: coal.BVHModelBase) -> coal.CollisionGeometry | None:
    """Return the convex hull of a mesh; None where it is flat, for which coal ends the process."""
    vertices = np.asarray(mesh.vertices())
    if np.linalg.matrix_rank(vertices - vertices.mean(axis=0), rtol=1e-6) < 3:
        return None
    mesh.buildConvexHull(True, "Qt")
    return mesh.convex


def _solid(shape: coal.CollisionGeometry) -> pin.Inertia | None:
    """Return a shape, a mesh as its convex hull, as a solid of 1 kg/m^3; None without volume."""
    if isinstance(shape, coal.BVHModelBase):
        shape = convex_hull(shape)
    volume = 0.0 if shape is None else shape.computeVolume()
    if not 0.0 < volume < np.inf:
        return None
    return pin.Inertia(volume, shape.computeCOM(), shape.computeMomentofInertiaRelatedToCOM())


def _furthest(model: pin.Model, joint: int) -> np.ndarray:
    """Return the position (3) [m] of the joint or frame on a body furthest from its joint."""
    places = [f.placement for f in model.frames if f.parentJoint == joint]
    places += [model.jointPlacements[child] for child in model.children[joint]]
    return np.array(
        max([np.zeros(3), *(place.translation for place in places)], key=np.linalg.norm)
    )


def _rod(end: np.ndarray, radius: float) -> pin.Inertia:
    """Return a cylinder of 1 kg/m^3 from the origin to ``end`` (3) [m]; a ball if it is short."""
    length = np.linalg.norm(end)
    if length <= radius:
        return pin.Inertia.FromSphere(4.0 / 3.0 * np.pi * radius**3, radius)
    turn = pin.Quaternion.FromTwoVectors(np.eye(3)[2], end / length).matrix()
    return pin.SE3(turn, 0.5 * end).act(
        pin.Inertia.FromCylinder(np.pi * radius**2 * length, radius, length)
    )
