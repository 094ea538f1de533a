"""What an exciting motion may use: the description's limits with a margin, above the mounting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..description.chain import (
    configuration_from_angles,
    effort_limits,
    is_slide,
    position_limits,
    velocity_limits,
)
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

    @classmethod
    def of(cls, robot: Robot, excursion: ArrayLike | None, load: float | None) -> Allowance:
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
        return cls(
            robot, low, high, speed, _effort(robot), mass, _loaded(robot, mass), plane, margin
        )

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

    def excess(self, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return by how much N states exceed each allowance, relative to it (N, .); zero within."""
        return np.maximum(np.hstack(list(self._used(angles, q, v, a))) - 1.0, 0.0)

    def kept(self, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> bool:
        """Tell whether N states are within all allowances; it stops at the first broken one."""
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
