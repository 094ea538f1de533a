"""The estimating half of a controller, beside whatever drives the robot.

``pinadapt.identification.check_torques`` says whether the torques of a log can be the robot's.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .._checks import instance
from ..adaptation.adaptation import Drive, Estimate
from ..exceptions import GainError, ImplausibleError, MeasurementError
from ..filters import FilteredRegressor, FilteredTorque
from ..models.delay_compensation import SensedState
from ..records import Measurement
from ..robot.robot import Robot
from .controller import Controller
from .inputs import InputCheck
from .learned import learned_robot
from .sensing import LATEST
from .state import ControllerState


class Estimator:
    """Estimates parameters from sensors alone, by predicting torque and position; commands nothing.

    With r = W a_d - y the prediction error of the torque through a low pass (``FilteredRegressor``)
    and epsilon = X_k da_k that of the position,

        da_d/dt = -Gamma_d W^T R r,        da_k/dt = -Gamma_k X_k^T R_k epsilon,

    in the metric, with the weights and rates of the controller that it is made of. It uses q, v,
    the torque of the motors, and the task frame where that was measured, whatever moves the robot.

    ``init`` and ``step`` are pure. An implausible sample raises as in a controller; continue from
    the same state with the next one. The filters bridge gaps of up to ten periods, and start anew
    after longer ones, with the estimates as they were.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519, without the tracking error.

    Attributes:
        controller: of whose parts it is made; ``controller.learned(state)`` and
            ``LearnedParameters.of(controller, state)`` take its states.
    """

    def __init__(self, controller: Controller) -> None:
        """Take a controller's models, adaptations and senses; see ``pinadapt.make_estimator``.

        Raises:
            GainError: its adaptation predicts no torque, or its law no positions, so that one of
                the estimates would never move.
        """
        self.controller = instance(controller, Controller, "controller")
        self._kinematics = kinematics = controller.kinematics
        bandwidth = controller.adaptation_d.torque_bandwidth
        if controller.dynamics.size and bandwidth is None:
            raise GainError(
                f"the adaptation '{controller.adaptation_d.name}' learns from tracking errors "
                "alone, of which an estimator has none.",
                where="adaptation",
                hint='Take "natural-memory", "natural-composite" or "least-squares".',
            )
        if kinematics.size and not controller.law.uses_position_error:
            raise GainError(
                f"the law '{controller.law.name}' weighs no prediction error of positions.",
                where="law",
                hint='Take the law "separation", or kinematic = [].',
            )
        loop = controller.law.kinematic_loop()
        self._R_k = None if loop is None else loop.weight
        self._torque_filter = (
            None
            if bandwidth is None
            else FilteredRegressor(
                controller.dynamics, bandwidth, constraints=kinematics.constraints
            )
        )
        senses = controller.senses
        self._senses = replace(
            senses,
            compensator=replace(senses.compensator, longest_gap=math.inf),
            guards=replace(senses.guards, first=None),
        )
        self._inputs = InputCheck(kinematics, controller.dynamics.size)

    def init(
        self,
        measurement: Measurement,
        *,
        a_k: np.ndarray | None = None,
        a_d: np.ndarray | None = None,
        information: np.ndarray | None = None,
    ) -> ControllerState:
        """Return the state to start from, estimates as given or nominal.

        Args:
            measurement: the first sample; x may come later, or never.
            a_k: (p_k) initial kinematic estimate [m].
            a_d: (p_d) initial dynamic estimate.
            information: (r, p_d) of other data on it, as of ``Controller.init``.

        Raises:
            MeasurementError: measurements of the wrong size, not finite, or missing.
            ImplausibleError: the robot cannot be there, see ``Guards``.
            ParameterError: estimates of the wrong size, non-finite, or outside of their domain.
            InputError: another thread is using this estimator.
        """
        with self.controller.reserved():
            sample = self._checked(measurement)
            a_k = self._kinematics.initial if a_k is None else a_k
            state = self.controller.first_state(sample, a_k, a_d, information)
            return state._replace(
                filters=(),
                sensed=state.sensed._replace(first=None),
                torque_filter=self._anew(sample.q, sample.v),
                path=None,
            )

    def step(self, state: ControllerState, measurement: Measurement) -> ControllerState:
        """Return the state after a sample, at which the estimates have moved since the last one.

        They rest while all joints do: stiction then hides the torque.

        Args:
            state: from ``init`` or ``step``; as good as before, whatever is raised.
            measurement: q, v and tau, the mean torque since the last sample; x, ``x_time`` where
                a frame was seen.

        Raises:
            MeasurementError: a signal is missing, of the wrong size or type, or not finite.
            ImplausibleError: an impossible measurement, see ``Guards``, or its time is not after
                the last one's.
            InputError: the state is that of another controller, or another thread is using this
                estimator.
            DivergedError: the estimates diverged.
        """
        self._inputs.state(state)
        with self.controller.reserved():
            sample = self._checked(measurement)
            parts = self.controller
            elapsed = sample.t - state.t
            if elapsed <= 0.0:
                raise ImplausibleError(
                    "t", sample.t, f"is not after the last sample's, {state.t:g} s"
                )
            a_k = state.a_k
            paused = elapsed > LATEST * parts.period
            sensed, still, sample = self._senses.read(
                state.sensed,
                state.t,
                sample,
                self._kinematics,
                a_k,
                math.inf if paused else elapsed,
            )
            dynamic, kinematic = state.dynamic, state.kinematic
            filtered = self._filtered(state, sensed, sample.tau, elapsed)
            if state.adapting and not still and not paused:
                if isinstance(filtered, FilteredTorque):
                    dynamic = self._dynamic_step(dynamic, filtered, sensed.q, elapsed)
                kinematic = self._kinematic_step(kinematic, sensed, elapsed)
                torque = np.zeros(0) if sample.tau is None else sample.tau
                parts.watch(torque, dynamic.value, kinematic.value)
            return state._replace(
                t=sample.t,
                dynamic=dynamic,
                kinematic=kinematic,
                sensed=sensed,
                torque_filter=filtered,
            )

    def learned(self, state: ControllerState) -> Robot:
        """Return the robot with the estimates of a state; see ``Controller.learned``.

        Raises:
            ParameterError: as there.
        """
        return learned_robot(self.controller, state)

    def _checked(self, given: Measurement) -> Measurement:
        """Return a measurement as arrays of finite floats, with a torque where one is needed."""
        measurement = self._inputs.measurement(given)
        self._inputs.finite(measurement)
        if self._torque_filter is None:
            return measurement
        tau = self._inputs.torque(measurement.tau)
        if tau is None:
            raise MeasurementError(
                "tau", None, "is missing; the dynamics cannot be estimated without it"
            )
        return measurement._replace(tau=tau)

    def _anew(self, q: np.ndarray, v: np.ndarray) -> FilteredTorque | tuple[()]:
        """Return the output of filters that begin at q (nq), v (n)."""
        if self._torque_filter is None:
            return ()
        return self._torque_filter.observe(self._torque_filter.init(q, v), q, v)

    def _filtered(
        self, state: ControllerState, sensed: SensedState, tau: np.ndarray | None, elapsed: float
    ) -> FilteredTorque | tuple[()]:
        """Return filtered regressor and torque at a sample."""
        q, v = sensed.q, sensed.v
        if self._torque_filter is None or tau is None or elapsed > LATEST * self.controller.period:
            return self._anew(q, v)
        memory = self._torque_filter.step(state.torque_filter, tau, elapsed)
        return self._torque_filter.observe(memory, q, v, tau)

    def _dynamic_step(
        self, dynamic: Estimate, filtered: FilteredTorque, q: np.ndarray, elapsed: float
    ) -> Estimate:
        """Return the dynamic estimate after a step by the prediction error of the torque."""
        adaptation, W = self.controller.adaptation_d, filtered.W
        a_d = adaptation.project(dynamic, q)
        drive = Drive(W, None, W, filtered.error(a_d))
        return adaptation.step(dynamic.with_value(a_d), drive, elapsed)

    def _kinematic_step(self, kinematic: Estimate, sensed: SensedState, elapsed: float) -> Estimate:
        """Return the kinematic estimate after a step by the prediction error of the position."""
        if not kinematic.value.size or sensed.x is None:
            return kinematic
        drive = Drive(sensed.X_k, None, sensed.X_k, sensed.epsilon, self._R_k)
        return self.controller.adaptation_k.step(kinematic, drive, elapsed)
