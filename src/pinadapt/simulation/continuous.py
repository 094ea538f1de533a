"""The closed loop as one ordinary differential equation."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np

from ..controller.controller import Controller
from ..controller.state import ControllerState, Sample
from ..exceptions import DivergedError, ImplausibleError, InputError
from ..plants.pinocchio_plant import PinocchioPlant
from ..records import Desired, Measurement
from ..trajectories.given import TrajectoryLike
from ..trajectories.trajectory import Trajectory
from .loop import FASTEST, Events, lost, sample_indices, unusable
from .prepare import usable_trajectory


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
        state: the controller's initial state; None for its own at the first measurement.
        ideal_acceleration: give the law the plant's own acceleration instead of the filtered one.
        events: changes of the plant, and announcements to the controller; None for none.

    Yields:
        One sample a step.

    Raises:
        DivergedError: the loop diverged, at its ``time`` and for its ``reason``; all samples before
            were yielded.
    """
    trajectory = usable_trajectory(controller, trajectory, duration)
    loop = _Loop(plant, controller, trajectory, ideal_acceleration, state)
    y = loop.start()
    for k in count() if duration is None else sample_indices(duration, dt, ends=True):
        t = k * dt
        try:
            k1 = loop.slope(y, t)
            if not np.isfinite(k1).all():
                raise DivergedError("the torque or the estimates are no longer finite.")
            controller.watch(loop.torque, loop.state.a_d, loop.state.a_k)
            yield loop.sample(t)
            k2 = loop.slope(y + (0.5 * dt) * k1, t + 0.5 * dt)
            k3 = loop.slope(y + (0.5 * dt) * k2, t + 0.5 * dt)
            k4 = loop.slope(y + dt * k3, t + dt)
        except ImplausibleError as error:
            raise DivergedError(lost(error, real=True), t) from error
        except InputError as error:
            raise unusable(error, t) from error
        except (DivergedError, np.linalg.LinAlgError) as error:
            raise DivergedError(str(error), t) from error
        try:
            y = loop.rebased(y + (dt / 6.0) * (k1 + 2.0 * (k2 + k3) + k4))
        except DivergedError as error:
            raise DivergedError(error.reason, t + dt) from error
        if events is not None:
            y = loop.interrupted(y, events, t, (k + 1) * dt)


class _Loop:
    """The right-hand side dy/dt for y = (displacement from q, v, controller state).

    Attributes:
        measurement, desired, state, torque: as the last evaluation had them.
    """

    def __init__(
        self,
        plant: PinocchioPlant,
        controller: Controller,
        trajectory: Trajectory,
        ideal_acceleration: bool,
        state: ControllerState | None,
    ) -> None:
        self._plant, self._controller, self._trajectory = plant, controller, trajectory
        self._ideal = ideal_acceleration
        self._q = plant.robot.q0
        self.measurement: Measurement = plant.measurement(self._q, np.zeros(plant.nv))
        self.state = controller.init(self.measurement) if state is None else state
        self._filled, self._cause = self.state.filler(), ""
        self.desired: Desired
        self.torque: np.ndarray

    def start(self) -> np.ndarray:
        """Return y at the beginning: at home, at rest."""
        return np.concatenate([np.zeros(2 * self._plant.nv), self.state.flat()])

    def sample(self, t: float) -> Sample:
        """Return the last evaluation as the sample of time t [s]."""
        return Sample(t, self.measurement, self.desired, self.state, self.torque, self.measurement)

    def rebased(self, y: np.ndarray) -> np.ndarray:
        """Move q by the displacement in y and return y without it.

        Exact because one-joint groups commute. The estimate becomes the one that the adaptation
        keeps there: a projection is a jump, not a slope.

        Raises:
            DivergedError: the joints move too fast.
        """
        n = self._plant.nv
        v = y[n : 2 * n]
        if not v.dot(v) < FASTEST**2:  # also true for NaN
            raise DivergedError(f"the joint velocities exceed {FASTEST:g} rad/s or m/s.")
        self._q = self._plant.integrate(self._q, y[:n])
        state = self._filled(y[2 * n :])
        kept = self._controller.adaptation_d.project(state.dynamic, self._q)
        if kept is not state.a_d:
            state = state._replace(dynamic=state.dynamic.with_value(kept))
        return np.concatenate([np.zeros(n), v, state.flat()])

    def interrupted(self, y: np.ndarray, events: Events, before: float, now: float) -> np.ndarray:
        """Return y after the events from ``before`` to ``now`` [s], of the plant as well."""
        events.change(self._plant, before, now)
        state = self.state.with_flat(y[2 * self._plant.nv :])
        self.state = events.announce(self._controller, state, before, now)
        self._filled = self.state.filler()
        return np.concatenate([y[: 2 * self._plant.nv], self.state.flat()])

    def slope(self, y: np.ndarray, t: float) -> np.ndarray:
        """Return dy/dt at time t [s].

        Raises:
            InputError: the desired motion is not finite.
        """
        plant, controller, n = self._plant, self._controller, self._plant.nv
        q, v = plant.integrate(self._q, y[:n]), y[n : 2 * n]
        self.state = state = self._filled(y[2 * n :])
        if state.path is not None:
            self.state = state._replace(path=state.path._replace(cause=self._cause))
        self.measurement = plant.measurement(q, v, t)
        self.desired = controller.desired(self.state, self._trajectory, t)
        if not np.isfinite(np.concatenate(self.desired)).all():
            raise InputError(f"the motion is not finite: {self.desired}.", where="desired")
        if self._ideal:
            signals, command = controller.command(self.state, self.measurement, self.desired)
            a = plant.acceleration_at(q, v, command.torque, command.feedthrough)
            if controller.law.uses_acceleration:
                tau, drives = controller.respond(self.state, signals.replaced(a=a))
            else:
                tau, drives = controller.sent(signals, command)
            self.torque = plant.motors_at(q, tau)
        else:
            signals = controller.observe(self.state, self.measurement, self.desired)
            tau, drives = controller.respond(self.state, signals)
            self.torque = plant.motors_at(q, tau)
            a = plant.acceleration_at(q, v, self.torque)
        rate = controller.rate(self.state, signals, drives, self.torque)
        if rate.path is not None:
            self._cause = rate.path.cause
        return np.concatenate([v, a, rate.flat()])
