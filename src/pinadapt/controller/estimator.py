"""The estimating half of a controller, beside whatever drives the robot.

Amperes, torques before a gear, a wrong sign, or torques without gravity would be learned like any
others. They show before: the filtered torque T that is measured is compared with the one that the
initial estimate predicts, P,

    factor = <T, P> / <P, P>,        correlation = <T, P> / (|T| |P|).

``pinadapt.identification.check_torques`` does the same with a whole log. Here, what a load or wrong
inertias could do is left alone: only factors far from one count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._checks import instance
from ..adaptation.adaptation import Drive, Estimate
from ..exceptions import GainError, ImplausibleError, MeasurementError
from ..filters import FilteredRegressor, FilteredTorque
from ..models.delay_compensation import SensedState
from ..records import Measurement
from ..robot.robot import Robot
from .controller import Controller
from .inputs import InputCheck, initial_estimate, rows_of
from .learned import learned_robot
from .sensing import LATEST
from .state import ControllerState

_FIRST, _LAST = 1.0, 8.0  # [s] of motion after which the torques are judged, doubling in between
_FACTORS = (0.3, 4.0)  # of all joints together, that wrong inertias and loads do not reach
_CLEAR = 0.9  # correlation at which a joint is reported to have the wrong sign
_RELATED = 0.3  # correlation of all joints together, below which torques are not the robot's
_PREDICTED = 0.5  # of the measured torques, of a joint or of all, from where on predicted ones
# must be seen in them
_ZERO = 1e-9  # [(N m)^2 s]


class Estimator:
    """Estimates parameters from sensors alone, by predicting torque and position; commands nothing.

    With r = W a_d - y the prediction error of the torque through a low pass (``FilteredRegressor``)
    and epsilon = X_k da_k that of the position,

        da_d/dt = -Gamma_d W^T R r,        da_k/dt = -Gamma_k X_k^T R_k epsilon,

    in the metric, with the weights and rates of the controller that it is made of. It uses q, v,
    the torque of the motors, and the task frame where that was measured, whatever moves the robot.

    In the first seconds of motion the torques are compared with what the initial estimate predicts,
    see ``TorqueHistory``, and refused if they cannot be the robot's.

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
            FilteredRegressor(controller.dynamics, bandwidth) if bandwidth is not None else None
        )
        senses = controller.senses
        first = senses.guards.first
        self._listens = self._torque_filter is not None and first is not None
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
            return self._first_state(self._checked(measurement), a_k, a_d, information)

    def _first_state(
        self,
        sample: Measurement,
        a_k: np.ndarray | None,
        a_d: np.ndarray | None,
        information: np.ndarray | None,
    ) -> ControllerState:
        """Return the state to start from, as ``init``, for a measurement that was checked."""
        parts = self.controller
        kinematics, dynamics = parts.kinematics, parts.dynamics
        a_k = initial_estimate(a_k, kinematics.initial, "start.a_k", kinematics.names)
        a_d = initial_estimate(a_d, dynamics.initial, "start.a_d", dynamics.names)
        dynamic, kinematic = parts.adaptation_d.init(a_d), parts.adaptation_k.init(a_k)
        if information is not None:
            rows = rows_of(information, dynamics.size)
            dynamic = parts.adaptation_d.informed(dynamic, rows.T @ rows)
        return ControllerState(
            t=sample.t,
            dynamic=dynamic,
            kinematic=kinematic,
            a_0=dynamic.value.copy(),
            filters=TorqueHistory.none(kinematics.nv) if self._listens else (),
            load=None if parts.nominal is None else parts.nominal.load,
            sensed=self._senses.init(sample, kinematics, kinematic.value),
            torque_filter=self._anew(sample.q, sample.v),
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
            ImplausibleError: an impossible measurement, see ``Guards``, torques that are not the
                robot's, see ``TorqueHistory``, or its time is not after the last one's.
            InputError: the state is that of another controller, or another thread is using this
                estimator.
            DivergedError: the estimates diverged.
        """
        self._inputs.state(state)
        with self.controller.reserved():
            return self._next_state(state, self._checked(measurement))

    def _next_state(self, state: ControllerState, sample: Measurement) -> ControllerState:
        """Return the state after a sample, as ``step``, for a measurement that was checked."""
        parts = self.controller
        elapsed = sample.t - state.t
        if elapsed <= 0.0:
            raise ImplausibleError("t", sample.t, f"is not after the last sample's, {state.t:g} s")
        a_k = state.a_k
        sensed, still, sample = self._senses.read(
            state.sensed, state.t, sample, self._kinematics, a_k, elapsed
        )
        dynamic, kinematic = state.dynamic, state.kinematic
        filtered = self._filtered(state, sensed, sample.tau, elapsed)
        paused = elapsed > LATEST * parts.period
        heard = state.filters
        if state.adapting and not still and not paused:
            if heard and isinstance(filtered, FilteredTorque) and sample.tau is not None:
                decay, error = math.exp(-filtered.bandwidth * elapsed), filtered.error(state.a_0)
                heard = heard.after(sample.tau, error, decay, elapsed)
                heard = heard.judged(self._kinematics.joint_names)
            if isinstance(filtered, FilteredTorque):
                dynamic = self._dynamic_step(dynamic, filtered, sample.q, elapsed)
            kinematic = self._kinematic_step(kinematic, sensed, elapsed)
            torque = np.zeros(0) if sample.tau is None else sample.tau
            parts.watch(torque, dynamic.value, kinematic.value)
        return state._replace(
            t=sample.t,
            dynamic=dynamic,
            kinematic=kinematic,
            filters=heard,
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


class TorqueHistory(NamedTuple):
    """Comparison of the torques of a motion with the predicted ones, so far.

    Attributes:
        time: of the motion [s].
        due: when they are judged next [s].
        filtered: (n) torque T through the low pass of the prediction P [N m or N].
        products: (3, n) sums over time of P^2, P T and T^2.
    """

    time: float
    due: float
    filtered: np.ndarray
    products: np.ndarray

    @classmethod
    def none(cls, n: int) -> TorqueHistory:
        """Return that of n joints before any sample."""
        return cls(0.0, _FIRST, np.zeros(n), np.zeros((3, n)))

    def after(
        self, tau: np.ndarray, error: np.ndarray, decay: float, elapsed: float
    ) -> TorqueHistory:
        """Return the sums with one more sample.

        Args:
            tau: (n) measured torque [N m or N].
            error: (n) P - T [N m or N].
            decay: of the low pass over the sample.
            elapsed: since the sample before [s].
        """
        T = decay * self.filtered + (1.0 - decay) * tau
        P = T + error
        products = self.products + elapsed * np.stack([P * P, P * T, T * T])
        return TorqueHistory(self.time + elapsed, self.due, T, products)

    def judged(self, names: Sequence[str]) -> TorqueHistory | tuple[()]:
        """Return what is kept for the next samples; nothing once the check is complete.

        Args:
            names: of the joints.

        Raises:
            ImplausibleError: the torques cannot be those of the robot.
        """
        if self.time < self.due:
            return self
        predicted, both, measured = self.products.sum(axis=1)
        PP, PT, TT = self.products
        against = (_PREDICTED**2 * TT < PP) & (PT + _CLEAR * np.sqrt(PP * TT) < 0.0)
        factor, guess = both / max(predicted, _ZERO), ""
        correlation = both / max(math.sqrt(predicted * measured), _ZERO)
        if against.any():
            guess = f"the wrong sign for joint '{names[int(np.argmax(against))]}'?"
        elif predicted > max(_PREDICTED**2 * measured, _ZERO) and (
            correlation < _RELATED or not _FACTORS[0] < factor < _FACTORS[1]
        ):
            guess = "without gravity, which the arm adds? another order of the joints or sign?"
            guess = "in amperes? before the gear?" if correlation > _CLEAR else guess
        if guess:
            raise ImplausibleError(
                "tau",
                f"{factor:.2g} times",
                f"is not what the model predicts in the first {self.time:.2g} s of motion",
                guess,
                "Give the torques of the joints in N m or N, after the gears and with gravity. "
                "limits=pa.Limits(guards={'gravity': False}) switches this check off.",
            )
        return () if self.due >= _LAST else self._replace(due=2.0 * self.due)
