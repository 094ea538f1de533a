"""The closed loop as it runs on a robot: a controller at a fixed period, a plant in between."""

from __future__ import annotations

from collections.abc import Iterable
from time import perf_counter

import numpy as np

from ..controller.controller import Controller
from ..controller.state import ControllerState
from ..exceptions import DivergedError
from ..plants.pinocchio_plant import LARGEST_SPEED, PinocchioPlant
from ..plants.sensors import Sensors
from ..records import Desired, Measurement
from ..trajectories.trajectory import Trajectory
from .trace import Trace


def run_sampled(
    plant: PinocchioPlant,
    controller: Controller,
    trajectory: Trajectory,
    state: ControllerState,
    *,
    times: Iterable[int],
    dt: float,
    sensors: Sensors,
    substeps: int = 4,
    record_every: int = 1,
    ideal_acceleration: bool = False,
) -> Trace:
    """Hold each torque for dt while the plant is integrated in substeps.

    Args:
        plant: the true robot, started at its home and at rest.
        controller: the controller.
        trajectory: the desired motion.
        state: the controller's initial state.
        times: indices of the samples; index k is time k dt.
        dt: controller period [s].
        sensors: what the controller sees.
        substeps: integration steps a period.
        record_every: record the samples whose index is a multiple of this.
        ideal_acceleration: give the law the plant's own acceleration instead of the filtered one.
    """
    q, v = plant.robot.q0, np.zeros(plant.nv)
    trace = Trace()
    for k in times:
        t = k * dt
        measurement, truth = sensors.measure(q, v)
        desired = trajectory.at(t)
        try:
            if ideal_acceleration:
                measurement = _with_ideal_acceleration(
                    plant, controller, state, measurement, desired
                )
            started = perf_counter()
            tau, after = controller.step(state, measurement, desired, dt)
            trace.step_time += perf_counter() - started
            trace.steps += 1
        except DivergedError as error:
            trace.end(t, str(error))
            break
        tau = plant.motors(tau)
        if k % record_every == 0:
            trace.add(t, measurement, desired, truth, state, tau)
        state = after
        for _ in range(substeps):
            q, v = plant.advance(q, v, tau, dt / substeps)
        if not np.abs(v).max() < LARGEST_SPEED:  # also true for NaN
            trace.end(t + dt, "the joint velocities left every bound.")
            break
    return trace


def _with_ideal_acceleration(
    plant: PinocchioPlant,
    controller: Controller,
    state: ControllerState,
    measurement: Measurement,
    desired: Desired,
) -> Measurement:
    """Return the measurement with the acceleration that the coming torque will cause."""
    _, command = controller.command(state, measurement, desired)
    a = plant.acceleration(measurement.q, measurement.v, command.torque, command.feedthrough)
    return measurement._replace(a=a)
