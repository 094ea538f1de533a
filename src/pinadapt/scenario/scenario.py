"""A scenario: true robot, estimated model, controller and desired motion, ready to run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import located, positive
from .._output import Record
from ..controller.controller import Controller
from ..controller.learned import LearnedParameters
from ..exceptions import MeasurementError, ScenarioError
from ..plants.mujoco_plant import MujocoFile
from ..records import Sensors
from ..robot.loading import load
from ..robot.motors import Gravity
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from ..simulation.engine import Engine
from ..simulation.loop import Events
from ..simulation.simulate import findings, simulate
from ..tasks.frame import ImageTask, pinhole_camera
from ..trajectories.pose import placed_trajectory
from ..trajectories.trajectory import Trajectory
from ..tuning.make_controller import make_controller
from .tables import (
    KEYS,
    TABLES,
    Tables,
    at_folder,
    in_table,
    made,
    motion,
    parts,
    read,
    read_tables,
)

_OF_PICTURES = ("center", "radius", "amplitude", "points", "point", "cosine", "sine")


@dataclass(frozen=True, eq=False)
class Scenario:
    """Everything that a run needs.

    Attributes:
        tables: of the file, its paths as seen from the working directory.
        true: the true robot.
        estimated: the estimated model at the start.
        controller: the controller, made for the estimated model.
        trajectory: the desired motion.
        sensors: sensors of the true robot, announced to the controller.
        events: changes of the true robot, and announcements to the controller.
        engine: the simulator of the true robot.
        start: initial estimates ``a_k`` and ``a_d``; None: those of ``estimated``.
        duration: of the run [s].
        seed: of the noise and of lost frames.
        record_every: one sample of so many is kept.
        title: the file's title, or the robot's name.
    """

    tables: Tables
    true: Robot
    estimated: Robot
    controller: Controller
    trajectory: Trajectory
    sensors: Sensors
    events: Events
    engine: Engine
    start: Record | None = None
    duration: float = 10.0
    seed: int = 0
    record_every: int = 1
    title: str = ""

    @classmethod
    def read(cls, path: Path | str, settings: Sequence[str] = ()) -> Scenario:
        """Read a scenario file; ``settings`` are dotted ``key=value`` strings that override it.

        Raises:
            InputError: the file, the robot or the gains cannot be used.
        """
        return cls.build(read_tables(Path(path), settings), Path(path).parent)

    @classmethod
    def build(cls, tables: Tables, folder: Path) -> Scenario:
        """Build a scenario from tables, as a file has them.

        Args:
            tables: read only.
            folder: to which relative paths in them are relative.

        Raises:
            InputError: the tables cannot be used.
        """
        tables = at_folder(tables, folder)
        given = parts(tables)
        described = described_robot(given)
        sensors = given["sensors"]
        pixel = getattr(described.task, "pixel", None)
        if pixel is not None and "x" in sensors.noise:  # as in a picture
            noise = {**sensors.noise, "x": pixel * sensors.deviation("x")}
            sensors = replace(sensors, noise=noise)
        with in_table("truth"):
            true = true_robot(described, given["truth"])
        learned = given["model"].pop("learned", None)
        with in_table("model"):
            unloaded = described.changed(**given["model"])
            if learned is not None:
                learned = LearnedParameters.load(learned)
                unloaded = learned.shaped(unloaded)
        unknown = given["unknown"]
        start = given["start"] or None
        if learned is not None:
            if start:
                raise ScenarioError("is given by model.learned already.", where="start")
            if unknown.friction in (None, True) and unknown.armature in (None, True):
                unknown = unknown.with_names(joint=learned.joint_coefficients or "none")
        options = given["controller"]
        if isinstance(changes := options.get("compensated"), Mapping):
            with located("controller.compensated"):
                known = described.changed(**read(changes, "controller.compensated", Robot.changed))
                options["compensated"] = Gravity(known)
        with in_table("controller"):
            controller = make_controller(
                unloaded, unknown=unknown, sensors=sensors, limits=given["limits"], **options
            )
        if learned is not None:
            with located("model.learned"):
                start = learned.start(controller)
        with in_table("trajectory"):
            trajectory = trajectory_of(tables.get("trajectory", {}), true)
        engine = given["engine"]
        if isinstance(engine.plant, MujocoFile) and set(tables.get("truth", {})) - {"camera"}:
            raise ScenarioError(
                "the model file of engine.plant defines the true robot.",
                where="truth",
                hint="Change the model file, or remove this table.",
            )
        return cls(
            tables,
            true,
            unloaded.changed(payload=options.get("payload")),
            controller,
            trajectory,
            sensors,
            Events(
                _changes(described, given["truth"], given["events"]["changes"]),
                _in_time(given["events"]["announcements"], "announcements"),
            ),
            engine,
            start,
            **given["simulation"],
            title=given["title"] or true.name,
        )

    def findings(self) -> list[str]:
        """Return the warnings of the pre-run check of period, sensors and motors."""
        return findings(self.true, self.controller, self.engine, self.sensors)

    def run(self, progress: bool | str | None = None) -> Rollout:
        """Run the closed loop, with ``progress`` as in ``simulate``.

        Raises:
            InputError: robot, controller, motion, engine and initial estimates do not match.
            Interrupted: a ``KeyboardInterrupt`` that carries the rollout so far.
        """
        try:
            with (
                in_table("simulation"),
                located("engine", KEYS["engine"][1], (*TABLES, *KEYS["simulation"][1], "changes")),
            ):
                return simulate(
                    self.true,
                    self.controller,
                    self.trajectory,
                    duration=self.duration,
                    sensors=self.sensors,
                    events=self.events,
                    engine=self.engine,
                    start=self.start,
                    seed=self.seed,
                    record_every=self.record_every,
                    title=self.title,
                    progress=progress,
                )
        except MeasurementError as error:  # of the first sample
            raise ScenarioError(f"{error}", where="robot.q0") from error


def described_robot(given: Tables) -> Robot:
    """Return the robot of [robot], as described, from the ``parts`` of the tables.

    Raises:
        InputError: it cannot be loaded.
    """
    with in_table("robot"):
        robot = load(**given["robot"])
    cameras = len(given["truth"]["camera"])
    if cameras > 1 and isinstance(robot.task, ImageTask):
        return robot.filmed_by(pixel=robot.task.pixel, count=cameras)
    return robot


def true_robot(described: Robot, truth: Record) -> Robot:
    """Return the true robot: the described one with the changes of [truth].

    Raises:
        InputError: they do not fit the robot.
    """
    true = described.changed(
        **{key: value for key, value in truth.items() if key not in ("tracker", "camera")}
    )
    task = described.task
    if isinstance(task, ImageTask) != bool(truth["camera"]):
        raise ScenarioError(
            'the task "image" needs a camera, and no other task has one.',
            where="camera",
            hint="Say where the simulated one stands: [[truth.camera]] position = [2.0, 0.0, 1.0]. "
            "The controller does not know it.",
        )
    if isinstance(task, ImageTask):
        at = described.placement(described.q0).translation
        views = [pinhole_camera(**{"target": at, **each}) for each in truth["camera"]]
        return true.filmed_by(*views, pixel=task.pixel)
    if "tracker" not in truth:
        return true
    with located("tracker"):
        return made(true.seen_from, truth["tracker"], "tracker")


def _changes(described: Robot, truth: Record, changes: Sequence[Record]) -> dict[float, Robot]:
    """Return the true robot after each change, by its time [s].

    A change replaces the keys that it names. The others keep their value of the previous change,
    before the first change that of [truth].

    Raises:
        InputError: two changes have the same time, or keys do not fit the robot.
    """
    keys = dict(truth)
    robots = {}
    for at, change in _in_time(changes, "changes").items():
        keys |= change
        with located("events.changes", KEYS["truth"][1]):
            robots[at] = true_robot(described, keys)
    return robots


def _in_time(events: Sequence[Record], name: str) -> dict[float, Tables]:
    """Return what happens at each time [s], in order.

    Raises:
        ScenarioError: an event without a time, or two at the same one.
    """
    found = {}
    for number, event in enumerate(events):
        others = dict(event)
        place = f"events.{name}.{number}.at"
        at = positive(others.pop("at", None), place, error=ScenarioError)
        if at in found:
            raise ScenarioError("there is another event at this time.", where=place)
        found[at] = others
    return dict(sorted(found.items()))


def trajectory_of(table: Any, robot: Robot) -> Trajectory:
    """Return the desired motion; one without a place of its own begins at the robot's home pose.

    Raises:
        InputError: it does not fit the task.
    """
    pixel = getattr(robot.task, "pixel", None)
    if pixel is not None and isinstance(table, Mapping):  # numbers of pictures are pixels
        table = {
            key: (pixel * np.array(value)).tolist() if key in _OF_PICTURES else value
            for key, value in table.items()
        }
    return placed_trajectory(motion(table), robot)
