"""The closed loop: sampled, with the events of a run, or as one ordinary differential equation."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from itertools import count
from time import perf_counter
from typing import Any

import numpy as np

from .._checks import instance, located, positive, word
from ..controller.controller import Controller
from ..controller.governor import PathTime
from ..controller.limits import ABSURD
from ..controller.state import ControllerState, Sample
from ..exceptions import (
    ContactError,
    DivergedError,
    ImplausibleError,
    InputError,
    PinadaptError,
)
from ..laws import DEFAULT
from ..plants.pinocchio_plant import PinocchioPlant
from ..plants.plant import Plant, SimulatedPlant
from ..plants.sensors import SimulatedSensors
from ..records import Measurement
from ..robot.robot import EARLY, Robot, in_time
from ..trajectories.given import TrajectoryLike, as_trajectory
from ..trajectories.trajectory import Trajectory

ANNOUNCED = ("payload", "tool_translation")


class Events:
    """Changes of the true robot, and announcements to the controller, each at its time.

    Both take effect at the first sample at or after their time, a change before an announcement.

    Attributes:
        changes: time [s] -> the true robot from then on, made from the same ``load`` as the first.
        announcements: time [s] -> the arguments of ``Controller.announce`` by name: a payload or a
            tool that the controller is informed of.
    """

    def __init__(
        self,
        changes: Mapping[float, Robot] | None = None,
        announcements: Mapping[float, Mapping[str, Any]] | None = None,
    ) -> None:
        """Take events in any order.

        Raises:
            InputError: times that are not positive and finite, or announcements that
                ``Controller.announce`` does not take.
        """
        self.changes = in_time(changes, "events.changes")
        self.announcements = in_time(announcements, "events.announcements")
        for time, announced in self.announcements.items():
            where = f"events.announcements[{time:g}]"
            for name in instance(announced, Mapping, where):
                word(name, ANNOUNCED, where)

    def check(self, controller: Controller, state: ControllerState) -> None:
        """Refuse announcements that the parameters of a controller cannot express.

        Raises:
            InputError: as ``Controller.announce``.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are shown at the time of the event
            for time, announced in self.announcements.items():
                with located(f"events.announcements[{time:g}]", ANNOUNCED):
                    state = controller.announce(state, **announced)

    def happen(
        self,
        plant: Plant,
        controller: Controller,
        state: ControllerState,
        before: float,
        now: float,
    ) -> ControllerState:
        """Change the plant, and return the state, by what is due from ``before`` to ``now`` [s].

        Raises:
            InputError: as ``Plant.become``.
        """
        for at, robot in self.changes.items():
            if before < at - EARLY <= now:
                plant.become(robot)
        for at, announced in self.announcements.items():
            if before < at - EARLY <= now:
                state = controller.announce(state, **announced)
        return state


# Longest time [s] to bring an arm to rest, and speed [rad/s or m/s] below which it rests. Half or
# twice: arms 20 % heavier than described rest in half a second whatever the time; by the speed they
# rest up to 0.06 s later or sooner, planar_2r up to 0.3 s, and with half of it an arm whose driver
# froze is left before it rests.
_DAMP, STILL = 1.5, 0.02


def run(
    plant: Plant,
    controller: Controller,
    trajectory: TrajectoryLike,
    *,
    dt: float = 1e-3,
    duration: float | None = None,
    state: ControllerState | None = None,
    sensors: SimulatedSensors | None = None,
    events: Events | None = None,
) -> Iterator[Sample]:
    """Drive a plant from its initial state; yield a sample each period, before the plant moves on.

    Args:
        plant: what is driven; it is reset first.
        controller: the controller.
        trajectory: the desired motion, as in ``simulate``, but exactly as it is: with its own speed
            and place at time 0. ``reference.starting_from`` returns one that begins where the robot
            is, at rest.
        dt: controller period, for which each torque is held [s].
        duration: s; None for as long as samples are taken from the iterator.
        state: the controller's initial state, as of ``init``; None: at the first measurement.
        sensors: through which the controller sees the plant; None for perfect ones.
        events: changes of the plant, and announcements to the controller; None for none.

    Yields:
        One sample a period.

    After an error of the controller or a divergence, a plant that is not simulated is first brought
    to rest by ``Controller.safe``.

    Raises:
        DivergedError: the loop diverged, at its ``time`` and for its ``reason``, a guard's
            ``ImplausibleError`` among them; all samples before were yielded.
        InputError: a law for a set point, and a motion that does not come to rest.
        InputError, MeasurementError: as ``Controller.init`` and ``Controller.step``, and as
            ``Plant.become`` and ``Controller.announce`` where there are events.
    """
    positive(dt, "dt")
    instance(plant, Plant, "plant")
    if not hasattr(controller, "step") or not hasattr(controller, "init"):
        instance(controller, Controller, "controller")  # any other with these two will do
    trajectory = usable_trajectory(controller, trajectory, duration)
    instance(sensors, SimulatedSensors | None, "sensors")
    events = instance(Events() if events is None else events, Events, "events")
    plant.reset()
    if sensors is not None:
        sensors.reset()
    given = None
    governed = getattr(controller, "desired", lambda state, motion, t: motion.at(t))
    for _ in count() if duration is None else sample_indices(duration, dt):
        truth = plant.measure()
        measurement = truth if sensors is None else sensors.measure(truth, given)
        if state is None:
            state = controller.init(measurement)
        try:
            _check_speed(truth.v, truth.t)
            desired = governed(state, trajectory, truth.t)
            started = perf_counter()
            torque, after = controller.step(state, measurement, desired, dt)
            step_time = perf_counter() - started
        except (PinadaptError, np.linalg.LinAlgError) as error:
            _bring_to_rest(plant, controller, state, measurement, dt)
            raise ended(error, truth.t) from error
        given = plant.motors(torque.copy())  # the sample is the caller's, the torque the plant's
        yield Sample(truth.t, measurement, desired, state, given, truth, step_time)
        plant.step(torque, dt)
        state = events.happen(plant, controller, after, truth.t, truth.t + dt)


def usable_trajectory(
    controller: Any, given: TrajectoryLike, duration: float | None = None
) -> Trajectory:
    """Return a motion as a ``Trajectory`` that suits the controller's task and law.

    Args:
        controller: a ``Controller``, or any object with ``init`` and ``step``, of whose task and
            law nothing is known.
        given: as ``as_trajectory`` takes it.
        duration: of the run [s]; None for a run without end.

    Raises:
        InputError: it is no motion, has not the coordinates of the task, is not finite at its
            start, or does not come to rest where the law is for a set point.
    """
    kinematics = getattr(controller, "kinematics", None)
    law = getattr(controller, "law", None)
    trajectory = as_trajectory(given, None if kinematics is None else kinematics.task)
    if law is None or not law.set_point or trajectory.settles is not None:
        return trajectory
    last = trajectory.at(60.0 if duration is None else duration)  # [s]
    if max(np.abs(last.xd_d).max(), np.abs(last.xdd_d).max()) < 1e-6:
        return trajectory
    raise InputError(
        f"the law '{law.name}' is for a set point, and the desired motion does not come to rest.",
        where="trajectory",
        hint='Take "hold" or "waypoints" (Hold, Waypoints, or a motion of your own that ends at '
        f"rest), or the law '{DEFAULT}', which follows motions.",
    )


def _check_speed(v: np.ndarray, t: float) -> None:
    """Refuse joint velocities v (nv) at t [s] that no robot has.

    Raises:
        DivergedError: they are absurd, or NaN.
    """
    if not v.dot(v) < ABSURD**2:
        raise DivergedError(f"the joint velocities exceed {ABSURD:g} rad/s or m/s.", t)


def _bring_to_rest(
    plant: Plant,
    controller: Controller,
    state: ControllerState,
    measurement: Measurement,
    dt: float,
) -> None:
    """Bring an arm to rest after a sample that ends its loop; see ``Controller.safe``.

    An arm of which nothing is measured any more is left to its own stop, and so is a simulated one.
    """
    if isinstance(plant, SimulatedPlant) or not isinstance(controller, Controller):
        return
    for _ in range(round(_DAMP / dt)):
        torque, state = controller.safe(state, measurement)
        plant.step(torque, dt)
        if np.abs(state.sensed.v).max() < STILL or state.unseen.any():
            break
        measurement = plant.measure()


def ended(error: Exception, t: float) -> Exception:
    """Return what ends a loop at t [s] for an error of its controller.

    A desired motion that cannot be used is an input to be refused at the start; later the loop has
    run until then.
    """
    if isinstance(error, ImplausibleError):
        return DivergedError(f"measurement '{error.field}' {error.flaw}.", t)
    if isinstance(error, ContactError):
        error.time = t
        return error
    late = isinstance(error, InputError) and t > 0.0
    if late or isinstance(error, DivergedError | np.linalg.LinAlgError):
        return DivergedError(" ".join(str(error).split()), t)
    return error


def sample_indices(duration: float, dt: float, *, ends: bool = False) -> range:
    """Return the sample indices of a duration [s] at period dt [s]; ``ends``: with its end.

    Raises:
        InputError: numbers that are not positive.
    """
    return range(max(1, round(positive(duration, "duration") / positive(dt, "dt"))) + ends)


def run_continuous(
    plant: PinocchioPlant,
    controller: Controller,
    trajectory: TrajectoryLike,
    *,
    dt: float,
    duration: float | None = None,
    state: ControllerState | None = None,
    ideal_acceleration: bool = False,
    events: Events | None = None,
) -> Iterator[Sample]:
    """Integrate plant, estimates and filters together by Runge-Kutta 4; yield a sample each step.

    Args:
        plant: the true robot, which starts from its home and from rest.
        controller: the controller.
        trajectory: the desired motion, exactly as it is, as in ``run``.
        dt: integration step [s].
        duration: s, whose end has a sample of its own; None for as long as samples are taken.
        state: the controller's initial state, as of ``init``; None: at the first measurement.
        ideal_acceleration: give the law the plant's own acceleration instead of the filtered one.
        events: changes of the plant, and announcements to the controller; None for none.

    Yields:
        One sample a step.

    Raises:
        DivergedError: the loop diverged, at its ``time`` and for its ``reason``; all samples before
            were yielded.
    """
    trajectory = usable_trajectory(controller, trajectory, duration)
    q = plant.robot.q0
    if state is None:
        state = controller.init(plant.measurement(q, np.zeros(plant.nv)))
    if state.start is not None:  # samples are what it waits for
        governed = controller.limits.governor is not None
        state = state._replace(start=None, path=PathTime() if governed else None)
    events = events or Events()
    n = plant.nv

    def slope(
        y: np.ndarray, t: float, before: ControllerState
    ) -> tuple[np.ndarray, Sample, ControllerState]:
        """Return dy/dt for y = (displacement from q, v, controller state), and the sample there.

        The state after it has the cause of the path's rate; its numbers are those of the next y.
        """
        displacement, v, flat = np.split(y, [n, 2 * n])
        place = plant.integrate(q, displacement)
        state = before.with_flat(flat)
        seen = plant.measurement(place, v, t)
        desired = controller.desired(state, trajectory, t)
        signals, command = controller.command(state, seen, desired)
        if ideal_acceleration:
            a = plant.acceleration_at(place, v, command.torque, command.feedthrough)
            tau, drives = controller.respond(state, signals.replaced(a=a))
            torque = plant.motors_at(place, tau)
        else:
            tau, drives = controller.sent(signals, command)
            torque = plant.motors_at(place, tau)
            a = plant.acceleration_at(place, v, torque)
        rate = controller.rate(state, signals, drives, torque)
        sample = Sample(t, seen, desired, state, torque, seen)
        return np.concatenate([v, a, rate.flat()]), sample, state._replace(path=rate.path)

    v = np.zeros(n)
    for k in count() if duration is None else sample_indices(duration, dt, ends=True):
        t = k * dt
        after = (k + 1) * dt
        y = np.concatenate([np.zeros(n), v, state.flat()])
        try:
            k1, sample, state = slope(y, t, state)
            if not np.isfinite(k1).all():
                raise DivergedError("the torque or the estimates are no longer finite.")
            controller.watch(sample.torque, sample.state.a_d, sample.state.a_k)
            yield sample
            k2, _, state = slope(y + (0.5 * dt) * k1, t + 0.5 * dt, state)
            k3, _, state = slope(y + (0.5 * dt) * k2, t + 0.5 * dt, state)
            k4, _, state = slope(y + dt * k3, t + dt, state)
        except (PinadaptError, np.linalg.LinAlgError) as error:
            raise ended(error, t) from error
        y = y + (dt / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
        displacement, v, flat = np.split(y, [n, 2 * n])
        _check_speed(v, after)
        q = plant.integrate(q, displacement)  # exact, as one-joint groups commute
        state = state.with_flat(flat)
        # the estimate that the adaptation keeps there: a projection is a jump, not a slope
        kept = controller.adaptation_d.project(state.dynamic, q)
        state = state._replace(dynamic=state.dynamic.with_value(kept))
        state = events.happen(plant, controller, state, t, after)
