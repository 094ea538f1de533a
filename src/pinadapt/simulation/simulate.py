"""Run a closed loop."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive
from ..adaptation.box_projection import BoxProjection
from ..controller.controller import Controller
from ..controller.state import ControllerState
from ..exceptions import InputError, did_you_mean
from ..plants.pinocchio_plant import PinocchioPlant
from ..plants.sensors import Sensors
from ..robot.effort_limits import torque_limits as limits_of
from ..robot.home import conditioning
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from ..trajectories.trajectory import Trajectory
from ..tuning.preflight import preflight
from .continuous import run_continuous
from .evaluate import evaluate
from .sampled import run_sampled

MODES = ("sampled", "continuous")
ACCELERATIONS = ("filtered", "ideal")
Progress = Callable[[range], Iterable[int]]


def simulate(
    true: Robot,
    controller: Controller,
    trajectory: Trajectory,
    *,
    duration: float = 10.0,
    dt: float = 1e-3,
    mode: str = "sampled",
    substeps: int = 4,
    record_every: int = 1,
    acceleration: str = "filtered",
    a_k: ArrayLike | None = None,
    a_d: ArrayLike | None = None,
    noise: Mapping[str, float] | None = None,
    delay: float = 0.0,
    torque_limits: bool = False,
    seed: int = 0,
    title: str = "",
    progress: Progress | None = None,
) -> Rollout:
    """Let a controller drive the true robot from its home, at rest.

    Args:
        true: the true robot.
        controller: made for the believed robot.
        trajectory: the desired motion.
        duration: s.
        dt: controller period, or integration step in continuous mode [s].
        mode: "sampled" (torque held for dt) or "continuous" (one ODE, Runge-Kutta 4).
        substeps: integration steps a period, sampled mode.
        record_every: keep one sample of so many; the loop itself runs at every one.
        acceleration: "filtered", or "ideal": the plant's own, for checking theory.
        a_k: (p_k) initial kinematic estimate [m], by default the believed robot's.
        a_d: (p_d) initial dynamic estimate, by default the believed robot's.
        noise: standard deviations of q, v, x, and the angle of a measured pose, sampled mode.
        delay: s, of the task-space measurement, sampled mode.
        torque_limits: the motors clip at the true robot's effort limits; limits of zero or infinity
            are none. A controller without limits of its own is given these, so that its adaptation
            rests while they clip.
        seed: of the noise.
        title: of the rollout.
        progress: wraps the range of samples, ``tqdm`` for example.

    Raises:
        InputError: anything that cannot be run; a loop that diverges is no error, see
            ``Rollout.diverged``.
    """
    ideal = _one_of(acceleration, ACCELERATIONS, "acceleration") == "ideal"
    _check_options(mode, duration, dt, {"substeps": substeps, "record_every": record_every}, seed)
    if mode == "continuous" and (delay or any((noise or {}).values())):
        raise InputError("noise and delay exist in sampled mode only.", where="mode")
    motors = limits_of(true, torque_limits)
    if controller.limits.torque is None:
        controller = controller.limited(motors)
    if ideal and (torque_limits or controller.limits.torque is not None):
        raise InputError(
            "the ideal acceleration is that of the unclipped torque; choose one.",
            where="torque_limits",
        )
    started = perf_counter()
    plant, state = prepare(true, controller, trajectory, a_k, a_d)
    plant.torque_limits = motors
    samples = range(max(1, round(duration / dt)) + (mode == "continuous"))
    times = samples if progress is None else progress(samples)
    loop: dict[str, Any] = {
        "times": times,
        "dt": dt,
        "record_every": int(record_every),
        "ideal_acceleration": ideal,
    }
    with np.errstate(
        over="ignore", invalid="ignore", divide="ignore"
    ):  # a loop that diverges overflows on its way
        if mode == "continuous":
            trace = run_continuous(plant, controller, trajectory, state, **loop)
        else:
            for finding in preflight(controller, dt):
                warnings.warn(str(finding), stacklevel=2)
            loop["sensors"] = Sensors(plant, dt, noise=noise, delay=delay, seed=seed)
            trace = run_sampled(
                plant, controller, trajectory, state, substeps=int(substeps), **loop
            )
        return evaluate(
            trace,
            plant,
            controller,
            title=title or true.name,
            adaptation=_words(controller),
            wall_time=perf_counter() - started,
        )


def prepare(
    true: Robot,
    controller: Controller,
    trajectory: Trajectory,
    a_k: ArrayLike | None = None,
    a_d: ArrayLike | None = None,
) -> tuple[PinocchioPlant, ControllerState]:
    """Return the plant and the controller's initial state, after checking that robot, controller and motion match.

    Raises:
        InputError: they do not, or the initial estimates cannot be used.
    """
    _check_same_shape(true, controller, trajectory)
    plant, v = PinocchioPlant(true), np.zeros(true.model.nv)
    first = plant.measurement(true.q0, v)
    if (
        conditioning(true.model, true.model.createData(), true.frame_id, true.task.rows, true.q0)[1]
        < 1e-6
    ):
        raise InputError(
            f"the robot starts in a singularity: at {true.home_angles.round(4).tolist()} it cannot move all of its task.",
            where="robot.q0",
            hint="Bend a joint, or leave q0 out to have a pose searched.",
        )
    _warn_of_box(true, controller)
    return plant, controller.init(first, a_k=_array(a_k), a_d=_array(a_d))


def _warn_of_box(true: Robot, controller: Controller) -> None:
    """Say so when the box of the kinematic estimates does not hold the truth."""
    box, truth = controller.adaptation_k, controller.kinematics.value(true)
    if truth is None or not isinstance(box, BoxProjection):
        return
    outside = (truth < box.low) | (truth > box.high)
    if outside.any():
        names = [
            name for name, out in zip(controller.kinematics.names, outside, strict=True) if out
        ]
        warnings.warn(
            f"the true values of {names} are outside the box of their estimates, which cannot reach them: no proof covers this "
            "closed loop. A wider kinematic_box avoids it.",
            stacklevel=4,
        )


def _check_options(
    mode: str, duration: float, dt: float, counts: Mapping[str, int], seed: int
) -> None:
    """Refuse numbers that make no run."""
    _one_of(mode, MODES, "mode")
    if positive(duration, "duration") < 0.5 * positive(dt, "dt"):
        raise InputError(
            f"must be at least one period of {dt} s, got {duration}.", where="duration"
        )
    for name, count in counts.items():
        if int(count) < 1:
            raise InputError(f"must be at least 1, got {count}.", where=name)
    if int(seed) < 0:
        raise InputError(f"must not be negative, got {seed}.", where="seed")


def _array(value: ArrayLike | None) -> np.ndarray | None:
    return None if value is None else np.atleast_1d(np.array(value, dtype=float))


def _words(controller: Controller) -> str:
    """Return the name of the dynamic adaptation, or of the kinematic one where no dynamic parameter is unknown."""
    return (
        controller.adaptation_d.name if controller.dynamics.size else controller.adaptation_k.name
    )


def _one_of(value: str, allowed: tuple[str, ...], where: str) -> str:
    if value not in allowed:
        raise InputError(
            f"must be one of {list(allowed)}, got {value!r}.{did_you_mean(str(value), allowed)}",
            where=where,
        )
    return value


def _check_same_shape(true: Robot, controller: Controller, trajectory: Trajectory) -> None:
    kinematics = controller.kinematics
    believed = kinematics.task
    ours = (true.joint_names, true.frame, true.task.name)
    theirs = (kinematics.joint_names, kinematics.frame, believed.name)
    if ours != theirs:
        raise InputError(
            f"the true robot (joints, frame, task: {ours}) and the controller's ({theirs}) differ.",
            hint="Make both from the same load(), the true one by .changed().",
        )
    size = trajectory.at(0.0).x_d.size
    if size != believed.coordinates:
        raise InputError(
            f"the desired motion has {size} coordinates, the task '{believed.name}' {believed.coordinates}.",
            where="trajectory",
            hint="PoseTrajectory adds an orientation to a motion of three coordinates."
            if (size, believed.name) == (3, "pose")
            else None,
        )
