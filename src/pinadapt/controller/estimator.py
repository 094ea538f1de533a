"""The estimating half of a controller, beside whatever drives the robot."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .._checks import instance
from ..adaptation.adaptation import Drive, Estimate
from ..exceptions import GainError, ImplausibleError, MeasurementError
from ..filters.filtered_regressor import FilteredRegressor, FilteredTorque
from ..models.late_frames import Sensed, prediction
from ..records import Desired, Measurement
from ..robot.robot import Robot
from .controller import Controller
from .inputs import InputCheck, initial_estimate
from .learned import learned_robot
from .state import ControllerState

_PAUSE = 10.0  # periods after which the filters start anew


class Estimator:
    """What a controller learns from its sensors alone: torque and position predicted, no command.

    With r = W a_d - y the prediction error of the torque through a low pass (``FilteredRegressor``)
    and epsilon = X_k da_k that of the position,

        da_d/dt = -Gamma_d W^T R r,        da_k/dt = -Gamma_k X_k^T R_k epsilon,

    in the metric, with the weights and rates of the controller it is made of. It sees q, v, the
    torque that the motors gave, and the task frame where that was measured; who moves the robot,
    and why, is not its business.

    ``init`` and ``step`` are pure. A sample that cannot be believed raises as in a controller, and
    the state is as good as before; go on with the next one. The filters bridge what was left out up
    to ten periods, and start anew after longer pauses, with the estimates as they were.

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
        bandwidth = controller.adaptation_d.prediction
        if controller.dynamics.size and bandwidth is None:
            raise GainError(
                f"the adaptation '{controller.adaptation_d.name}' learns from tracking errors "
                "alone, of which an estimator has none.",
                where="adaptation",
                hint='Take "natural-memory", "natural-composite" or "least-squares".',
            )
        if kinematics.size and not controller.law.needs_prediction:
            raise GainError(
                f"the law '{controller.law.name}' weighs no prediction error of positions.",
                where="law",
                hint='Take the law "separation", or kinematic = [].',
            )
        loop = controller.law.kinematic_loop()
        self._R_k = None if loop is None else loop.weight
        self._predictor = (
            FilteredRegressor(controller.dynamics, bandwidth) if bandwidth is not None else None
        )
        self._carrier = replace(controller.senses.carrier, blind=math.inf)
        self._check = InputCheck(kinematics, controller.dynamics.size)
        rest = np.zeros(kinematics.task.size)
        self._nowhere = Desired(rest, rest, rest)

    def init(
        self,
        measurement: Measurement,
        *,
        a_k: np.ndarray | None = None,
        a_d: np.ndarray | None = None,
    ) -> ControllerState:
        """Return the state to start from, estimates as given or as believed.

        Args:
            measurement: the first sample; x may come later, or never.
            a_k: (p_k) initial kinematic estimate [m].
            a_d: (p_d) initial dynamic estimate.

        Raises:
            MeasurementError: measurements of the wrong size, not finite, or missing.
            ParameterError: estimates of the wrong size, non-finite, or outside of their domain.
        """
        sample, parts = self._checked(measurement), self.controller
        kinematics, dynamics = parts.kinematics, parts.dynamics
        a_k = initial_estimate(a_k, kinematics.initial, "belief.kinematic", kinematics.names)
        a_d = initial_estimate(a_d, dynamics.initial, "belief.dynamic", dynamics.names)
        dynamic = parts.adaptation_d.init(a_d)
        return ControllerState(
            t=sample.t,
            dynamic=dynamic,
            kinematic=parts.adaptation_k.init(a_k),
            a_0=dynamic.value.copy(),
            filters=(),
            load=None if parts.belief is None else parts.belief.load,
            senses=parts.senses.init(sample, kinematics),
            prediction=self._anew(sample),
        )

    def step(self, state: ControllerState, measurement: Measurement) -> ControllerState:
        """Return the state after a sample, at which the estimates have moved since the last one.

        They rest while all joints do: what stiction holds says nothing.

        Args:
            state: from ``init`` or ``step``; as good as before, whatever is raised.
            measurement: q, v and tau, the mean torque since the last sample; x, ``x_time`` where
                a frame was seen.

        Raises:
            MeasurementError: a signal is missing, of the wrong size or type, or not finite.
            ImplausibleError: it cannot be, see ``Guards``, or its time is not after the last one's.
            InputError: the state is that of another controller.
            DivergedError: the estimates ran away.
        """
        self._check.state(state)
        sample, parts, kinematics = self._checked(measurement), self.controller, self._kinematics
        elapsed = sample.t - state.t
        if elapsed <= 0.0:
            raise ImplausibleError("t", sample.t, f"is not after the last sample's, {state.t:g} s")
        if parts.senses.low_pass is not None:
            v = parts.senses.velocity(state.senses, sample.v, elapsed)
            sample = sample._replace(v=v)
        kinematics.update(state.a_k, sample.q, sample.v)
        still = parts.senses.guards.look(sample.v, sample.x, self._nowhere, kinematics)
        senses = self._seen(state, sample)
        if parts.senses.low_pass is not None:
            senses = senses._replace(v=sample.v)
        dynamic, kinematic = state.dynamic, state.kinematic
        predicted = self._predicted(state, sample, elapsed)
        paused = elapsed > _PAUSE * parts.period
        if state.adapting and not still and not paused:
            if isinstance(predicted, FilteredTorque):
                dynamic = self._learned(dynamic, predicted, sample, elapsed)
            kinematic = self._located(kinematic, senses, elapsed)
            torque = np.zeros(0) if sample.tau is None else sample.tau
            parts.watch(torque, dynamic.value, kinematic.value)
        return state._replace(
            t=sample.t, dynamic=dynamic, kinematic=kinematic, senses=senses, prediction=predicted
        )

    def learned(self, state: ControllerState) -> Robot:
        """Return the believed robot at the estimates of a state; see ``Controller.learned``.

        Raises:
            ParameterError: as there.
        """
        return learned_robot(self.controller, state)

    def _checked(self, given: Measurement) -> Measurement:
        """Return a measurement as arrays of finite floats, with a torque where one is needed."""
        measurement = self._check.measurement(given)
        self._check.finite(measurement)
        if self._predictor is None:
            return measurement
        tau = self._check.torque(measurement.tau)
        if tau is None:
            raise MeasurementError("tau", None, "is missing, and without it no dynamics show")
        return measurement._replace(tau=tau)

    def _anew(self, sample: Measurement) -> FilteredTorque | tuple[()]:
        """Return filters that begin at a sample."""
        if self._predictor is None:
            return ()
        q, v = sample.q, sample.v
        return self._predictor.observe(self._predictor.init(q, v), q, v)

    def _predicted(
        self, state: ControllerState, sample: Measurement, elapsed: float
    ) -> FilteredTorque | tuple[()]:
        """Return filtered regressor and torque at a sample."""
        tau = sample.tau
        if self._predictor is None or tau is None or elapsed > _PAUSE * self.controller.period:
            return self._anew(sample)
        memory = self._predictor.step(state.prediction, tau, elapsed)
        return self._predictor.observe(memory, sample.q, sample.v, tau)

    def _seen(self, state: ControllerState, sample: Measurement) -> Sensed:
        """Return what is known of the task frame, from the first time on that it was seen."""
        if state.senses.x is None:
            return self.controller.senses.init(sample, self._kinematics)
        return self._carrier.see(state.senses, state.t, sample, self._kinematics, state.a_k)

    def _learned(
        self, dynamic: Estimate, predicted: FilteredTorque, sample: Measurement, elapsed: float
    ) -> Estimate:
        """Return the dynamic estimate after the prediction error of the torque."""
        adaptation = self.controller.adaptation_d
        a_d = adaptation.project(dynamic, sample.q)
        drive = Drive(predicted.W, None, predicted.W, predicted.W.dot(a_d) - predicted.y)
        return adaptation.step(dynamic._replace(value=a_d), drive, elapsed)

    def _located(self, kinematic: Estimate, senses: Sensed, elapsed: float) -> Estimate:
        """Return the kinematic estimate after the prediction error of the position."""
        if not kinematic.value.size or senses.x is None:
            return kinematic
        epsilon, X_k = prediction(senses, self._kinematics, kinematic.value)
        drive = Drive(X_k, None, X_k, epsilon, self._R_k)
        return self.controller.adaptation_k.step(kinematic, drive, elapsed)
