"""The limits of an exciting motion, with a margin, and the distances between bodies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import numbers, positive, vector
from ..description.chain import (
    configuration_from_angles,
    effort_limits,
    is_slide,
    position_limits,
    velocity_limits,
)
from ..description.urdf import read_xml
from ..exceptions import InputError, RobotError
from ..robot.changes import Payload
from ..robot.home import MountingPlane
from ..robot.robot import Robot

_MARGIN = 0.05  # of a joint's range, at both ends
_SPEED, _EFFORT = 0.8, 0.8  # shares of the description's limits
_FASTEST_TURN, _FASTEST_SLIDE = 2.5, 1.0  # [rad/s, m/s] even if a description allows more
_TURN, _SLIDE = 0.5 * np.pi, 0.5  # [rad, m] default excursion from home
_LOAD, _HALVINGS = 0.1, 6  # default load as a share of the robot's mass, and how often halved
_CLEARANCE = 0.05  # of the reach, above the mounting plane
_APART = 0.02  # of the reach, between two bodies or above the floor
_TOUCHING = 1e-3  # [m] up to which two bodies touch at home
_ALIKE, _UNLIKE = 4, 1e-3  # digits of alike angles; [m], more than distances differ between them
_POINT = 1e-4  # [m] radius of a joint of a robot without shapes
_TOLERANCE, _ITERATIONS = 1e-9, 256  # of a distance
_FLOOR = "the floor"


@dataclass(frozen=True, eq=False)
class Shapes:
    """Convex hulls of a robot's collision geometry, and k pairs of them that must not touch.

    Neighbours in the chain do not count, nor pairs that touch at home, nor those that an SRDF
    disables. A pair keeps a fiftieth of the reach, or half its distance at home if that is less. A
    mesh counts as its convex hull, so distances are too small where it is hollow. The floor is one
    more shape; a robot without collision geometry has only its joints and its frame.

    Attributes:
        model: the robot's.
        geometry: the shapes, with the pairs.
        names: (k) of the two links of each pair.
        margins: (k) distances to keep [m].
        alone: whether only joints and the frame are compared with the floor.
    """

    model: pin.Model
    geometry: pin.GeometryModel
    names: tuple[tuple[str, str], ...]
    margins: np.ndarray
    alone: bool

    @classmethod
    def of(cls, robot: Robot, srdf: Path | str | None, floor: float | None) -> Shapes | None:
        """Return the shapes of a robot; None without collision geometry and floor.

        Args:
            robot: with the geometry that it was loaded with.
            srdf: a file whose ``disable_collisions`` name links that may touch.
            floor: height of a floor [m], in the axes of the robot's base.

        Raises:
            RobotError: no SRDF, or a body is below the floor at home.
        """
        solids = None if robot.drawn is None else robot.drawn.solids()
        if solids is None and floor is None:
            return None
        allowed = _disabled(srdf)
        geometry, links = _points(robot) if solids is None else (_convex(solids[0]), solids[1])
        if floor is not None:
            height = float(numbers(floor, "floor", error=InputError))
            below = coal.Halfspace(np.array([0.0, 0.0, 1.0]), height)
            geometry.addGeometryObject(pin.GeometryObject(_FLOOR, 0, 0, pin.SE3.Identity(), below))
            links = [*links, _FLOOR]
        joints = [shape.parentJoint for shape in geometry.geometryObjects]
        pairs = [
            (i, j)
            for i, j in combinations(range(len(links)), 2)
            if abs(joints[i] - joints[j]) > 1
            and (links[j] == _FLOOR or solids is not None)
            and frozenset((links[i], links[j])) not in allowed
        ]
        at_home = _distances_of(robot.model, geometry, pairs, robot.q0[None])[0]
        if floor is not None:
            _check_above(pairs, links, joints, at_home, height, robot.name)
        kept = [pair for pair, d in zip(pairs, at_home, strict=True) if d > _TOUCHING]
        margins = np.minimum(_APART * robot.reach, 0.5 * at_home[at_home > _TOUCHING])
        if not kept:
            return None
        _set_pairs(geometry, kept)
        names = tuple((links[i], links[j]) for i, j in kept)
        return cls(robot.model, geometry, names, margins, solids is None)

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Return the distances (N, k) of configurations (N, nq) [m], negative where they overlap.

        Of configurations that are alike to 1e-4, one stands for all if no pair is near its margin.
        """
        _, first, which = np.unique(
            np.round(q, _ALIKE), axis=0, return_index=True, return_inverse=True
        )
        found = _distances_of(self.model, self.geometry, None, q[first])
        distances = found[which.ravel()]
        near = ((found - self.margins).min(axis=1, initial=np.inf) < _UNLIKE)[which.ravel()]
        near[first] = False
        distances[near] = _distances_of(self.model, self.geometry, None, q[near])
        return distances


def _set_pairs(geometry: pin.GeometryModel, pairs: Sequence[tuple[int, int]]) -> None:
    geometry.removeAllCollisionPairs()
    for i, j in pairs:
        geometry.addCollisionPair(pin.CollisionPair(i, j))


def _distances_of(
    model: pin.Model,
    geometry: pin.GeometryModel,
    pairs: Sequence[tuple[int, int]] | None,
    q: np.ndarray,
) -> np.ndarray:
    """Return the distances (N, k) of the pairs, by default those of the geometry."""
    if pairs is not None:
        _set_pairs(geometry, pairs)
    data, found = model.createData(), geometry.createData()
    for request in found.distanceRequests:  # for derivatives by differences, in contact too
        request.gjk_tolerance = request.epa_tolerance = _TOLERANCE
        request.gjk_max_iterations = request.epa_max_iterations = _ITERATIONS
    results = list(found.distanceResults)  # places where Pinocchio writes; copies cost much more
    distances = np.zeros((len(q), len(geometry.collisionPairs)))
    for row, each in zip(distances, q, strict=True):
        pin.computeDistances(model, data, geometry, found, each)
        row[:] = [result.min_distance for result in results]
    return distances


def _convex(geometry: pin.GeometryModel) -> pin.GeometryModel:
    """Return a copy whose meshes are replaced by their convex hulls, or boxes if they are flat."""
    geometry = geometry.copy()
    for shape in geometry.geometryObjects:
        mesh = shape.geometry
        if not isinstance(mesh, coal.BVHModelBase):
            continue
        try:
            mesh.buildConvexHull(True, "Qt")
            shape.geometry = mesh.convex
        except RuntimeError:  # of qhull
            mesh.computeLocalAABB()
            box = mesh.aabb_local
            shape.geometry = coal.Box(box.width(), box.height(), box.depth())
            shape.placement = shape.placement * pin.SE3(np.eye(3), box.center())
    return geometry


def _points(robot: Robot) -> tuple[pin.GeometryModel, list[str]]:
    """Return points at the joints behind the second one and at the task frame."""
    model, geometry, point = robot.model, pin.GeometryModel(), coal.Sphere(_POINT)
    places = [(joint, pin.SE3.Identity()) for joint in range(3, model.njoints)]
    frame = model.frames[robot.frame_id]
    places.append((frame.parentJoint, frame.placement))
    names = [*(str(model.names[joint]) for joint, _ in places[:-1]), robot.frame]
    for name, (joint, placement) in zip(names, places, strict=True):
        geometry.addGeometryObject(pin.GeometryObject(name, joint, 0, placement, point))
    return geometry, names


def _disabled(srdf: Path | str | None) -> set[frozenset[str]]:
    """Return the pairs of links that an SRDF lets touch.

    Raises:
        RobotError: there is no such file, or it is not XML.
    """
    if srdf is None:
        return set()
    root = read_xml(Path(srdf))
    return {
        frozenset((each.get("link1", ""), each.get("link2", "")))
        for each in root.iter("disable_collisions")
    }


def _check_above(
    pairs: Sequence[tuple[int, int]],
    links: Sequence[str],
    joints: Sequence[int],
    at_home: np.ndarray,
    floor: float,
    name: str,
) -> None:
    """Check that no body behind the second joint is below the floor at home.

    Raises:
        RobotError: one is.
    """
    for (i, j), distance in zip(pairs, at_home, strict=True):
        if links[j] == _FLOOR and joints[i] > 2 and distance < _TOUCHING:
            raise RobotError(
                f"at home '{links[i]}' is {-distance:.3g} m below the floor at {floor:g} m.",
                where=name,
                hint="Take another home pose, or the floor's height in the axes of the base.",
            )


@dataclass(frozen=True, eq=False)
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
        margin: smallest allowed distance from the plane [m].
        shapes: that must not touch; None without collision geometry and floor.
    """

    robot: Robot
    low: np.ndarray
    high: np.ndarray
    speed: np.ndarray
    effort: np.ndarray
    load: float
    loaded: pin.Model
    plane: MountingPlane | None
    margin: float
    shapes: Shapes | None = None

    @classmethod
    def of(
        cls,
        robot: Robot,
        excursion: ArrayLike | None,
        load: float | None,
        shapes: Shapes | None = None,
    ) -> Allowance:
        """Return the allowance of a robot for an excursion from home and a heaviest load [kg].

        Raises:
            InputError: an excursion or load that is not a positive number.
            RobotError: home is outside the limits, or the motors cannot hold the load there.
        """
        slides = np.array([is_slide(joint) for joint in robot.model.joints[1:]])
        low, high = _range(robot, slides, excursion)
        speed = np.minimum(
            _SPEED * velocity_limits(robot.model), np.where(slides, _FASTEST_SLIDE, _FASTEST_TURN)
        )
        mass = _default_load(robot) if load is None else positive(load, "load", zero=True)
        _check_held(robot, mass)
        plane, margin = _mounting(robot)
        effort, loaded = _effort(robot), _loaded(robot, mass)
        return cls(robot, low, high, speed, effort, mass, loaded, plane, margin, shapes)

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the torques (N, 2, n) of a motion without load and with the heaviest one."""
        models = [(model, model.createData()) for model in (self.robot.model, self.loaded)]
        return np.array(
            [
                [pin.rnea(model, data, *state) for model, data in models]
                for state in zip(q, v, a, strict=True)
            ]
        )

    def clearance(self, q: np.ndarray) -> float:
        """Return the smallest distance of configurations (N, nq) from the plane [m], or inf."""
        return float(np.min(self._distances(q), initial=np.inf))

    def apart(self, q: np.ndarray) -> tuple[float, str]:
        """Return the smallest distance of two shapes in configurations (N, nq) [m], and whose."""
        if self.shapes is None:
            return np.inf, ""
        distances = self.shapes.distances(q).min(axis=0)
        closest = int(np.argmin(distances))
        return float(distances[closest]), " and ".join(self.shapes.names[closest])

    def excess(self, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return by how much N states exceed each allowance, relative to it (N, .); zero within."""
        return np.maximum(np.hstack(list(self._used(angles, q, v, a))) - 1.0, 0.0)

    def kept(self, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> bool:
        """Return whether N states are within all allowances; it stops at the first broken one."""
        return all((used <= 1.0).all() for used in self._used(angles, q, v, a))

    def _used(
        self, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> Iterator[np.ndarray]:
        """Yield shares (N, .) of the allowances that N states use, one kind at a time."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        yield np.abs(angles - middle) / half
        yield np.abs(v) / self.speed
        if np.isfinite(self.effort).any():
            yield (np.abs(self.torques(q, v, a)) / self.effort).reshape(len(q), -1)
        if self.plane is not None:
            yield 2.0 - self._distances(q)[:, None] / self.margin
        if self.shapes is not None:
            yield 2.0 - self.shapes.distances(q) / self.shapes.margins

    def _distances(self, q: np.ndarray) -> np.ndarray:
        """Return the distance (N) [m] of each configuration (N, nq) from the plane, if any."""
        if self.plane is None:
            return np.zeros(0)
        different, which = np.unique(q, axis=0, return_inverse=True)
        found = self.plane.distances(self.robot.model, self.robot.frame_id, different)
        return np.asarray(found[which.ravel()])


def _range(
    robot: Robot, slides: np.ndarray, excursion: ArrayLike | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest angles or displacements (n) [rad or m].

    Raises:
        InputError: an excursion that is not positive or has a wrong size.
        RobotError: home is outside the limits.
    """
    home, (lower, upper) = robot.home_angles, position_limits(robot.model)
    _check_home(robot, lower, upper)
    reach = np.where(slides, _SLIDE, _TURN)
    if excursion is not None:
        reach = vector(excursion, robot.model.nv, "excursion", names=robot.joint_names)
        for each in reach:
            positive(each, "excursion", error=InputError)
    margin = np.where(np.isfinite(lower), _MARGIN * (upper - lower), 0.0)
    low = lower + np.minimum(margin, 0.5 * (home - lower))
    high = upper - np.minimum(margin, 0.5 * (upper - home))
    return np.maximum(low, home - reach), np.minimum(high, home + reach)


def _effort(robot: Robot) -> np.ndarray:
    """Return the torques (n) that a motion may use [N m or N]."""
    return _EFFORT * effort_limits(robot.model)


def _loaded(robot: Robot, mass: float) -> pin.Model:
    """Return the model with a load [kg] in the frame's origin."""
    return robot.changed(payload=Payload(mass)).model if mass else robot.model


def _at_home(robot: Robot, mass: float) -> np.ndarray:
    """Return the torques (n) that hold the robot at home, with or without load [kg]."""
    rest = np.zeros(robot.model.nv)
    torques = [
        pin.rnea(model, model.createData(), robot.q0, rest, rest)
        for model in (robot.model, _loaded(robot, mass))
    ]
    return np.asarray(np.abs(torques).max(axis=0))


def _default_load(robot: Robot) -> float:
    """Return a tenth of the robot's mass [kg], halved until the motors hold it at home, or zero."""
    loads = [_LOAD * robot.mass / 2**halvings for halvings in range(_HALVINGS)]
    return next((mass for mass in loads if (_at_home(robot, mass) < _effort(robot)).all()), 0.0)


def _check_held(robot: Robot, mass: float) -> None:
    """Check that the motors can hold a load [kg] at home with the effort that they may use.

    Raises:
        RobotError: they cannot; names the joint and both torques.
    """
    needs = zip(robot.joint_names, _at_home(robot, mass), _effort(robot), strict=True)
    for name, torque, effort in needs:
        if torque >= effort:
            raise RobotError(
                f"at home joint '{name}' needs {torque:.3g} of the {effort:.3g} N m or N that a "
                f"motion may use ({_EFFORT:.0%} of its limit) with a load of {mass:.3g} kg.",
                where=robot.name,
                hint="State a lighter load, or take another home pose."
                if mass
                else "Take another home pose, or correct the limits of the description.",
            )


def _mounting(robot: Robot) -> tuple[MountingPlane | None, float]:
    """Return the plane that a robot is mounted on, and the distance to keep from it [m].

    None if the robot moves along the plane, or home is behind it.
    """
    plane = MountingPlane.of(robot.model, robot.frame_id, robot.q0)
    if plane is None:
        return None, 0.0
    distance = plane.distance(robot.model, robot.model.createData(), robot.frame_id, robot.q0)
    return (plane, min(_CLEARANCE * robot.reach, 0.5 * distance)) if distance > 0.0 else (None, 0.0)


def _check_home(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> None:
    """Check that home is inside the limits.

    Raises:
        RobotError: it is not; names the joint.
    """
    for name, angle, low, high in zip(
        robot.joint_names, robot.home_angles, lower, upper, strict=True
    ):
        if not low < angle < high:
            raise RobotError(
                f"home has joint '{name}' at {angle:.4g}, not inside its limits {low:.4g} to "
                f"{high:.4g}, so no motion from there can keep them.",
                where="q0",
                hint="Take another home pose, Robot.at or robot.q0.",
            )


def configurations(robot: Robot, angles: np.ndarray) -> np.ndarray:
    """Return the configurations (N, nq) of angles (N, nv) [rad or m]."""
    if robot.model.nq == robot.model.nv:
        return angles
    return np.array([configuration_from_angles(robot.model, each) for each in angles])
