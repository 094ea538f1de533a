"""The closed loop as one ordinary differential equation."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..controller.controller import Controller
from ..controller.state import ControllerState
from ..exceptions import DivergedError
from ..plants.pinocchio_plant import LARGEST_SPEED, PinocchioPlant
from ..records import Desired, Measurement
from ..trajectories.trajectory import Trajectory
from .trace import Trace


def run_continuous(
    plant: PinocchioPlant,
    controller: Controller,
    trajectory: Trajectory,
    state: ControllerState,
    *,
    times: Iterable[int],
    dt: float,
    record_every: int = 1,
    ideal_acceleration: bool = False,
) -> Trace:
    """Integrate plant, estimates and filters together by Runge-Kutta of fourth order.

    Args:
        plant: the true robot, started at its home and at rest.
        controller: the controller.
        trajectory: the desired motion.
        state: the controller's initial state.
        times: indices of the samples; index k is time k dt.
        dt: integration step [s].
        record_every: record the samples whose index is a multiple of this.
        ideal_acceleration: give the law the plant's own acceleration instead of the filtered one.
    """
    loop = _Loop(plant, controller, ideal_acceleration, plant.robot.q0, state)
    y = np.concatenate([np.zeros(2 * plant.nv), state.flat()])
    trace = Trace()
    for k in times:
        t = k * dt
        desired = trajectory.at(t)
        try:
            k1 = loop.slope(y, desired)
            if not np.isfinite(k1).all():
                raise DivergedError("the torque or the estimates are no longer finite.")
            controller.watch(loop.torque, loop.state.a_d, loop.state.a_k)
            if k % record_every == 0:
                trace.add(t, loop.measurement, desired, loop.measurement, loop.state, loop.torque)
            middle = trajectory.at(t + 0.5 * dt)
            k2 = loop.slope(y + (0.5 * dt) * k1, middle)
            k3 = loop.slope(y + (0.5 * dt) * k2, middle)
            k4 = loop.slope(y + dt * k3, trajectory.at(t + dt))
        except (DivergedError, np.linalg.LinAlgError) as error:
            trace.end(t, str(error))
            break
        try:
            y = loop.rebased(y + (dt / 6.0) * (k1 + 2.0 * (k2 + k3) + k4))
        except DivergedError as error:
            trace.end(t + dt, str(error))
            break
        if not np.abs(y[plant.nv : 2 * plant.nv]).max() < LARGEST_SPEED:  # also true for NaN
            trace.end(t + dt, "the joint velocities left every bound.")
            break
    return trace


class _Loop:
    """The right-hand side dy/dt for y = (displacement from q, v, controller state).

    Attributes:
        measurement, state, torque: as the last evaluation had them.
    """

    def __init__(
        self,
        plant: PinocchioPlant,
        controller: Controller,
        ideal_acceleration: bool,
        q: np.ndarray,
        state: ControllerState,
    ) -> None:
        self._plant, self._controller, self._ideal = plant, controller, ideal_acceleration
        self._q, self.state = q, state
        self.measurement: Measurement
        self.torque: np.ndarray

    def rebased(self, y: np.ndarray) -> np.ndarray:
        """Move q by the displacement in y and return y without it; exact because one-joint groups commute.

        The estimate becomes the one that the adaptation keeps there: a projection is a jump, not a
        slope.
        """
        n = self._plant.nv
        self._q = self._plant.integrate(self._q, y[:n])
        state = self.state.with_flat(y[2 * n :])
        kept = self._controller.adaptation_d.project(state.a_d, self._q)
        rest = (
            y[2 * n :]
            if kept is state.a_d
            else state._replace(dynamic=state.dynamic._replace(value=kept)).flat()
        )
        return np.concatenate([np.zeros(n), y[n : 2 * n], rest])

    def slope(self, y: np.ndarray, desired: Desired) -> np.ndarray:
        """Return dy/dt."""
        plant, controller, n = self._plant, self._controller, self._plant.nv
        q, v = plant.integrate(self._q, y[:n]), y[n : 2 * n]
        self.state = self.state.with_flat(y[2 * n :])
        self.measurement = plant.measurement(q, v)
        signals, command = controller.command(self.state, self.measurement, desired)
        if self._ideal:
            a_law = plant.acceleration(q, v, command.torque, command.feedthrough)
        else:
            a_law = controller.acceleration(signals, self.measurement)
        tau, drives = controller.respond(signals, command, a_law)
        self.torque = plant.motors(tau)
        a = a_law if self._ideal else plant.acceleration(q, v, self.torque)
        return np.concatenate([v, a, controller.rate(self.state, signals, drives).flat()])
