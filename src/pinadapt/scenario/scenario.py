"""A scenario: truth, belief, controller and desired motion, ready to run."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..adaptation.natural import MatrixInequality
from ..controller.controller import Controller
from ..controller.learned import LearnedParameters
from ..description.urdf import is_path
from ..exceptions import ScenarioError
from ..models.basis import read_matrix
from ..plants.elastic_plant import JointElasticity
from ..plants.mujoco_file import MujocoFile
from ..robot.changes import Payload
from ..robot.loading import load
from ..robot.motors import compensation_of, torque_limits
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from ..simulation.loop import Events
from ..simulation.prepare import findings, prepare
from ..simulation.simulate import Progress, engine_of, simulate
from ..trajectories.trajectory import Trajectory
from ..tuning.make_controller import make_controller
from .parts import believed_robot, payload_of, told, trajectory_of, true_changes, true_robot
from .schema import BeliefSection, ScenarioTables, SimulationSection, TruthSection
from .validation import prefix_errors, read_tables


@dataclass(frozen=True, eq=False)
class Scenario:
    """Everything a run needs, built and checked before anything moves.

    Attributes:
        tables: the checked file.
        true: the true robot.
        believed: what the controller starts from.
        controller: made for the believed robot.
        trajectory: the desired motion.
        changes: time [s] -> the true robot from then on.
        beliefs: time [s] -> what the controller is told then.
        engine: what simulates the true robot.
        start: ``a_k`` and ``a_d`` to start from, or None for those of ``believed``.
    """

    tables: ScenarioTables
    true: Robot
    believed: Robot
    controller: Controller
    trajectory: Trajectory
    changes: Mapping[float, Robot]
    beliefs: Mapping[float, Mapping[str, Any]]
    engine: str | MujocoFile | JointElasticity = "pinocchio"
    start: Mapping[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The file's title, or the robot's name."""
        return self.tables.title or self.true.name

    @classmethod
    def read(cls, path: Path | str, settings: Sequence[str] = ()) -> Scenario:
        """Read a scenario file; ``settings`` are dotted ``key=value`` strings that override it.

        Raises:
            InputError: anything in the file, the robot or the gains that cannot be used.
        """
        path = Path(path)
        return cls.build(read_tables(path, settings), path.parent)

    @classmethod
    def build(cls, tables: ScenarioTables, folder: Path) -> Scenario:
        """Build a scenario from checked tables; relative paths start at ``folder``.

        Raises:
            InputError: anything in the tables that cannot be used.
        """
        with prefix_errors("robot"):
            described = _described(tables, folder)
        with prefix_errors("truth"):
            true = true_robot(described, tables.truth)
        with prefix_errors("belief"):
            unloaded = believed_robot(described, tables.belief)
            load = payload_of(tables.belief.payload)
            believed = unloaded.changed(payload=load)
        with prefix_errors("controller"):
            controller = _controller(tables, described, unloaded, load, folder)
        with prefix_errors("belief"):
            start = _start(tables.belief, controller, folder)
        with prefix_errors("reference"):
            trajectory = trajectory_of(tables.reference, true)
        changes, beliefs = true_changes(described, tables.truth), told(tables.belief)
        engine = _engine(tables.simulation, folder)
        scenario = cls(
            tables, true, believed, controller, trajectory, changes, beliefs, engine, start
        )
        scenario.check()
        return scenario

    def check(self) -> None:
        """Refuse what only shows when true robot, controller and motion meet.

        Raises:
            InputError: initial estimates or a motion of the wrong size, estimates outside the cone,
                or an engine that is not installed or whose model does not match the robot.
        """
        if isinstance(self.engine, MujocoFile) and self.tables.truth != TruthSection():
            raise ScenarioError(
                "the model file of simulation.engine says what the real robot is.",
                where="truth",
                hint="Change the file, or take this table out.",
            )
        with prefix_errors("simulation.engine"):
            plant = engine_of(self.engine)(self.true)
        with prefix_errors("belief"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are shown when the run starts
            state = prepare(plant, self.controller, self.trajectory, **self.start)
        with prefix_errors("belief.change"):
            Events(self.changes, self.beliefs).check(self.controller, state)

    def findings(self) -> list[str]:
        """Return what of period, sensors and motors would spoil a run; ``run`` warns of it."""
        simulation = self.tables.simulation
        if simulation.mode != "sampled":
            return []
        return findings(
            self.true,
            self.controller,
            simulation.dt,
            camera=_camera(simulation),
            noise=_noise(simulation),
            encoder=simulation.encoder,
            motors=torque_limits(self.true, simulation.torque_limits is not False),
        )

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
                dt=simulation.dt,
                mode=simulation.mode,
                engine=self.engine,
                substeps=simulation.substeps,
                acceleration=self.tables.controller.acceleration,
                **self.start,
                noise=_noise(simulation),
                delay=simulation.delay,
                camera=None if simulation.camera is None else simulation.camera.model_dump(),
                encoder=simulation.encoder,
                torque_limits=simulation.torque_limits,
                changes=self.changes,
                beliefs=self.beliefs,
                seed=simulation.seed,
                title=self.title,
                progress=progress,
                view=view,
            )


def _described(tables: ScenarioTables, folder: Path) -> Robot:
    robot = tables.robot
    return load(
        folder / robot.source if is_path(robot.source) else robot.source,
        frame=robot.frame,
        task=robot.task,
        locked=robot.locked,
        q0=robot.q0,
        gravity=robot.gravity,
        weld_root=robot.weld_root,
        xacro=robot.xacro,
        mass=robot.mass,
        joint_effects=robot.joint_effects,
    )


def _start(belief: BeliefSection, controller: Controller, folder: Path) -> dict[str, Any]:
    """Return ``a_k`` and ``a_d`` to start from, or None for those of the believed robot.

    Raises:
        InputError: what was learned belongs to other parameters, or is given twice.
    """
    given = {"a_k": belief.kinematic, "a_d": belief.dynamic}
    if belief.learned is None:
        return given
    if any(values is not None for values in given.values()):
        raise ScenarioError("has these already; leave kinematic and dynamic out.", where="learned")
    return dict(LearnedParameters.load(folder / belief.learned).start(controller))


def _noise(simulation: SimulationSection) -> dict[str, Any] | None:
    """Return the standard deviations by name, or None where all are zero."""
    noise: dict[str, Any] = simulation.noise.model_dump()
    return noise if any(noise.values()) else None


def _engine(simulation: SimulationSection, folder: Path) -> str | MujocoFile | JointElasticity:
    """Return the engine's name, or the model file or the springs in its place.

    Raises:
        ScenarioError: springs in another engine than Pinocchio's.
    """
    if simulation.elasticity is not None:
        if simulation.engine != "pinocchio":
            raise ScenarioError(
                'joints are elastic with engine = "pinocchio" only.', where="simulation.elasticity"
            )
        return JointElasticity(**simulation.elasticity.model_dump())
    if isinstance(simulation.engine, str):
        return simulation.engine
    named = simulation.engine.model_dump(exclude={"mjcf"})
    return MujocoFile(folder / simulation.engine.mjcf, **named)


def _camera(simulation: SimulationSection) -> dict[str, float | None] | None:
    """Return the camera by the names of its attributes; a delay alone is one at full rate."""
    if simulation.camera is not None:
        return simulation.camera.model_dump()
    return {"delay": simulation.delay} if simulation.delay else None


def _controller(
    tables: ScenarioTables,
    described: Robot,
    unloaded: Robot,
    load: Payload | None,
    folder: Path,
) -> Controller:
    unknown, controller = tables.unknown, tables.controller
    with prefix_errors("unknown.basis"):
        basis = None if unknown.basis is None else read_matrix(folder / unknown.basis)
    with prefix_errors("unknown.lmi"):
        lmi = None if unknown.lmi is None else MatrixInequality.from_file(folder / unknown.lmi)
    gains = controller.model_dump(exclude={"law", "adaptation", "acceleration"})
    return make_controller(
        unloaded,
        payload=load,
        law=controller.law,
        adaptation=controller.adaptation,
        kinematic=unknown.kinematic,
        dynamic=unknown.dynamic,
        joint=unknown.joint,
        basis=basis,
        lmi=lmi,
        kinematic_box=unknown.kinematic_box,
        torque_limits=tables.simulation.torque_limits is not False,
        compensated=compensation_of(described, tables.simulation.compensated),
        camera=_camera(tables.simulation),
        carry=tables.simulation.carry,
        noise=tables.simulation.noise.model_dump(),
        encoder=tables.simulation.encoder,
        regressor=unknown.regressor,
        dt=1e-3 if tables.simulation.mode == "continuous" else tables.simulation.dt,
        **gains,
    )
