"""Where a motion may go: limits of the description with a margin, and off the mounting plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import RobotError
from ..robot.chain import configuration_from_angles, is_slide
from ..robot.changes import Payload
from ..robot.effort_limits import effort_limits
from ..robot.mounting import MountingPlane
from ..robot.position_limits import position_limits
from ..robot.robot import Robot
from ..robot.velocity_limits import velocity_limits

_MARGIN = 0.05  # of a joint's range, at both ends
_SPEED, _EFFORT = 0.8, 0.8  # shares of the description's limits
_FAST_TURN, _FAST_SLIDE = 2.5, 1.0  # [rad/s, m/s] at most, whatever a description allows
_TURN, _SLIDE = 0.5 * np.pi, 0.5  # [rad, m] from home
_LOAD = 0.1  # of the robot's mass
_ROOM = 0.05  # of the reach, off the mounting plane


@dataclass(frozen=True, eq=False)
class Allowance:
    """What a motion of the joints may use.

    Attributes:
        robot: whose joints move.
        low, high: (n) angles or ways [rad or m].
        speed: (n) [rad/s or m/s].
        effort: (n) [N m or N], infinite where the description has none.
        loaded: the model of the robot with the heaviest load that it may carry.
        plane: that it is mounted on, or None where it moves along it or starts beyond it.
        room: distance to be kept from it [m].
    """

    robot: Robot
    low: np.ndarray
    high: np.ndarray
    speed: np.ndarray
    effort: np.ndarray
    loaded: pin.Model
    plane: MountingPlane | None
    room: float

    @classmethod
    def of(cls, robot: Robot, excursion: ArrayLike | None, load: float | None) -> Allowance:
        """Take a robot, how far its joints may go from home, and its heaviest load [kg].

        Raises:
            InputError: numbers that cannot be.
            RobotError: a home outside the limits, or a load that the motors cannot hold there.
        """
        model, home = robot.model, robot.home_angles
        slides = np.array([is_slide(joint) for joint in model.joints[1:]])
        away = np.where(slides, _SLIDE, _TURN)
        if excursion is not None:
            away = vector(excursion, model.nv, "excursion", names=robot.joint_names)
            for each in away:
                positive(each, "excursion")
        lower, upper = position_limits(model)
        _check_home(robot, lower, upper)
        margin = np.where(np.isfinite(lower), _MARGIN * (upper - lower), 0.0)
        low = np.maximum(lower + np.minimum(margin, 0.5 * (home - lower)), home - away)
        high = np.minimum(upper - np.minimum(margin, 0.5 * (upper - home)), home + away)
        fast = np.where(slides, _FAST_SLIDE, _FAST_TURN)
        mass = _LOAD * robot.mass if load is None else positive(load, "load", zero=True)
        loaded = robot.changed(payload=Payload(mass)).model if mass else model
        plane = MountingPlane.of(model, robot.frame_id, robot.q0)
        room = 0.0
        if plane is not None:
            there = plane.distance(model, model.createData(), robot.frame_id, robot.q0)
            plane, room = (
                (plane, min(_ROOM * robot.reach, 0.5 * there)) if there > 0.0 else (None, 0.0)
            )
        allowed = cls(
            robot,
            low,
            high,
            np.minimum(_SPEED * velocity_limits(model), fast),
            _EFFORT * effort_limits(robot),
            loaded,
            plane,
            room,
        )
        allowed._check_held(mass)
        return allowed

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the torques (N, 2, n) of a motion, without load and with the heaviest one."""
        models = [(model, model.createData()) for model in (self.robot.model, self.loaded)]
        return np.array(
            [
                [pin.rnea(model, data, *state) for model, data in models]
                for state in zip(q, v, a, strict=True)
            ]
        )

    def clearance(self, q: np.ndarray) -> float:
        """Return the least distance of configurations (N, nq) from the plane [m]; inf for none."""
        return float(np.min(self._distances(q), initial=np.inf))

    def excess(self, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return how far N states are beyond what is allowed, in parts of it (N, .), from 0 up."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        parts = [np.abs(angles - middle) / half, np.abs(v) / self.speed]
        if np.isfinite(self.effort).any():
            parts.append((np.abs(self.torques(q, v, a)) / self.effort).reshape(len(q), -1))
        if self.plane is not None:
            parts.append(2.0 - self._distances(q)[:, None] / self.room)
        return np.maximum(np.hstack(parts) - 1.0, 0.0)

    def _distances(self, q: np.ndarray) -> np.ndarray:
        """Return the distance (N) [m] of each configuration (N, nq) from the plane, if any."""
        if self.plane is None:
            return np.zeros(0)
        model, data, frame = self.robot.model, self.robot.model.createData(), self.robot.frame_id
        return np.array([self.plane.distance(model, data, frame, each) for each in q])

    def _check_held(self, mass: float) -> None:
        """Refuse a load that the motors cannot hold at home within their share.

        Raises:
            RobotError: the joint and both torques are named.
        """
        rest = np.zeros((1, self.robot.model.nv))
        needed = np.abs(self.torques(self.robot.q0[None], rest, rest))[0].max(axis=0)
        for name, torque, effort in zip(self.robot.joint_names, needed, self.effort, strict=True):
            if torque >= effort:
                raise RobotError(
                    f"at home joint '{name}' needs {torque:.3g} of the {effort:.3g} N m or N that "
                    f"a motion may use ({_EFFORT:.0%} of its limit) to hold a load of {mass:.3g} "
                    "kg.",
                    where=self.robot.name,
                    hint="State a lighter one as load [kg], 0 for none, or take another home pose.",
                )


def _check_home(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> None:
    """Refuse a home outside the limits.

    Raises:
        RobotError: the joint is named.
    """
    for name, angle, low, high in zip(
        robot.joint_names, robot.home_angles, lower, upper, strict=True
    ):
        if not low < angle < high:
            raise RobotError(
                f"home has joint '{name}' at {angle:.4g}, limits {low:.4g} to {high:.4g}: a motion "
                "from there and back cannot keep inside.",
                where="q0",
                hint="Take another home pose, Robot.at or robot.q0.",
            )


def configurations(robot: Robot, angles: np.ndarray) -> np.ndarray:
    """Return the configurations (N, nq) of angles (N, nv) [rad or m]."""
    if robot.model.nq == robot.model.nv:
        return angles
    return np.array([configuration_from_angles(robot.model, each) for each in angles])
