"""Simulate a closed loop from a true robot to a rollout."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import instance
from ..controller.controller import Controller
from ..controller.state import Sample
from ..exceptions import InputError, Interrupted, did_you_mean
from ..plants.mujoco_file import MujocoFile
from ..plants.mujoco_plant import MujocoPlant
from ..plants.pinocchio_plant import PinocchioPlant
from ..plants.plant import Engine, SimulatedPlant
from ..plants.sensors import Sensors
from ..robot.motors import torque_limits as limits_of
from ..robot.robot import Robot
from ..robot.succession import Succession
from ..rollout.rollout import Rollout
from ..sensing import Camera
from ..trajectories.convert import TrajectoryLike, as_trajectory
from .continuous import run_continuous
from .loop import Events, run, sample_indices
from .prepare import check_options, findings, prepare
from .record import record, rollout_of

_OBJECTS = 1800  # [B] a sample, besides the numbers
_PER_JOINT = 20  # numbers a sample


def check_memory(controller: Controller, samples: int, record_every: int) -> None:
    """Refuse a run whose samples do not fit into the memory that there is.

    Raises:
        InputError: they do not.
    """
    kept = -(-samples // record_every)
    parameters = controller.kinematics.size + controller.dynamics.size
    joints = len(controller.kinematics.joint_names)
    needed = kept * (_OBJECTS + 8 * (parameters + _PER_JOINT * joints))
    room = min(_room(), default=sys.maxsize)
    if needed > room:
        raise InputError(
            f"{kept} samples to keep take about {needed / 1e9:.3g} GB, there are {room / 1e9:.3g}.",
            where="duration",
            hint="Take a shorter duration or a longer dt; in Python record_every keeps fewer.",
        )


def _room() -> Iterator[int]:
    """Return the bounds on this process's memory that the system tells [B], if any."""
    with suppress(OSError, ValueError, AttributeError):  # not every system has these names
        yield os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with suppress(OSError, ValueError, IndexError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        yield next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable")) * 1024
    with suppress(OSError, ValueError):  # "max" where a container has no limit
        yield int(Path("/sys/fs/cgroup/memory.max").read_text())
    with suppress(ImportError):
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY:
            yield soft


Progress = Callable[[range], Iterable[int]]


def watched(indices: range, progress: Progress | bool | None, title: str) -> Iterable[int]:
    """Return the indices of a run's samples, with a bar that grows as they are taken.

    Args:
        indices: of the samples.
        progress: None: a bar where standard error is a terminal, and nothing elsewhere; True: a bar
            everywhere, in a notebook as a widget; False: none; or a function that wraps the
            indices.
        title: stands in front of the bar.
    """
    if callable(progress):
        return progress(indices)
    if not progress and (progress is False or not _on_terminal()):
        return indices
    from tqdm.auto import tqdm  # here, because the library is imported without it

    bar: Iterable[int] = tqdm(indices, desc=title, unit="step", leave=False, mininterval=0.2)
    return bar


def _on_terminal() -> bool:
    """Tell whether standard error is a terminal; a windowed program has none at all."""
    return sys.stderr is not None and sys.stderr.isatty()


ENGINES: dict[str, Engine] = {"pinocchio": PinocchioPlant, "mujoco": MujocoPlant}


def engine_of(engine: str | MujocoFile | Engine) -> Engine:
    """Return what makes plants: a named engine's, MuJoCo's for a model file, or one as it is.

    Raises:
        InputError: no engine has that name, or it is none of these.
    """
    if isinstance(engine, MujocoFile):
        return partial(MujocoPlant, mjcf=engine)
    if callable(engine):
        return engine
    if not isinstance(engine, str) or engine not in ENGINES:
        raise InputError(
            f"must be one of {list(ENGINES)}, a MujocoFile, or what makes a plant, got {engine!r}."
            f"{did_you_mean(str(engine), ENGINES)}",
            where="engine",
        )
    return ENGINES[engine]


def simulate(
    true: Robot,
    controller: Controller,
    trajectory: TrajectoryLike,
    *,
    duration: float = 10.0,
    dt: float = 1e-3,
    mode: str = "sampled",
    engine: str | MujocoFile | Engine = "pinocchio",
    substeps: int | None = None,
    record_every: int = 1,
    acceleration: str = "filtered",
    a_k: ArrayLike | None = None,
    a_d: ArrayLike | None = None,
    noise: Mapping[str, ArrayLike] | None = None,
    delay: float = 0.0,
    camera: Camera | Mapping[str, float | None] | None = None,
    encoder: ArrayLike = 0.0,
    torque_limits: bool | None = None,
    changes: Mapping[float, Robot] | None = None,
    beliefs: Mapping[float, Mapping[str, Any]] | None = None,
    seed: int = 0,
    title: str = "",
    progress: Progress | bool | None = None,
    view: bool = False,
) -> Rollout:
    """Let a controller drive the true robot from its home, at rest.

    Args:
        true: the true robot.
        controller: made for the believed robot; if for one that compensates gravity, so does the
            true one.
        trajectory: the desired motion x_d(t) of the task's coordinates: a ``Trajectory``; any
            object with ``at(t)``; a function of t; or times (N) [s] and positions (N, m). See
            ``trajectories.as_trajectory``.
        duration: s.
        dt: controller period, or integration step in continuous mode [s].
        mode: "sampled" (torque held for dt) or "continuous" (one ODE, Runge-Kutta 4).
        engine: what simulates: "pinocchio", "mujoco", a ``MujocoFile``, which MuJoCo simulates in
            place of the true robot, or what makes a ``SimulatedPlant``, such as a class of them.
        substeps: integration steps a period, sampled mode; None: as many as the plant needs.
        record_every: keep one sample of so many; the loop itself runs at every one.
        acceleration: "filtered", or "ideal": the plant's own, for checking theory.
        a_k: (p_k) initial kinematic estimate [m], by default the believed robot's.
        a_d: (p_d) initial dynamic estimate, by default the believed robot's.
        noise: standard deviations of q, v, x, the angle of a measured pose, and the torque tau, one
            or one a joint, sampled mode; see ``Sensors``.
        delay: s, of the task-space measurement, sampled mode.
        camera: that sees the task frame, sampled mode; its attributes by name, or one.
        encoder: a count of the joints' sensors, one or one a joint [rad or m], sampled mode; see
            ``Encoder``.
        torque_limits: whether the motors clip at the true robot's effort limits; limits of zero or
            infinity are none. By default they do, but not with the ideal acceleration, which is
            that of the unclipped torque: there the controller's own limits are left out too. A
            controller without limits is given these, so that its adaptation rests while they clip.
        changes: time [s] -> the true robot from then on, made from the same ``load`` as ``true``.
        beliefs: time [s] -> what the controller is told then: arguments of ``Controller.believe``
            by name.
        seed: of the noise and of lost frames.
        title: of the rollout.
        progress: None: a bar on a terminal, none elsewhere; True: a bar everywhere, a widget in a
            notebook; False: none; or what wraps the range of samples, as ``tqdm`` does.
        view: show the run in a browser while it goes on, at most in real time, as ``LiveView``.

    Raises:
        InputError: anything that cannot be run; a loop that diverges is no error, see
            ``Rollout.diverged``.
        Interrupted: a ``KeyboardInterrupt`` that carries the rollout so far.
    """
    check_options(mode, acceleration, duration, dt, record_every, seed, title)
    instance(controller, Controller, "controller")
    sensors = Sensors(true, dt, noise=noise, delay=delay, camera=camera, encoder=encoder, seed=seed)
    ideal = acceleration == "ideal"
    _check_together(mode, sensors, ideal and torque_limits is True)
    motors = None if ideal else limits_of(true, torque_limits is not False)
    if ideal or controller.limits.torque is None:
        controller = controller.limited(motors)
    started = perf_counter()
    plant = engine_of(engine)(
        true, torque_limits=motors, compensation=controller.compensation, substeps=substeps
    )
    _check_plant(plant, mode, changes)
    indices = sample_indices(duration, dt, ends=mode == "continuous")
    trajectory = as_trajectory(trajectory, true.task)
    state = prepare(plant, controller, trajectory, a_k, a_d, duration)
    check_memory(controller, len(indices), record_every)
    robots = replace(Succession.of(true, changes), known=plant.described)
    events = Events(changes, beliefs)
    events.check(controller, state)
    if late := events.after(duration):
        warnings.warn(f"the run ends before what happens at {late} s.", stacklevel=2)
    loop = plant, controller, trajectory
    start: dict[str, Any] = {"dt": dt, "state": state, "events": events if events.any else None}
    if isinstance(plant, PinocchioPlant) and mode == "continuous":
        stream = run_continuous(plant, controller, trajectory, ideal_acceleration=ideal, **start)
    else:
        seeing = camera or _late(delay)
        senses: dict[str, Any] = {"camera": seeing, "noise": noise, "encoder": encoder}
        for finding in findings(true, controller, dt, **senses, motors=motors):
            warnings.warn(finding, stacklevel=2)
        seen = None if sensors.perfect else sensors
        stream = run(*loop, sensors=seen, ideal_acceleration=ideal, **start)
    shown = {"duration": duration, "changes": changes, "title": title} if view else None
    with np.errstate(all="ignore"), _shown_live(stream, loop, shown) as samples:  # may overflow
        kept = record(samples, watched(indices, progress, title or true.name), record_every)
    rollout = rollout_of(
        kept,
        plant,
        controller,
        robots,
        told=events.beliefs,
        title=title or true.name,
        wall_time=perf_counter() - started,
        extent=trajectory.extent,
    )
    if rollout.interrupted is not None:
        raise Interrupted(rollout)
    return rollout


def _check_together(mode: str, sensors: Sensors, clipped: bool) -> None:
    """Refuse what cannot be simulated at once.

    Raises:
        InputError: sensors in continuous mode, or an ideal acceleration of a clipped torque.
    """
    if mode == "continuous" and not sensors.perfect:
        raise InputError(
            "noise, delay, camera and encoder exist in sampled mode only.", where="mode"
        )
    if clipped:
        raise InputError(
            "the ideal acceleration is that of the unclipped torque; choose one.",
            where="torque_limits",
        )


def _check_plant(plant: SimulatedPlant, mode: str, changes: Mapping[float, Robot] | None) -> None:
    """Refuse what only some plants can do.

    Raises:
        InputError: one differential equation of another engine, or changes of a file's robot.
    """
    if mode == "continuous" and not isinstance(plant, PinocchioPlant):
        raise InputError(
            f"{type(plant).__name__} moves in samples; only Pinocchio's equations can be "
            "integrated as one with the controller's.",
            where="mode",
            hint='Take mode = "sampled", or engine = "pinocchio".',
        )
    if changes and not plant.described:
        raise InputError(
            "the robot of a model file does not change while it moves.", where="changes"
        )


@contextmanager
def _shown_live(
    stream: Iterator[Sample], loop: tuple[Any, Any, Any], shown: Mapping[str, Any] | None
) -> Iterator[Iterator[Sample]]:
    """Give a stream, shown in a live view with these options unless they are None."""
    if shown is None:
        yield stream
        return
    from ..view.live import LiveView

    plant, controller, trajectory = loop
    with LiveView(plant.robot, controller, trajectory, **shown) as view:
        yield view.watch(stream)


def _late(delay: float) -> Camera | None:
    """Return a camera at full rate that is late [s], or None."""
    return Camera(delay=delay) if delay else None
