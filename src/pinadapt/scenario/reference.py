"""From the [reference] table to a desired motion."""

from __future__ import annotations

import numpy as np

from ..exceptions import ScenarioError
from ..robot.robot import Robot
from ..tasks.pose import PoseTask
from ..tasks.task import Task
from ..trajectories.circle import Circle
from ..trajectories.fourier_series import FourierSeries
from ..trajectories.hold import Hold
from ..trajectories.lissajous import Lissajous
from ..trajectories.orientation import UPRIGHT, FixedOrientation, Orientation, Swing
from ..trajectories.pose_trajectory import PoseTrajectory
from ..trajectories.sinusoid import Sinusoid
from ..trajectories.trajectory import Trajectory
from ..trajectories.waypoints import Waypoints
from .error_prefix import prefix_errors
from .schema import (
    CircleSection,
    FourierSection,
    HoldSection,
    LissajousSection,
    OrientationSection,
    Reference,
    SinusoidSection,
    WaypointsSection,
)


def trajectory_of(reference: Reference, true: Robot) -> Trajectory:
    """Return the desired motion; centre and orientation are by default the true robot's at home.

    Raises:
        InputError: points or centres of the wrong size, a plane or an orientation that the task has
            not.
    """
    start, task = true.position(true.q0), true.task
    motion, anchored = _motion(reference, task)
    motion = motion if anchored else motion.starting_at(start[: _size(task)])
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


def _size(task: Task) -> int:
    """Return how many coordinates the motion has: the positions of a frame, or all joints."""
    return task.positions or task.size


def _motion(reference: Reference, task: Task) -> tuple[Trajectory, bool]:
    """Return the motion of positions or joints, and whether its place is given too."""
    size = _size(task)
    if isinstance(reference, WaypointsSection):
        points = [np.array(point) for point in reference.points]
        if any(point.size != size for point in points):
            raise ScenarioError(
                f"every point needs {size} coordinates, as the task has.",
                where="reference.points",
            )
        first = [np.zeros(size)] if reference.relative else []
        return Waypoints([*first, *points], reference.segment), not reference.relative
    given = reference.center
    if given is not None and len(given) != size:
        raise ScenarioError(
            f"the task has {size} coordinates, got {len(given)}.",
            where="reference.center",
        )
    middle = np.zeros(size) if given is None else np.array(given)
    return _around(middle, reference, task), given is not None


def _around(
    middle: np.ndarray,
    reference: CircleSection | LissajousSection | SinusoidSection | FourierSection | HoldSection,
    task: Task,
) -> Trajectory:
    """Return the motion around a middle."""
    if isinstance(reference, HoldSection):
        return Hold(middle)
    if isinstance(reference, LissajousSection):
        return Lissajous(
            middle, reference.amplitude, reference.cycles, reference.period, reference.phase
        )
    if isinstance(reference, SinusoidSection):
        return Sinusoid(middle, reference.amplitude, reference.period, reference.phase)
    if isinstance(reference, FourierSection):
        if any(len(rows) != middle.size for rows in (reference.cosine, reference.sine)):
            raise ScenarioError(
                f"the task has {middle.size} coordinates; a list of coefficients is needed for "
                "each.",
                where="reference.cosine",
            )
        return FourierSeries(middle, reference.cosine, reference.sine, reference.period)
    plane = _plane(reference, task)
    return Circle(middle, reference.radius, reference.period, plane, reference.phase)


def _plane(reference: CircleSection, task: Task) -> str:
    """Return the plane of a circle among the task's coordinates; a task of two has only one."""
    if task.positions < 2:
        raise ScenarioError(
            f"the task '{task.name}' has no plane for a circle.",
            where="reference.kind",
            hint='Take "sinusoid", "fourier", "waypoints" or "hold".',
        )
    if task.positions == 2 and reference.plane in (None, task.name):
        return "xy"
    if task.positions == 2:
        raise ScenarioError(
            f"must be '{task.name}', as the task, got '{reference.plane}'.", where="reference.plane"
        )
    return reference.plane or "xy"


def _orientation(section: OrientationSection, start: np.ndarray) -> Orientation:
    """Return the desired orientation; without a quaternion it starts at the initial one (4)."""
    middle = UPRIGHT if section.quaternion is None else section.quaternion
    motion: Orientation = FixedOrientation(middle)
    if section.amplitude:
        motion = Swing(section.axis, section.amplitude, section.period, section.phase, middle)
    return motion.starting_at(start) if section.quaternion is None else motion
