"""Robots, changes and the desired motion from the tables of a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from .._checks import vector
from ..exceptions import RobotError, ScenarioError
from ..robot.changes import Friction, Payload, Shaft, joint_id
from ..robot.robot import Robot
from ..tasks.frame import ImageTask, PoseTask, pinhole_camera
from ..tasks.task import Task
from ..trajectories.periodic import Circle, FourierSeries, Lissajous, Sinusoid
from ..trajectories.pose import UPRIGHT, FixedOrientation, PoseTrajectory, Swing
from ..trajectories.trajectory import Hold, Trajectory, Waypoints
from .schema import (
    BeliefSection,
    CircleSection,
    FourierSection,
    FrictionSection,
    HoldSection,
    LissajousSection,
    OrientationSection,
    PayloadSection,
    Reference,
    SinusoidSection,
    TruthKeys,
    TruthSection,
    WaypointsSection,
    prefix_errors,
)

_OF_PICTURES = ("center", "radius", "amplitude", "points", "cosine", "sine")
_LOOKS = 200  # times at which the desired picture is looked at
_FAR_OFF = 10.0  # factor by which a pixel may be taken for another length


def true_robot(described: Robot, truth: TruthKeys) -> Robot:
    """Return the true robot: the described one with the changes of [truth].

    Raises:
        InputError: keys do not fit the robot.
    """
    true = described.changed(
        inertial_scale=truth.inertial_scale,
        payload=payload_of(truth.payload),
        tool_translation=truth.tool_translation,
        link_translation=truth.link_translation,
        armature=truth.armature,
        friction=friction_of(described, truth.friction),
    )
    if truth.camera or isinstance(described.task, ImageTask):
        return _filmed(true, described, truth)
    if truth.tracker is None:
        return true
    return true.seen_from(truth.tracker.rotation, truth.tracker.translation)


def _filmed(true: Robot, described: Robot, truth: TruthKeys) -> Robot:
    """Return the true robot in the pictures of the cameras of [truth].

    Raises:
        ScenarioError: there is none, or one that does not see the tool at home, or another task.
    """
    task, cameras = described.task, []
    if not isinstance(task, ImageTask):
        raise ScenarioError(
            f"a camera is for the task 'image', this one is '{task.name}'.",
            where="camera",
            hint='Take robot.task = "image".',
        )
    if not truth.camera or truth.tracker is not None:
        raise ScenarioError(
            'the task "image" needs a camera, and no tracker.',
            where="tracker" if truth.camera else "camera",
            hint="Say where the simulated one stands: [[truth.camera]] position = [2.0, 0.0, 1.0]. "
            "The controller does not know it.",
        )
    if len(truth.camera) != len(task.cameras):
        raise ScenarioError(
            f"there are {len(task.cameras)} in [truth], here {len(truth.camera)}.", where="camera"
        )
    at, p = (robot.placement(robot.q0).translation for robot in (described, true))
    for number, view in enumerate(truth.camera):
        size, target = np.array(view.size), at if view.target is None else view.target
        with prefix_errors(f"truth.camera.{number}"):
            H = pinhole_camera(view.position, target, view.focal, centre=0.5 * size, roll=view.roll)
        *seen, depth = H[:, :3] @ p + H[:, 3]
        y = np.array(seen) / depth
        if depth <= 0.0 or not ((y >= 0.0) & (y <= size)).all():
            outside = f"at {_pixels(y)}, outside of its {_size_words(size)}"
            raise ScenarioError(
                "it does not see the tool: at home the tool is "
                f"{'behind it' if depth <= 0.0 else outside}.",
                where=f"camera.{number}",
                hint="Leave target out: it then looks at the frame at home.",
            )
        covered = depth / view.focal
        if task.pixel is not None and not 1.0 / _FAR_OFF < covered / task.pixel < _FAR_OFF:
            raise ScenarioError(
                f"a pixel of camera {number + 1} covers {covered:.2g} m at the arm, got "
                f"{task.pixel:g}.",
                where="robot.pixel",
                hint=f"Give it to a factor of five: {covered:.1g}.",
            )
        cameras.append(H)
    try:
        return true.filmed_by(*cameras, pixel=task.pixel)
    except RobotError as error:
        raise ScenarioError(error.what, where="camera", hint=error.hint) from error


def _pixels(y: np.ndarray) -> str:
    """Return a place in a picture in words."""
    return f"({', '.join(f'{each:.0f}' for each in y)})"


def _size_words(size: np.ndarray) -> str:
    return f"{size[0]:g} x {size[1]:g} pixels"


def check_in_picture(motion: Trajectory, true: Robot, truth: TruthSection, duration: float) -> None:
    """Refuse a desired picture that a camera of [truth] does not have.

    Raises:
        ScenarioError: it is outside at some time within the duration [s], or moves by less than a
            pixel.
    """
    task = true.task
    if not isinstance(task, ImageTask) or task.pixel is None:
        return
    times = np.linspace(0.0, duration, _LOOKS)
    desired = np.array([motion.at(float(t)).x_d for t in times]) / task.pixel
    hint = "Numbers of the motion are pixels, u to the right and v downwards."
    moved = float(np.ptp(desired, axis=0).max())
    if 0.0 < moved < 1.0:
        raise ScenarioError(
            f"the desired picture moves by {moved:.2g} pixels.", where="reference", hint=hint
        )
    for t, y in zip(times, desired, strict=True):
        for (camera, row), place in zip(task.picks, y, strict=True):
            if not 0.0 <= place <= truth.camera[camera].size[row]:
                raise ScenarioError(
                    f"at {t:.3g} s the desired picture is at {_pixels(y)}, outside of the "
                    f"{_size_words(np.array(truth.camera[camera].size))} of camera {camera + 1}.",
                    where="reference",
                    hint=hint,
                )


def initial_model(described: Robot, belief: BeliefSection) -> Robot:
    """Return the initial model: the described robot with the changes of [belief], without payload.

    Raises:
        InputError: keys do not fit the robot.
    """
    return described.changed(
        inertial_scale=belief.inertial_scale,
        armature=belief.armature,
        friction=friction_of(described, belief.friction),
    )


def friction_of(described: Robot, section: FrictionSection) -> Friction:
    """Return the described friction with what a table says of it.

    Raises:
        RobotError: an unknown joint, wrong sizes, or a shaft of one joint.
    """
    names, friction = described.joint_names, described.friction
    given = section.model_dump(exclude_none=True)
    shafts = given.pop("shafts")
    for name, value in given.items():
        numbers = np.array(getattr(friction, name))
        if isinstance(value, dict):
            for joint, number in value.items():
                numbers[joint_id(described.model, joint, f"friction.{name}") - 1] = number
        else:
            numbers = vector(value, len(names), f"friction.{name}", names=names, error=RobotError)
        given[name] = numbers
    if shafts:
        given["shafts"] = tuple(_shaft(described, shaft) for shaft in shafts)
    return replace(friction, **given)


def _shaft(described: Robot, given: dict[str, Any]) -> Shaft:
    """Return the shaft of a table, which names its joints."""
    where = "friction.shafts.joints"
    first, second = (joint_id(described.model, name, where) - 1 for name in given.pop("joints"))
    if first == second:
        raise RobotError("expected two joints, got one twice.", where=where)
    return Shaft((first, second), **given)


def payload_of(section: PayloadSection | None) -> Payload | None:
    """Return the payload of a table, or None if there is none."""
    if section is None or not (section.mass or any(section.inertia)):
        return None
    return Payload(**section.model_dump())


def true_changes(described: Robot, truth: TruthSection) -> dict[float, Robot]:
    """Return the true robot after each [[truth.change]], by its time [s].

    A change replaces the keys that it names. The others keep their value of the previous change,
    before the first change that of [truth].

    Raises:
        InputError: two changes have the same time, or keys do not fit the robot.
    """
    keys: TruthKeys = truth
    robots = {}
    for number, change in _in_time(truth.change, "truth.change"):
        named = {name: getattr(change, name) for name in change.model_fields_set - {"at"}}
        keys = keys.model_copy(update=named)
        with prefix_errors(f"truth.change.{number}"):
            robots[change.at] = true_robot(described, keys)
    return robots


def announcements_of(belief: BeliefSection) -> dict[float, dict[str, Any]]:
    """Return the announcement to the controller at the time [s] of each [[belief.change]].

    Raises:
        ScenarioError: two changes have the same time, or a change is empty.
    """
    announcements = {}
    for number, change in _in_time(belief.change, "belief.change"):
        named = {name: getattr(change, name) for name in change.model_fields_set - {"at"}}
        if not named:
            raise ScenarioError(
                "must name payload or tool_translation.", where=f"belief.change.{number}"
            )
        if "payload" in named:
            named["payload"] = payload_of(change.payload)
        announcements[change.at] = named
    return announcements


def _in_time(changes: Sequence[Any], where: str) -> list[tuple[int, Any]]:
    """Return changes with their numbers in the file, from 0, sorted by time."""
    ordered = sorted(enumerate(changes), key=lambda pair: pair[1].at)
    for (_, one), (number, other) in pairwise(ordered):
        if one.at == other.at:
            raise ScenarioError(
                f"there is another change at {other.at:g} s.",
                where=f"{where}.{number}.at",
                hint="Merge them into one change.",
            )
    return ordered


def trajectory_of(reference: Reference, true: Robot) -> Trajectory:
    """Return the desired motion; by default its path starts at the true robot's home pose.

    With ``start = "moving"`` it is one to be taken as it is, with a ``ramp`` one from rest. Without
    either it begins at speed, and ``simulate`` starts it.

    Raises:
        InputError: points or centre have the wrong size, the task has no such plane or no
            orientation, or a motion that is moving has a ramp.
    """
    motion = _path(reference, true)
    if reference.start == "rest":
        return motion if reference.ramp is None else motion.from_rest(reference.ramp)
    if reference.ramp is not None:
        raise ScenarioError(
            'start = "moving" has no ramp.',
            where="reference.ramp",
            hint='Remove ramp, or take start = "rest".',
        )
    return motion.as_given()


def _path(reference: Reference, true: Robot) -> Trajectory:
    """Return the motion of [reference] at its own speed."""
    start, task = true.position(true.q0), true.task
    if isinstance(task, ImageTask) and task.pixel is not None:
        reference = _counted(reference, task.pixel)
    motion, placed = _motion(reference, task)
    motion = motion if placed else motion.starting_at(start[: _size(task)])
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


def _counted(reference: Reference, pixel: float) -> Reference:
    """Return a motion of a picture, given in pixels, in the lengths [m] that they count as."""
    given = {name: getattr(reference, name, None) for name in _OF_PICTURES}
    scaled = {name: _times(pixel, value) for name, value in given.items() if value is not None}
    return reference.model_copy(update=scaled)


def _times(factor: float, value: Any) -> Any:
    """Return a number, or nested lists of numbers, times a factor."""
    return [_times(factor, each) for each in value] if isinstance(value, list) else factor * value


def _size(task: Task) -> int:
    """Return the number of coordinates of the motion: positions of the frame, or all joints."""
    return task.positions or task.size


def _motion(reference: Reference, task: Task) -> tuple[Trajectory, bool]:
    """Return the motion of positions or joints, and whether its place is given as well."""
    size = _size(task)
    if isinstance(reference, WaypointsSection):
        points = [np.array(point) for point in reference.points]
        if any(point.size != size for point in points):
            raise ScenarioError(
                f"every point needs {size} coordinates, as many as the task.",
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
    """Return a motion around its centre."""
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
                f"the task has {middle.size} coordinates; each needs a list of coefficients.",
                where="reference.cosine",
            )
        return FourierSeries(middle, reference.cosine, reference.sine, reference.period)
    plane = _plane(reference, task)
    return Circle(middle, reference.radius, reference.period, plane, reference.phase)


def _plane(reference: CircleSection, task: Task) -> str:
    """Return the plane of a circle in task coordinates; a planar task has only one."""
    if task.positions < 2:
        raise ScenarioError(
            f"the task '{task.name}' has no plane for a circle.",
            where="reference.kind",
            hint='Take "sinusoid", "fourier", "waypoints" or "hold".',
        )
    if task.positions == 2 and reference.plane in (None, task.name):
        return "xy"
    if task.positions == 2:
        words = f"must be '{task.name}', as the task, got '{reference.plane}'."
        if isinstance(task, ImageTask):
            words = "a picture is a plane by itself; leave it out."
        raise ScenarioError(words, where="reference.plane")
    return reference.plane or "xy"


def _orientation(section: OrientationSection, start: np.ndarray) -> Trajectory:
    """Return the desired orientation; without a quaternion it starts at ``start`` (4)."""
    middle = UPRIGHT if section.quaternion is None else section.quaternion
    motion: Trajectory = FixedOrientation(middle)
    if section.amplitude:
        motion = Swing(section.axis, section.amplitude, section.period, section.phase, middle)
    return motion.starting_at(start) if section.quaternion is None else motion
