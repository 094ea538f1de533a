"""A robot that changes over time: a load is picked up or put down, a tool is exchanged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import LARGEST, instance, mapping, shown
from ..exceptions import InputError, RobotError
from .robot import Robot

EARLY = 1e-6  # [s], tolerance for the rounding error of a time that is a sum of periods


@dataclass(frozen=True, eq=False)
class Succession:
    """A robot whose parameters change at given times.

    Attributes:
        robots: the first from the start, each other one from its time on; all have the same chain.
        times: times of the changes [s], ascending, one less than there are robots.
        known: whether the parameters are the true ones; if not, only joints, frame and limits are.
    """

    robots: tuple[Robot, ...]
    times: tuple[float, ...] = ()
    known: bool = True

    @classmethod
    def of(cls, first: Robot, changes: Mapping[float, Robot] | None = None) -> Succession:
        """Return the succession of a first robot and its changes.

        Args:
            first: the robot from the start on.
            changes: time [s] -> robot from then on, in any order.

        Raises:
            InputError: a time that is not positive and finite.
            RobotError: a robot with another chain, frame or task than the first.
        """
        instance(first, Robot, "robot")
        changes = in_time(changes, "changes")
        for time, robot in changes.items():
            check_successor(first, robot, f"changes[{time:g}]")
        return cls((first, *changes.values()), tuple(changes))

    @property
    def name(self) -> str:
        """Name of the first robot."""
        return self.robots[0].name

    def index(self, t: ArrayLike) -> np.ndarray:
        """Return the index of the robot at each time t (N) [s]."""
        return np.searchsorted(np.array(self.times), np.asarray(t) + EARLY, side="right")

    @property
    def words(self) -> tuple[tuple[float, str], ...]:
        """Time [s] and short description of each change."""
        pairs = zip(self.robots, self.robots[1:], strict=False)
        return tuple(
            (time, difference(*pair)) for time, pair in zip(self.times, pairs, strict=True)
        )


def in_time(changes: Mapping[float, Any] | None, where: str) -> dict[float, Any]:
    """Return events by their time [s], sorted.

    Raises:
        InputError: not a mapping, or a time that is not positive and finite.
    """
    given = mapping(changes, where)
    for time in given:
        number = isinstance(time, int | float | np.number) and not isinstance(time, bool)
        if not (number and EARLY < time <= LARGEST):
            raise InputError(
                f"times must be positive and finite numbers, got {shown(time)}.", where=where
            )
    return {float(time): given[time] for time in sorted(given)}


def check_successor(before: Robot, after: Robot, where: str) -> None:
    """Refuse a robot that cannot replace another one during a motion.

    Raises:
        RobotError: not a robot, or one with another chain, frame or task.
    """
    if not isinstance(after, Robot):
        raise RobotError(f"expected a Robot, got {after!r}.", where=where)
    ours, theirs = _structure(before), _structure(after)
    for part in ours:
        if ours[part] != theirs[part]:
            raise RobotError(
                f"{part} cannot change during a motion; before: {ours[part]}, after: "
                f"{theirs[part]}.",
                where=where,
                hint="Derive both robots from the same load() with .changed().",
            )


def _structure(robot: Robot) -> dict[str, Any]:
    """Return what a robot keeps during a motion."""
    return {
        "the joints": robot.joint_names,
        "the joint types": [joint.shortname() for joint in robot.model.joints[1:]],
        "the task frame": robot.frame,
        "the task": robot.task.name,
    }


def difference(before: Robot, after: Robot) -> str:
    """Return a short text of how two robots with the same chain differ, masses in kg."""
    ours, theirs = _parts(before), _parts(after)
    words = [part for part in ours if not np.allclose(ours[part], theirs[part], 1e-9, 1e-12)]
    mass = float((theirs["inertias"] - ours["inertias"])[:, 0].sum())
    if abs(mass) > 1e-9:
        words[0] = f"{mass:+.3g} kg"
    return ", ".join(words) or "nothing"


def _parts(robot: Robot) -> dict[str, np.ndarray]:
    model, friction = robot.model, robot.friction
    return {
        "inertias": np.array([body.toDynamicParameters() for body in model.inertias]),
        "tool": model.frames[robot.frame_id].placement.homogeneous,
        "links": np.array([placement.homogeneous for placement in model.jointPlacements]),
        "friction": np.array(
            [friction.viscous, friction.coulomb, friction.load, friction.asymmetry, friction.offset]
        ),
        "rotors": np.array(model.armature),
    }
