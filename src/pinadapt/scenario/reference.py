"""From the [reference] table to a desired motion."""

from __future__ import annotations

import numpy as np

from ..exceptions import ScenarioError
from ..robot.robot import Robot
from ..tasks.pose import PoseTask
from ..tasks.task import Task
from ..trajectories.circle import Circle
from ..trajectories.hold import Hold
from ..trajectories.lissajous import Lissajous
from ..trajectories.orientation import UPRIGHT, FixedOrientation, Orientation, Swing
from ..trajectories.pose_trajectory import PoseTrajectory
from ..trajectories.trajectory import Trajectory
from ..trajectories.waypoints import Waypoints
from .error_prefix import prefix_errors
from .schema import (
    CircleSection,
    HoldSection,
    LissajousSection,
    OrientationSection,
    Reference,
    WaypointsSection,
)


def trajectory_of(reference: Reference, true: Robot) -> Trajectory:
    """Return the desired motion; what the table leaves open, centre or orientation, is that of the true robot at home.

    Raises:
        InputError: points or centres of the wrong size, a plane or an orientation that the task has
            not.
    """
    start, task = true.position(true.q0), true.task
    place = task.position(start)
    motion, anchored = _position(reference, task)
    motion = motion if anchored else motion.starting_at(place)
    if not isinstance(task, PoseTask):
        if reference.orientation is not None:
            raise ScenarioError(
                f"the task '{task.name}' has no orientation.",
                where="reference.orientation",
                hint='Take robot.task = "pose".',
            )
        return motion
    with prefix_errors("reference.orientation"):
        return PoseTrajectory(
            motion, _orientation(reference.orientation or OrientationSection(), start[3:])
        )


def _position(reference: Reference, task: Task) -> tuple[Trajectory, bool]:
    """Return the motion of the task's positions, and whether it is where it belongs; else it is to start at the start."""
    if isinstance(reference, WaypointsSection):
        points = [np.array(point) for point in reference.points]
        if any(point.size != task.positions for point in points):
            raise ScenarioError(
                f"every point needs {task.positions} coordinates, as the task has.",
                where="reference.points",
            )
        first = [np.zeros(task.positions)] if reference.relative else []
        return Waypoints([*first, *points], reference.segment), not reference.relative
    given = reference.center
    if given is not None and len(given) != task.positions:
        raise ScenarioError(
            f"the task has {task.positions} coordinates, got {len(given)}.",
            where="reference.center",
        )
    middle = np.zeros(task.positions) if given is None else np.array(given)
    if isinstance(reference, HoldSection):
        return Hold(middle), given is not None
    if isinstance(reference, LissajousSection):
        motion = Lissajous(
            middle, reference.amplitude, reference.cycles, reference.period, reference.phase
        )
        return motion, given is not None
    circle = Circle(
        middle, reference.radius, reference.period, _plane(reference, task), reference.phase
    )
    return circle, given is not None


def _plane(reference: CircleSection, task: Task) -> str:
    """Return the plane of a circle among the task's own coordinates; a task of two has one, by whatever name."""
    if task.positions == 2 and reference.plane in (None, task.name):
        return "xy"
    if task.positions == 2:
        raise ScenarioError(
            f"must be '{task.name}', as the task, got '{reference.plane}'.", where="reference.plane"
        )
    return reference.plane or "xy"


def _orientation(section: OrientationSection, start: np.ndarray) -> Orientation:
    """Return the desired orientation; where no quaternion is given it starts at the initial one (4)."""
    middle = UPRIGHT if section.quaternion is None else section.quaternion
    motion: Orientation = FixedOrientation(middle)
    if section.amplitude:
        motion = Swing(section.axis, section.amplitude, section.period, section.phase, middle)
    return motion.starting_at(start) if section.quaternion is None else motion
