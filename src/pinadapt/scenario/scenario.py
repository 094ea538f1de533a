"""A scenario: true robot, estimated model, controller and desired motion, ready to run."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from ..adaptation.natural import MatrixInequality
from ..controller.controller import Controller
from ..controller.learned import LearnedParameters
from ..controller.limits import Limits
from ..description.urdf import is_path
from ..exceptions import InputError, ScenarioError
from ..models.basis import read_matrix
from ..plants.mujoco_plant import MujocoFile
from ..records import Camera, Sensors
from ..robot.changes import Payload
from ..robot.loading import load
from ..robot.motors import Actuators, Compensation, Gravity, torque_limits
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from ..simulation.engine import Engine
from ..simulation.loop import Events
from ..simulation.prepare import findings, prepare
from ..simulation.simulate import Progress, simulate
from ..tasks.frame import IMAGE
from ..trajectories.trajectory import Trajectory
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown
from .parts import (
    announcements_of,
    check_in_picture,
    initial_model,
    payload_of,
    trajectory_of,
    true_changes,
    true_robot,
)
from .schema import (
    ActuatorsSection,
    BeliefSection,
    ScenarioTables,
    SimulationSection,
    TruthSection,
    UnknownSection,
    prefix_errors,
    read_tables,
)

_NOT_GAINS = {"law", "adaptation", "acceleration", "damping", "guards", "watch", "actuators"}


_CHAIN = tuple(f"robot.{key}" for key in ("source", "frame", "task", "locked"))


@contextmanager
def _hint_of_another_chain(changed: Sequence[str], tables: ScenarioTables) -> Iterator[None]:
    """Add to errors raised inside what else to set where a setting has changed the chain.

    Raises:
        InputError: the error raised inside, with its own type.
    """
    try:
        yield
    except InputError as error:
        if not changed or error.where in changed:
            raise
        robot = tables.robot
        frame, task = (f" --{name} {getattr(robot, name)}" for name in ("frame", "task"))
        hint = (
            f"--set has changed {', '.join(changed)}, and the file has numbers of another chain: "
            "set its home pose robot.q0, and what else has one number per joint or coordinate; or "
            f"write a new file: `pinadapt init {robot.source}{frame if robot.frame else ''}"
            f"{task if robot.task else ''}`."
        )
        before = f"{error.hint} " if error.hint else ""
        raise type(error)(error.what, where=error.where, hint=before + hint) from error


class Kept(Protocol):
    """Robots and controllers that were made before."""

    def once(self, kind: str, of: str, make: Callable[[], Any]) -> Any:
        """Return what was made before from the same, or make it."""


def _anew(kind: str, of: str, make: Callable[[], Any]) -> Any:
    return make()


def _made_from(tables: ScenarioTables, folder: Path) -> tuple[str, str]:
    """Return what the described robot and the controller are made from, as texts."""
    robot = f"{folder} {len(tables.truth.camera)} {tables.robot.model_dump_json()}"
    parts = [each.model_dump_json() for each in (tables.belief, tables.unknown, tables.controller)]
    simulation = tables.simulation.model_dump_json(exclude={"duration", "seed", "substeps"})
    return robot, " ".join([robot, *parts, str(tables.reference.governor), simulation])


@dataclass(frozen=True, eq=False)
class Scenario:
    """Everything that a run needs, built and checked before anything moves.

    Attributes:
        tables: the checked tables of the file.
        true: the true robot.
        estimated: the estimated model at the start.
        controller: the controller, made for the estimated model.
        trajectory: the desired motion.
        sensors: sensors of the true robot, announced to the controller.
        events: changes of the true robot, and announcements to the controller.
        engine: the simulator of the true robot.
        start: initial estimates ``a_k`` and ``a_d``; None: those of ``estimated``.
    """

    tables: ScenarioTables
    true: Robot
    estimated: Robot
    controller: Controller
    trajectory: Trajectory
    sensors: Sensors
    events: Events
    engine: Engine
    start: Mapping[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The file's title, or the robot's name."""
        return self.tables.title or self.true.name

    @classmethod
    def read(cls, path: Path | str, settings: Sequence[str] = ()) -> Scenario:
        """Read a scenario file; ``settings`` are dotted ``key=value`` strings that override it.

        Raises:
            InputError: the file, the robot or the gains cannot be used.
        """
        path = Path(path)
        tables = read_tables(path, settings)
        changed = [text.partition("=")[0].strip() for text in settings]
        with _hint_of_another_chain([key for key in changed if key in _CHAIN], tables):
            return cls.build(tables, path.parent)

    @classmethod
    def build(cls, tables: ScenarioTables, folder: Path, kept: Kept | None = None) -> Scenario:
        """Build a scenario from checked tables; relative paths are relative to ``folder``.

        Args:
            tables: the checked tables.
            folder: to which paths are relative.
            kept: robots and controllers of other scenarios, taken where they are the same; one
                controller must not step in two threads at a time.

        Raises:
            InputError: the tables cannot be used.
        """
        robot_of, controller_of = _made_from(tables, folder)
        made = _anew if kept is None else kept.once
        with prefix_errors("robot"):
            described = made("robot", robot_of, lambda: described_robot(tables, folder))
        with prefix_errors("truth"):
            true = true_robot(described, tables.truth)
        with prefix_errors("belief"):
            learned = _learned(tables.belief, folder)
            unloaded = initial_model(described, tables.belief)
            if learned is not None:
                unloaded = learned.shaped(unloaded)
            load = payload_of(tables.belief.payload)
            estimated = unloaded.changed(payload=load)
        with prefix_errors("controller"):
            sensors = _sensors(tables.simulation, tables.robot.pixel or 1.0)
            unknown = _unknown(tables.unknown, learned, folder)
            controller = made(
                "controller",
                controller_of,
                lambda: _controller(tables, described, unloaded, load, sensors, unknown),
            )
        with prefix_errors("belief"):
            start = _start(tables.belief, learned, controller)
        with prefix_errors("reference"):
            trajectory = trajectory_of(tables.reference, true)
            check_in_picture(trajectory, true, tables.truth, tables.simulation.duration)
        changes, announced = true_changes(described, tables.truth), announcements_of(tables.belief)
        with prefix_errors("simulation"):
            engine = _engine(tables, folder)
        scenario = cls(
            tables,
            true,
            estimated,
            controller,
            trajectory,
            sensors,
            Events(changes, announced),
            engine,
            start,
        )
        scenario.check()
        return scenario

    def check(self) -> None:
        """Check that true robot, controller, motion and engine fit together.

        Raises:
            InputError: the initial estimates or the motion have the wrong size, the estimates are
                outside the physical cone, or the engine is not installed or its model does not
                match the robot.
        """
        changes = self.tables.truth.model_copy(update={"camera": []})
        if isinstance(self.engine.plant, MujocoFile) and changes != TruthSection():
            raise ScenarioError(
                "the model file of simulation.engine defines the true robot.",
                where="truth",
                hint="Change the model file, or remove this table.",
            )
        with prefix_errors("simulation.engine"):
            plant = self.engine.maker()(self.true)
        with prefix_errors("belief"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are shown when the run starts
            state = prepare(plant, self.controller, self.trajectory, self.start)
        with prefix_errors("belief.change"):
            self.events.check(self.controller, state)

    def findings(self) -> list[str]:
        """Return the warnings of the pre-run check of period, sensors and motors."""
        if self.engine.continuous:
            return []
        motors = torque_limits(self.true, self.engine.torque_limits is not False)
        dt = self.engine.period(self.controller)
        actuators = self.engine.actuators
        return findings(self.true, self.controller, dt, self.sensors, motors, actuators)

    def run(self, progress: Progress | bool | None = None, *, view: bool = False) -> Rollout:
        """Run the closed loop, with ``progress`` and ``view`` as in ``simulate``.

        Raises:
            Interrupted: a ``KeyboardInterrupt`` that carries the rollout so far.
        """
        simulation = self.tables.simulation
        with prefix_errors("simulation"):
            return simulate(
                self.true,
                self.controller,
                self.trajectory,
                duration=simulation.duration,
                sensors=self.sensors,
                events=self.events,
                engine=self.engine,
                start=self.start,
                seed=simulation.seed,
                title=self.title,
                progress="live" if view else progress,
            )


def described_robot(tables: ScenarioTables, folder: Path) -> Robot:
    """Return the robot of [robot], as described; paths are relative to ``folder``.

    Raises:
        InputError: it cannot be loaded, or ``pixel`` is missing for the task "image", or given for
        another.
    """
    robot = tables.robot
    filmed = robot.task == IMAGE
    if filmed != (robot.pixel is not None):
        words = "is needed by" if filmed else "has a use only with"
        raise ScenarioError(
            f'{words} the task "image": about the length [m] that a pixel covers at the arm.',
            where="pixel",
            hint="0.002 for 2 mm; a factor of five does not matter." if filmed else None,
        )
    described = load(
        folder / robot.source if is_path(robot.source) else robot.source,
        frame=robot.frame,
        task=None if filmed else robot.task,
        locked=robot.locked,
        q0=robot.q0,
        gravity=robot.gravity,
        weld_root=robot.weld_root,
        xacro=robot.xacro,
        mass=robot.mass,
        joint_effects=robot.joint_effects,
    )
    if not filmed:
        return described
    return described.filmed_by(pixel=robot.pixel, count=max(1, len(tables.truth.camera)))


def _learned(belief: BeliefSection, folder: Path) -> LearnedParameters | None:
    """Return what was learned before; None where the scenario names no file.

    Raises:
        InputError: the file cannot be used, or estimates are given twice.
    """
    if belief.learned is None:
        return None
    if belief.kinematic is not None or belief.dynamic is not None:
        raise ScenarioError(
            "contains these already; remove kinematic and dynamic.", where="learned"
        )
    return LearnedParameters.load(folder / belief.learned)


def _start(
    belief: BeliefSection, learned: LearnedParameters | None, controller: Controller
) -> dict[str, Any]:
    """Return the initial estimates, and the information; None: those of the estimated model.

    Raises:
        InputError: the learned parameters are others than the unknown ones.
    """
    if learned is None:
        return {"a_k": belief.kinematic, "a_d": belief.dynamic}
    return dict(learned.start(controller))


def _sensors(simulation: SimulationSection, pixel: float) -> Sensors:
    """Return the sensors of [simulation]; a delay alone is a camera with a frame at every sample.

    Args:
        simulation: the table.
        pixel: length [m] of the unit in which the noise of x is given.

    Raises:
        InputError: the delay is given twice, or a sensor's values are impossible.
    """
    camera = None if simulation.camera is None else Camera(**simulation.camera.model_dump())
    if simulation.delay and camera is not None:
        raise InputError(
            "the camera has a delay of its own.",
            where="delay",
            hint="Set camera = { delay = ... } only.",
        )
    return Sensors(
        Camera(delay=simulation.delay) if simulation.delay else camera,
        simulation.encoder,
        simulation.noise.model_dump() | {"x": pixel * simulation.noise.x},
        simulation.carry,
        simulation.torque_offset,
    )


def _engine(tables: ScenarioTables, folder: Path) -> Engine:
    """Return the engine of [simulation]."""
    simulation = tables.simulation
    return Engine(
        _plant(simulation, folder),
        dt=simulation.dt,
        substeps=simulation.substeps,
        continuous=simulation.mode == "continuous",
        ideal_acceleration=tables.controller.acceleration == "ideal",
        torque_limits=simulation.torque_limits,
        actuators=_true_actuators(simulation),
    )


def _plant(simulation: SimulationSection, folder: Path) -> str | MujocoFile:
    """Return the engine's name, or a MuJoCo model file."""
    if isinstance(simulation.engine, str):
        return simulation.engine
    named = simulation.engine.model_dump(exclude={"mjcf"})
    return MujocoFile(folder / simulation.engine.mjcf, **named)


def _true_actuators(simulation: SimulationSection) -> Actuators | None:
    """Return late motors and elastic joints of the true robot, or None.

    Raises:
        ScenarioError: springs are given twice, or with another engine than Pinocchio.
    """
    springs, given = simulation.elasticity, simulation.actuators
    own = {} if given is None else given.model_dump(exclude_none=True)
    if springs is not None:
        if own.keys() & {"stiffness"}:
            raise ScenarioError(
                "simulation.actuators has the stiffness already; give it once.",
                where="simulation.elasticity",
            )
        own |= springs.model_dump()
    if "stiffness" in own and simulation.engine != "pinocchio":
        raise ScenarioError(
            'elastic joints need engine = "pinocchio".',
            where=f"simulation.{'actuators' if springs is None else 'elasticity'}",
        )
    return Actuators(**own) if own else None


def _declared_actuators(section: ActuatorsSection | None) -> Actuators | None:
    """Return the actuators that [controller] declares, or None."""
    return None if section is None else Actuators(**section.model_dump(exclude_none=True))


def _controller(
    tables: ScenarioTables,
    described: Robot,
    unloaded: Robot,
    load: Payload | None,
    sensors: Sensors,
    unknown: Unknown,
) -> Controller:
    controller, simulation = tables.controller, tables.simulation
    guards = controller.guards
    compensated: Compensation | None = None
    if simulation.compensated is not None:  # of the description, or with the load of [belief]
        carried = load if simulation.compensated == "loaded" else None
        compensated = Gravity(described.changed(payload=carried))
    return make_controller(
        unloaded,
        payload=load,
        law=controller.law,
        adaptation=controller.adaptation,
        unknown=unknown,
        sensors=sensors,
        limits=Limits(
            torque=simulation.torque_limits is not False,
            box=tables.unknown.kinematic_box,
            damping=controller.damping,
            guards=guards if isinstance(guards, bool) else guards.model_dump(),
            stop_on_divergence=controller.watch,
            governor=tables.reference.governor,
            actuators=_declared_actuators(controller.actuators),
        ),
        compensated=compensated,
        dt=1e-3 if simulation.mode == "continuous" else simulation.dt,
        **controller.model_dump(exclude=_NOT_GAINS),
    )


def _unknown(unknown: UnknownSection, learned: LearnedParameters | None, folder: Path) -> Unknown:
    """Return the unknown parameters of [unknown]; all of the joints are those that were learned.

    Raises:
        InputError: the names, the basis or the inequality cannot be used.
    """
    with prefix_errors("unknown.basis"):
        basis = None if unknown.basis is None else read_matrix(folder / unknown.basis)
    with prefix_errors("unknown.lmi"):
        lmi = None if unknown.lmi is None else MatrixInequality.from_file(folder / unknown.lmi)
    joint = unknown.joint
    if joint in (None, "all", ["all"]) and learned is not None:
        joint = learned.joint_coefficients or "none"
    return Unknown.of_tables(
        unknown.kinematic,
        unknown.dynamic,
        joint,
        basis=basis,
        lmi=lmi,
        regressor=unknown.regressor,
    )
