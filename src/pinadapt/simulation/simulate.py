"""Simulate a closed loop from a true robot to a rollout."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import arithmetic, instance, mapping, positive, whole, word
from ..controller.controller import Controller
from ..controller.learned import LearnedParameters
from ..controller.limits import Limits
from ..controller.state import Bridged, ControllerState, Sample
from ..exceptions import DivergedError, InputError, Interrupted
from ..information.tracker import find_camera, find_tracker
from ..models.camera_kinematics import CameraKinematics
from ..plants.mujoco_plant import MujocoFile
from ..plants.plant import Plant, PlantMaker, SimulatedPlant
from ..plants.sensors import SimulatedSensors
from ..records import Sensors
from ..reference import SmallExcitation, starting_from
from ..robot.motors import Actuators, overloaded, torque_bounds
from ..robot.robot import Robot, Succession
from ..rollout.recording import Evaluation
from ..rollout.rollout import Rollout
from ..tasks.task import JointTask
from ..trajectories.given import TrajectoryLike
from ..trajectories.pose import placed_trajectory
from ..tuning.make_controller import make_controller
from ..tuning.preflight import preflight, sensor_findings
from .engine import Engine
from .loop import Events, run, run_continuous, sample_indices

_START = ("a_k", "a_d", "information", "information_k")
_MOST = 1e7  # samples of a run, some 20 minutes of computation; half or twice: of as much


def watched(indices: range, progress: bool | str | None, title: str) -> Iterable[int]:
    """Return the indices of a run's samples, with a bar that grows as they are taken.

    Args:
        indices: of the samples.
        progress: None: a bar where standard error is a terminal, and nothing elsewhere; True: a bar
            everywhere, in a notebook as a widget; False: none.
        title: stands in front of the bar.

    Raises:
        InputError: none of these.
    """
    if not isinstance(progress, bool | None):
        raise InputError(f'expected True, False or "live", got {progress!r}.', where="progress")
    terminal = sys.stderr is not None and sys.stderr.isatty()  # a windowed program has none
    if not (terminal if progress is None else progress):
        return indices
    from tqdm.auto import tqdm  # here, because the library is imported without it

    return tqdm(indices, desc=title, unit="step", leave=False, mininterval=0.2)


def simulate(
    true: Robot,
    controller: Controller,
    trajectory: TrajectoryLike,
    *,
    duration: float = 10.0,
    sensors: Sensors | None = None,
    events: Events | None = None,
    engine: Engine | str | MujocoFile | PlantMaker | Actuators = "pinocchio",
    start: LearnedParameters | Mapping[str, ArrayLike | None] | None = None,
    seed: int = 0,
    record_every: int = 1,
    title: str = "",
    progress: bool | str | None = None,
) -> Rollout:
    """Let a controller drive the true robot from its home, at rest.

    Args:
        true: the true robot.
        controller: of its model; if made for a robot that compensates gravity by itself, so does
            the true one.
        trajectory: the desired motion x_d(t) of the task's coordinates: a ``Trajectory``; any
            object with ``at(t)``; a function of t; or times (N) [s] and positions (N, m). See
            ``trajectories.as_trajectory``. It begins where the robot is, at rest: from rest on its
            own path, after an approach if its first point is elsewhere (``reference
            .starting_from``). ``motion.as_given()`` is taken exactly as it is.
        duration: s.
        sensors: of the true robot; None: those that the controller was made for.
        events: changes of the true robot, and announcements to the controller; None for none.
        engine: what moves the true robot, and in which steps: an ``Engine``, or its plant alone:
            "pinocchio", "mujoco", a ``MujocoFile``, or a class of plants; or the ``Actuators`` of
            Pinocchio's.
        start: initial estimates, ``a_k`` (p_k) [m] and ``a_d`` (p_d) by name, with ``information``
            and ``information_k`` as of ``Controller.init``; or what was learned before. By default
            those of the controller's model; an unknown tracker is found by a ``SmallExcitation``
            of the joints before the run begins, from the same home. ``start={}`` omits that; the
            controller then finds it by millimetres of motion before the path begins, see
            ``controller.SlowStart``.
        seed: of the noise and of lost frames.
        record_every: keep one sample of so many; the loop itself runs at every one.
        title: of the rollout.
        progress: None: a bar on a terminal, none elsewhere; True: a bar everywhere, a widget in a
            notebook; False: none; "live": show the run in a browser while it goes on, at most in
            real time, as ``LiveView``.

    Raises:
        InputError: anything that cannot be run; a loop that diverges is no error, see
            ``Rollout.diverged``.
        Interrupted: a ``KeyboardInterrupt`` that carries the rollout so far.
    """
    instance(true, Robot, "true")
    instance(controller, Controller, "controller")
    engine = Engine.of(engine)
    events = instance(Events() if events is None else events, Events, "events")
    dt = engine.period(controller)
    whole(record_every, "record_every", 1)
    instance(title, str, "title")
    duration = positive(duration, "duration", error=InputError)
    if not duration / dt <= _MOST:
        raise InputError(
            f"{duration / dt:.3g} samples; at most {_MOST:.0e} are run.",
            where="duration",
            hint="Take a shorter run or a longer dt.",
        )
    sensors = controller.sensors if sensors is None else sensors
    simulated = SimulatedSensors(true, dt, sensors, seed=seed)
    if engine.continuous and not sensors.perfect:
        raise InputError(
            "noise, delay, camera and encoder exist in sampled mode only.",
            where="engine.continuous",
            hint="Take sensors=pa.Sensors() for perfect ones.",
        )
    if engine.ideal_acceleration or controller.limits.torque is None:
        controller = controller.limited(engine.motors(true))
    started = perf_counter()
    plant = engine.make(true, controller)
    if (events.changes or true.loads) and not plant.described:
        raise InputError(
            "the model file defines the true robot, with its load, which stays.", where="engine"
        )
    trajectory = placed_trajectory(trajectory, true)
    if plant.bilateral and getattr(trajectory.at(0.0), "feet", None) is not None:
        raise InputError(
            "the contacts of this simulator hold whatever that takes, so no foot would step.",
            where="engine",
            hint='Simulate steps with engine="mujoco".',
        )
    given: Any = {"a_k": None} if start is None else start
    named = isinstance(given, Mapping) and given.get("a_k", ()) is None
    if named and not controller.kinematics.calibrated:
        found = after_excitation(plant, controller, dt, simulated)
        start = {**found, **given, "a_k": found["a_k"]}
    state = prepare(plant, controller, start)
    estimated = controller.kinematics.seen(state.a_k)
    if not estimated.constraints:
        trajectory = starting_from(trajectory, estimated, plant.measure(), duration=duration)
    robots = replace(Succession.of(true, events.changes), known=plant.described)
    events.check(controller, state)
    for finding in findings(true, controller, engine, sensors):
        warnings.warn(finding, stacklevel=3)
    if late := [at for at in (*events.changes, *events.announcements) if at >= duration]:
        warnings.warn(f"the run ends before its events at {late} s.", stacklevel=3)
    if engine.continuous:
        drive: Any = partial(run_continuous, ideal_acceleration=engine.ideal_acceleration)
    else:
        drive = partial(run, sensors=None if sensors.perfect else simulated)
    stream = drive(
        plant,
        controller,
        trajectory,
        dt=dt,
        duration=duration,
        state=state,
        events=events,
    )
    live = progress == "live"
    name = title or true.name
    indices = sample_indices(duration, dt, ends=engine.continuous)
    steps = watched(indices, None if live else progress, name)
    with ExitStack() as stack, np.errstate(all="ignore"):  # a loop that diverges overflows
        if live:
            from ..view.live import LiveView  # here, because it brings a server

            view = LiveView(
                true,
                controller,
                trajectory,
                duration=duration,
                changes=events.changes,
                title=title,
            )
            stream = stack.enter_context(view).watch(stream)
        samples, ended = record(stream, steps, controller, record_every)
    rollout = rollout_of(
        samples,
        plant,
        controller,
        robots,
        announced=events.announcements,
        title=name,
        wall_time=perf_counter() - started,
        path_extent=trajectory.extent,
        **ended,
    )
    if rollout.interrupted is not None:
        raise Interrupted(rollout)
    return rollout


@arithmetic("simulation")
def prepare(
    plant: SimulatedPlant,
    controller: Controller,
    start: LearnedParameters | Mapping[str, ArrayLike | None] | None,
) -> ControllerState:
    """Return the controller's initial state; check that it fits the plant.

    Args:
        plant: to be driven.
        controller: that drives it.
        start: initial estimates, as in ``simulate``.

    Raises:
        InputError: it does not fit, or the initial estimates cannot be used.
    """
    true = plant.robot
    own = controller.kinematics
    ours = true.joint_names, true.frames, true.task.name
    theirs = own.joint_names, own.robot.frames, own.task.name
    if ours != theirs:
        raise InputError(
            f"the true robot (joints, frame, task: {ours}) and the controller's ({theirs}) differ.",
            hint="Make both from the same load(), the true one by .changed().",
        )
    if isinstance(start, LearnedParameters):
        start = start.start(controller)
    given: Any = mapping(start, "start")
    for name in given:
        word(name, _START, "start")
    return controller.init(plant.measure(), **given)


def findings(
    true: Robot,
    controller: Controller,
    engine: Engine,
    sensors: Sensors,
) -> list[str]:
    """Return the findings on period, camera, encoders and motors before a sampled run.

    Args:
        true: the true robot.
        controller: to drive it.
        engine: what moves the true robot.
        sensors: of the true robot.
    """
    if engine.continuous:
        return []
    dt = engine.period(controller)
    motors = engine.motors(true)
    quality = sensors.quality(true.model.nv, dt)
    found = [*preflight(controller, dt, engine.actuators), *sensor_findings(controller, quality)]
    words = [str(each) for each in found]
    if motors is not None and controller.compensation is None:
        words += filter(None, [overloaded(true, motors)])
    return words


def after_excitation(
    plant: Plant,
    controller: Controller,
    dt: float,
    sensors: SimulatedSensors | None = None,
) -> dict[str, np.ndarray]:
    """Return the estimates to start from that a ``SmallExcitation`` of all joints of a plant shows.

    A controller of the joints moves it, with the default unknowns and limits. ``a_k`` (p_k) is what
    explains the frames, ``information_k`` (p_k, p_k) their information on it. ``a_d`` (p_d) is the
    estimate of load and arm that the motion has given, if the controller adapts the same
    parameters.

    Args:
        plant: at its home, to which it returns.
        controller: with an unknown tracker or camera.
        dt: period [s].
        sensors: through which the plant is seen; None for perfect ones.

    Raises:
        LogError: the frames show none, see ``find_tracker`` and ``find_camera``.
        DivergedError: the motion diverged.
    """
    robot = controller.kinematics.robot
    seen = controller.sensors
    noise = {name: seen.noise[name] for name in ("q", "v") if name in seen.noise}
    own = make_controller(
        replace(robot, task=JointTask.of_joints(robot.model)),
        dt=dt,
        sensors=Sensors(encoder=seen.encoder, noise=noise),
        limits=Limits(torque=controller.limits.torque),
    )
    motion = SmallExcitation(robot)
    late = 0.0 if seen.camera is None else seen.camera.delay
    samples = list(run(plant, own, motion, dt=dt, duration=motion.duration + late, sensors=sensors))
    plant.reset()
    measurements = [sample.measurement for sample in samples]
    if isinstance(controller.kinematics, CameraKinematics):
        told = find_camera(controller.kinematics, measurements)
        found = {"a_k": told.estimate, "information_k": told.R}
    else:
        found = find_tracker(controller.kinematics, measurements).start
    if own.dynamics.names == controller.dynamics.names:
        found["a_d"] = samples[-1].state.a_d
    return found


def record(
    stream: Iterator[Sample], indices: Iterable[int], controller: Controller, every: int = 1
) -> tuple[list[Sample], dict[str, Any]]:
    """Take a sample for each index and keep those whose index is a multiple of ``every``.

    The last state is kept whole, the others as ``Controller.recorded`` returns them. Samples so far
    are kept if the loop diverges or a ``KeyboardInterrupt`` stops it.

    Returns:
        The samples, and how the run ended, by the names of a ``Rollout``.
    """
    samples = []
    ended: dict[str, Any] = {"diverged": None, "reason": None}
    last = 0.0
    try:
        for k, sample in zip(indices, stream, strict=False):
            last = sample.t
            if k % every == 0:
                whole = sample
                state = controller.recorded(sample.state)
                samples.append(sample if state is sample.state else sample._replace(state=state))
            else:
                kept = samples[-1]
                mean = kept.torque if kept.mean_torque is None else kept.mean_torque
                mean = mean + (sample.torque - mean) / (k % every + 1)
                samples[-1] = kept._replace(mean_torque=mean)
    except DivergedError as error:
        ended |= {"diverged": error.time, "reason": error.reason}
    except KeyboardInterrupt:
        ended["interrupted"] = last  # the time of the last sample
    if samples:
        samples[-1] = whole
    return samples, ended


def rollout_of(
    samples: Sequence[Sample],
    plant: SimulatedPlant,
    controller: Controller,
    robots: Succession,
    *,
    announced: Iterable[float] = (),
    **told: Any,
) -> Rollout:
    """Return the rollout of recorded samples, which are stacked.

    Args:
        samples: of the run.
        plant: what was driven.
        controller: what drove it.
        robots: the true robot, and what it became.
        announced: times of announcements to the controller [s].
        told: what else a ``Rollout`` has: title, times, how it ended.
    """
    robot = robots.robots[0]
    n = plant.nv
    coordinates = robot.task.coordinates

    def column(of: Callable[[Sample], np.ndarray | None], size: int) -> np.ndarray:
        """Return a number of the samples' arrays as one (N, size)."""
        return np.array([of(sample) for sample in samples], dtype=float).reshape(len(samples), size)

    tau = column(lambda s: s.torque, n)
    words = dict(robots.words)
    for time in announced:
        words[time] = f"{words[time]}, announced" if time in words else "announced"
    own, asked = plant.torque_limits, controller.limits.torque
    limits = np.minimum(torque_bounds(own, n), torque_bounds(asked, n))
    adapted = controller.adaptation_d if controller.dynamics.size else controller.adaptation_k
    return Rollout(
        robot=robot.name,
        law=controller.law.name,
        adaptation=adapted.name,
        task=robot.task,
        joint_names=tuple(robot.joint_names),
        kinematic_names=controller.kinematics.names,
        dynamic_names=controller.dynamics.names,
        t=np.array([sample.t for sample in samples]),
        q=column(lambda s: s.truth.q, robot.model.nq),
        v=column(lambda s: s.truth.v, n),
        tau=tau,
        x=column(lambda s: s.truth.x, coordinates),
        x_d=column(lambda s: s.desired.x_d, coordinates),
        a_k=column(lambda s: s.state.a_k, controller.kinematics.size),
        a_d=column(lambda s: s.state.a_d, controller.dynamics.size),
        saturated=(np.abs(tau) >= limits).any(axis=1),
        step_time=float(np.mean([sample.step_time for sample in samples] or [0.0])),
        evaluation=Evaluation(controller, robots, samples),
        marks=tuple(sorted(words.items())),
        bridged=samples[-1].state.bridged if samples else Bridged(),
        **told,
    )
