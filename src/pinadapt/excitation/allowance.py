"""The limits of an exciting motion, with a margin, and the distances between bodies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import joint_numbers, positive
from ..description.chain import (
    effort_limits,
    position_limits,
    velocity_limits,
)
from ..description.missing_inertia import convex_hull
from ..description.urdf import read_xml
from ..exceptions import RobotError
from ..robot.changes import Payload
from ..robot.home import MARGIN, MountingPlane
from ..robot.motors import Gravity, overloaded
from ..robot.robot import LOAD, Robot
from ..robot.workspace import SHARE, range_within_limits

# [rad/s, m/s] even if a description allows more; half: 78, 88 and 27 nat of information of a UR5, a
# Panda and a SCARA in place of 90, 97 and 30; twice: 87, 97 and 31
_FASTEST_TURN, _FASTEST_SLIDE = 2.5, 1.0
# [rad, m] default excursion from home; half: 84, 93 and 29 nat; twice: 93, 98 and 31
_TURN, _SLIDE = 0.5 * np.pi, 0.5
# of the reach, between two bodies or above the floor; half, twice: 85 and 92 nat of a UR5, the
# search takes another way
_APART = 0.02
_TOUCHING = 1e-3  # [m] up to which two bodies touch at home; half, twice: the same motions
_FLOOR = "the floor"


@dataclass(frozen=True, eq=False)
class Shapes:
    """Convex hulls of a robot's collision geometry, and k pairs of them that must not touch.

    Neighbours in the chain do not count, nor pairs that touch at home, nor those that an SRDF
    disables. A pair keeps a fiftieth of the reach, or half its distance at home if that is less. A
    mesh counts as its convex hull, so distances are too small where it is hollow. The floor is one
    more shape.

    Attributes:
        model: the robot's.
        geometry: the shapes, with the pairs.
        margins: (k) distances to keep [m].
    """

    model: pin.Model
    geometry: pin.GeometryModel
    margins: np.ndarray

    @classmethod
    def of(cls, robot: Robot, srdf: Path | str | None, floor: float | None) -> Shapes | None:
        """Return the shapes of a robot; None without collision geometry.

        Args:
            robot: with the geometry that it was loaded with.
            srdf: a file whose ``disable_collisions`` name links that may touch.
            floor: height of a floor [m], in the axes of the robot's base.

        Raises:
            RobotError: no SRDF, or a body is below the floor at home.
        """
        solids = None if robot.drawn is None else robot.drawn.solids()
        if solids is None:
            return None
        geometry = _convex(solids[0])
        links = list(solids[1])
        allowed = set[frozenset[str]]()
        if srdf is not None:
            disabled = read_xml(Path(srdf)).iter("disable_collisions")
            allowed = {frozenset((one.get("link1", ""), one.get("link2", ""))) for one in disabled}
        if floor is not None:
            below = coal.Halfspace(np.eye(3)[2], floor)
            geometry.addGeometryObject(pin.GeometryObject(_FLOOR, 0, 0, pin.SE3.Identity(), below))
            links.append(_FLOOR)
        joints = [shape.parentJoint for shape in geometry.geometryObjects]
        pairs = [
            (i, j)
            for i, j in combinations(range(len(links)), 2)
            if abs(joints[i] - joints[j]) > 1 and frozenset((links[i], links[j])) not in allowed
        ]
        for pair in pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        whole = cls(robot.model, geometry, np.zeros(0))
        (distances,) = whole.distances(robot.q0[None])
        for (i, j), distance in zip(pairs, distances, strict=True):
            if distance <= _TOUCHING:
                if links[j] == _FLOOR and joints[i] > 2:
                    raise _below(links[i], distance, robot)
                geometry.removeCollisionPair(pin.CollisionPair(i, j))
        apart = distances[distances > _TOUCHING]
        if not apart.size:
            return None
        return replace(whole, margins=np.minimum(_APART * robot.reach, 0.5 * apart))

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Return the distances (N, k) at configurations (N, nq) [m], negative in contact."""
        data = self.model.createData()
        found = self.geometry.createData()
        different, which = np.unique(q, axis=0, return_inverse=True)
        for request in found.distanceRequests:  # accurate enough for differences, in contact too
            request.gjk_tolerance = request.epa_tolerance = 1e-9
            request.gjk_max_iterations = request.epa_max_iterations = 256
        results = list(found.distanceResults)  # where Pinocchio writes; copies cost much more
        distances = np.zeros((len(different), len(results)))
        for row, each in zip(distances, different, strict=True):
            pin.computeDistances(self.model, data, self.geometry, found, each)
            row[:] = [result.min_distance for result in results]
        return distances[which.ravel()]


def _below(name: str, distance: float, robot: Robot) -> RobotError:
    """Return the error of a body that is below the floor at home [m]."""
    return RobotError(
        f"at home '{name}' is {-distance:.3g} m below the floor.",
        where=robot.name,
        hint="Take another home pose, or the floor's height in the axes of the base.",
    )


def _convex(geometry: pin.GeometryModel) -> pin.GeometryModel:
    """Return a copy whose meshes are replaced by their convex hulls, or boxes if they are flat."""
    geometry = geometry.copy()
    for shape in geometry.geometryObjects:
        mesh = shape.geometry
        if not isinstance(mesh, coal.BVHModelBase):
            continue
        hull = convex_hull(mesh)
        if hull is None:
            mesh.computeLocalAABB()
            box = mesh.aabb_local
            hull = coal.Box(box.width(), box.height(), box.depth())
            shape.placement = shape.placement * pin.SE3(np.eye(3), box.center())
        shape.geometry = hull
    return geometry


class States(NamedTuple):
    """N states of the joints.

    Attributes:
        angles: (N, n) angles or displacements [rad or m].
        q: (N, nq) the same as configurations.
        v, a: (N, n) velocities and accelerations.
    """

    angles: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


class Allowance:
    """The ranges of position, velocity and effort that a motion of the joints may use.

    Attributes:
        robot: the nominal robot.
        low, high: (n) angles or displacements [rad or m].
        speed: (n) [rad/s or m/s].
        effort: (n) [N m or N], infinite where the description has none.
        load: mass of the heaviest load that it may carry [kg].
        loaded: the model of the robot with this load.
        plane: that the robot is mounted on; None if it moves along the plane or starts behind it.
        margin: smallest allowed distance from the plane [m], if there is one.
        shapes: that must not touch; None without collision geometry.
    """

    def __init__(
        self,
        robot: Robot,
        excursion: ArrayLike | None,
        load: float | None,
        shapes: Shapes | None = None,
        floor: float | None = None,
    ) -> None:
        """Take what the description of a robot and its home allow.

        Args:
            robot: the nominal one.
            excursion: from home [rad or m].
            load: the heaviest [kg].
            shapes: of the bodies.
            floor: height of a floor [m]; bodies without shapes count as joints and the frame.

        Raises:
            InputError: an excursion or load that is not a positive number.
            RobotError: home is outside the limits, or the motors cannot hold the load there.
        """
        self.robot = robot
        self.shapes = shapes
        model = robot.model
        slides = robot.sliding
        reach = np.where(slides, _SLIDE, _TURN)
        if excursion is not None:
            reach = joint_numbers(excursion, "excursion", model.nv, zero=False)
        self.low, self.high = _range(robot, reach)
        fastest = np.where(slides, _FASTEST_SLIDE, _FASTEST_TURN)
        self.speed = np.minimum(SHARE * velocity_limits(model), fastest)
        self.effort = SHARE * effort_limits(model)
        if load is None:
            held, with_one = (
                Gravity(one)(robot.q0) for one in (robot, robot.changed(payload=Payload(1.0)))
            )
            each = np.maximum(np.abs(with_one - held), np.finfo(float).eps)  # [N m or N] a kilogram
            room = (self.effort - np.abs(held)) / each
            load = max(min(LOAD * robot.mass, 0.5 * room.min()), 0.0)
        self.load = mass = positive(load, "load", zero=True)
        loaded = robot.changed(payload=Payload(mass))
        self.loaded = loaded.model
        words = f"the robot, with a load of {mass:.3g} kg or none, by {SHARE:.0%} of their efforts,"
        for one in (robot, loaded):
            if weak := overloaded(one, self.effort, words):
                raise RobotError(
                    weak, where=robot.name, hint="Or correct the efforts of the description."
                )
        plane = MountingPlane.of(model, robot.frame_id, robot.q0)
        if floor is not None and shapes is None:
            plane = replace(plane, level=max(plane.level, floor), side=1.0)
        (distance,) = plane.distances(model, robot.frame_id, [robot.q0])
        if distance <= 0.0 and floor is not None and shapes is None:
            raise _below(robot.frame, distance, robot)
        self.plane = plane if distance > 0.0 else None
        self.margin = min(MARGIN * robot.reach, 0.5 * distance)

    def torques(self, states: States) -> np.ndarray:
        """Return the torques (N, 2, n) of a motion without load and with the heaviest one."""
        models = [(model, model.createData()) for model in (self.robot.model, self.loaded)]
        each = zip(*states[1:], strict=True)
        return np.array([[pin.rnea(*model, *state) for model in models] for state in each])

    def excess(self, states: States) -> np.ndarray:
        """Return by how much N states exceed each allowance, relative to it (N, .); zero within."""
        return np.maximum(np.hstack(list(self._used(states))) - 1.0, 0.0)

    def kept(self, states: States) -> bool:
        """Return whether N states are within all allowances; it stops at the first broken one."""
        return all((used <= 1.0).all() for used in self._used(states))

    def _used(self, states: States) -> Iterator[np.ndarray]:
        """Yield shares (N, .) of the allowances that N states use, one kind at a time."""
        angles, q, v, _ = states
        yield np.abs(2.0 * angles - self.low - self.high) / (self.high - self.low)
        yield np.abs(v) / self.speed
        if np.isfinite(self.effort).any():
            yield (np.abs(self.torques(states)) / self.effort).reshape(len(q), -1)
        if self.plane is not None:
            heights = self.plane.distances(self.robot.model, self.robot.frame_id, q)
            yield 2.0 - heights[:, None] / self.margin
        if self.shapes is not None:
            yield 2.0 - self.shapes.distances(q) / self.shapes.margins


def _range(robot: Robot, reach: np.ndarray) -> np.ndarray:
    """Return the range (2, n) of angles or displacements, within reach (n) of home [rad, m].

    Raises:
        RobotError: home is outside the limits.
    """
    home, (lower, upper) = robot.home_angles, position_limits(robot.model)
    names = np.array(robot.joint_names)
    outside = names[(home <= lower) | (home >= upper)]
    if outside.size:
        raise RobotError(
            f"home is not inside the limits of {', '.join(outside)}, so no motion from there can "
            "keep them.",
            where="q0",
            hint="Take another home pose, Robot.at or robot.q0.",
        )
    return np.clip(range_within_limits(robot), home - reach, home + reach)
