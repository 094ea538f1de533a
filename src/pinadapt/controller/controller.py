"""The adaptive controller: one object for simulation and for the robot."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from types import EllipsisType
from typing import Any, cast

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._compiled import compile_all
from .._kernels import watch as kernels
from ..adaptation.adaptation import Adaptation, Drives, Estimate
from ..exceptions import DivergedError
from ..filters.filtered_regressor import FilteredRegressor
from ..laws.law import Believed, Command, Law
from ..models.dynamics import Dynamics
from ..models.late_frames import prediction
from ..models.task_kinematics import TaskKinematics
from ..models.typical_motion import TypicalMotion
from ..records import Desired, Measurement, named
from ..robot.changes import Payload
from ..robot.motors import Compensation
from ..robot.robot import Robot
from ..signals import OpenSignals, Signals
from .belief import Belief, informed
from .controller_sheet import controller_sheet
from .guards import Guards
from .inputs import InputCheck, initial_estimate
from .learned import learned_robot
from .limits import Limits
from .senses import Senses
from .state import ControllerState

_EMPTY = np.zeros(0)


class Controller:
    """A control law, the believed robot, and how its estimates adapt; its parts do not change.

    ``init`` and ``step`` are pure: all memory is in the ``ControllerState`` that goes in and comes
    out. The models' Pinocchio data are scratch, so one controller serves one thread at a time; a
    copy (``copy.deepcopy``, ``pickle``) has scratch of its own and gives the same torques to the
    bit.

    Attributes:
        law: the control law.
        kinematics, dynamics: the believed robot.
        adaptation_k, adaptation_d: how its estimates move.
        limits: what it does not exceed.
        senses: how it takes what the sensors say.
        motion: the believed robot over a typical motion, for the check before a run; None for a
            controller put together by hand.
        compensation: what the arm adds to the torque that it is sent, of q (nq), or None.
        period: sampling period that it was made for [s]; infinite if unknown.
        belief: what an announced load or tool is added to; None for a controller put together by
            hand.
    """

    def __init__(
        self,
        law: Law,
        kinematics: TaskKinematics,
        dynamics: Dynamics,
        *,
        adaptation_k: Adaptation,
        adaptation_d: Adaptation,
        limits: Limits | None = None,
        senses: Senses | None = None,
        motion: TypicalMotion | None = None,
        compensation: Compensation | None = None,
        period: float = math.inf,
        belief: Belief | None = None,
    ) -> None:
        """Put the parts together; ``pinadapt.make_controller`` does so with defaults."""
        self.law, self.kinematics, self.dynamics = law, kinematics, dynamics
        self.adaptation_k, self.adaptation_d = adaptation_k, adaptation_d
        self.limits = Limits() if limits is None else limits
        everything = Guards(np.full(kinematics.nv, np.inf))
        self.senses = Senses(everything) if senses is None else senses
        self.motion, self.period, self.belief = motion, period, belief
        self.compensation = compensation
        self._check = InputCheck(kinematics, dynamics.size)
        self._filters, self._predicts = law.filters, law.needs_prediction
        bandwidth = adaptation_d.prediction
        self._predictor = None if bandwidth is None else FilteredRegressor(dynamics, bandwidth)
        self._believed = Believed(
            kinematics, dynamics, adaptation_k, adaptation_d, self.limits.watch
        )
        compile_all()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Have the kernels compiled where a copy arrives in a new process."""
        self.__dict__.update(state)
        compile_all()

    def __repr__(self) -> str:
        """Return a table: robot, task, gains, what is adapted, limits."""
        return str(controller_sheet(self))

    def _repr_html_(self) -> str:
        return controller_sheet(self).html()

    def limited(self, torque: np.ndarray | None) -> Controller:
        """Return this controller with other torque limits (n) [N m or N]; it shares the scratch."""
        other = copy.copy(self)
        other.limits = replace(self.limits, torque=torque)
        return other

    def init(
        self,
        measurement: Measurement,
        *,
        a_k: np.ndarray | None = None,
        a_d: np.ndarray | None = None,
        adapting: bool = True,
    ) -> ControllerState:
        """Return the state to start from: filters at rest, estimates as given or as believed.

        Args:
            measurement: the first sample.
            a_k: (p_k) initial kinematic estimate [m].
            a_d: (p_d) initial dynamic estimate; natural adaptation moves unphysical bodies into the
                cone, with a warning.
            adapting: whether the estimates move from the start; see ``ControllerState.adapt``.

        Raises:
            MeasurementError: measurements of the wrong size, not finite, or missing.
            InputError: no measurement.
            ParameterError: estimates of the wrong size, non-finite, or outside of their domain.
        """
        measurement = self._check.first(measurement)
        kinematics, dynamics = self.kinematics, self.dynamics
        a_k = initial_estimate(a_k, kinematics.initial, "belief.kinematic", kinematics.names)
        dynamic = self.adaptation_d.init(
            initial_estimate(a_d, dynamics.initial, "belief.dynamic", dynamics.names)
        )
        return ControllerState(
            t=measurement.t,
            dynamic=dynamic,
            kinematic=self.adaptation_k.init(a_k),
            a_0=dynamic.value.copy(),
            filters=self._filters.init(measurement, kinematics),
            adapting=adapting,
            load=None if self.belief is None else self.belief.load,
            senses=self.senses.init(measurement, kinematics),
            prediction=()
            if self._predictor is None
            else self._predictor.init(measurement.q, measurement.v),
        )

    def believe(
        self,
        state: ControllerState,
        *,
        payload: Payload | EllipsisType | None = ...,
        tool_translation: ArrayLike | None = None,
    ) -> ControllerState:
        """Return the state of a controller that is told what the robot carries from now on.

        Pure, as ``step``, but it takes a millisecond or more.

        Args:
            state: until now.
            payload: the whole load from now on, None for none; left out, the load is as before.
                Where bodies have parameters of their own, those of the last body become the
                description's with this load, whatever was learned there before; the others keep
                what was learned. Other parameters (a basis, lumped ones) cannot tell the last body
                from the arm: they move by what this load differs from the one last announced,
                which leaves a load that was learned without being announced where it is.
            tool_translation: (3) [m] of the tool from now on, from the description's frame, in its
                axes; None: as before.

        Raises:
            InputError: the parameters cannot express it, or a load or a tool that cannot be.
        """
        return informed(self, state, payload, tool_translation)

    def learned(self, state: ControllerState) -> Robot:
        """Return the believed robot as estimated in a state: bodies, translations, joints.

        What is not adapted is as described, with the load it was believed to carry at first. The
        robot can be believed by another controller, driven, or written with ``Robot.save``.

        Raises:
            ParameterError: the bodies are not physical, as adaptation "gradient" may leave them, or
                the parameters are lumped products of lengths and inertias.
        """
        return learned_robot(self, state)

    def step(
        self, state: ControllerState, measurement: Measurement, desired: Desired, dt: float
    ) -> tuple[np.ndarray, ControllerState]:
        """Return the torque (n) [N m or N] to hold for the next dt [s], and the next state.

        Everything that comes in is checked; ``state`` is as good as before, whatever is raised.

        Raises:
            MeasurementError: a signal that the law uses is missing, of the wrong size or type, or
                not finite.
            InputError: the desired motion, dt or the state cannot be used.
            DivergedError: torque or estimates went wrong, see ``watch``, or the law met a
                singularity.
        """
        measurement, desired = self._check.sample(state, measurement, desired)
        elapsed = self.senses.guards.elapsed(state.t, measurement.t, dt, self.period)
        try:
            s = self._signals(state, measurement, desired)
            command = self.law.command(s, self._asked(state, elapsed))
            torque, drives = self.respond(s, command, self.acceleration(s, measurement))
            dynamic, kinematic = state.dynamic, state.kinematic
            if s.a_d is not dynamic.value:  # projected
                dynamic = dynamic._replace(value=s.a_d)
            if s.adapting:
                dynamic = self.adaptation_d.step(dynamic, drives.dynamic, elapsed)
                kinematic = self.adaptation_k.step(kinematic, drives.kinematic, elapsed)
            filters = self._filters.step(state.filters, s, elapsed)
            memory = state.prediction
            if self._predictor is not None:
                memory = self._predictor.step(s.predicted, self._given(s, torque), elapsed)
            self.watch(torque, dynamic.value, kinematic.value)
        except (DivergedError, np.linalg.LinAlgError) as error:
            # a signal that is not finite is the likelier cause
            self._check.finite(measurement, desired)
            raise DivergedError(str(error)) from error
        adapting, load = state.adapting, state.load
        after = s.t, dynamic, kinematic, s.a_0, filters, adapting, load, s.sensed, memory
        return torque, named(ControllerState, after)

    def command(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> tuple[Signals, Command]:
        """Return what the law sees and its command, torque still affine in the acceleration.

        Raises:
            MeasurementError, InputError: as ``step``.
        """
        s = self.observe(state, measurement, desired)
        return s, self.law.command(s, self._asked(state, None))

    def _asked(self, state: ControllerState, dt: float | None) -> Believed:
        """Return the believed robot, to be asked for a command that is held for dt [s], or None."""
        believed = self._believed
        believed.adaptation_d, believed.memory = self.adaptation_d, state.dynamic.memory
        believed.dt = dt
        return believed

    def respond(self, s: Signals, command: Command, a: np.ndarray) -> tuple[np.ndarray, Drives]:
        """Return the torque (n) to send at joint acceleration a (n), and the drives.

        Limits are those of the motors, which give what is sent and what the arm adds.

        While a motor saturates, the tracking error tells of the lost torque as much as of the
        parameters, and following it winds the estimates up. They then learn only from what holds
        whatever the torque is, the prediction errors.
        """
        torque, limits, added = command.at(a), self.limits.torque, self.compensation
        drives = self.law.drives(s, self._believed, command, a)
        if s.predicted is not None:
            W, y, _ = s.predicted
            drives = Drives(drives.dynamic.predicting(W, W.dot(s.a_d) - y), drives.kinematic)
        if limits is not None:
            held = empty(torque.size)
            if kernels.hold(torque, limits, held):
                torque, drives = held, drives.without_tracking()
        return (torque if added is None else torque - added(s.q)), drives

    def observe(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> Signals:
        """Evaluate the believed robot at the current estimates; return what the law may see.

        Raises:
            MeasurementError, InputError: as ``step``.
        """
        measurement, desired = self._check.sample(state, measurement, desired)
        q, v = measurement.q.copy(), measurement.v.copy()
        own = Desired(*(part.copy() for part in desired))
        return self._signals(state, measurement._replace(q=q, v=v), own)

    def _signals(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> Signals:
        """Return ``observe`` of what was checked and stays what it is."""
        t_before, dynamic, kinematic, a_0, filters, adapting, _, before, memory = state
        t, q, v, x, _, xd, _, _ = measurement
        x_d, xd_d, xdd_d = desired
        senses, kinematics, a_k = self.senses, self.kinematics, kinematic.value
        task = kinematics.task
        if senses.low_pass is not None:
            v = senses.velocity(before, v, t - t_before)
            measurement = measurement._replace(v=v)
        kinematics.update(a_k, q, v)
        still = senses.guards.look(v, x, desired, kinematics)
        a_d = self.adaptation_d.project(dynamic, q)
        self.dynamics.load(a_d)
        sensed = senses.carrier.see(before, t_before, measurement, kinematics, a_k)
        if senses.low_pass is not None:
            sensed = sensed._replace(v=v)
        if sensed.frame is not None or x is None:
            measurement = measurement._replace(x=sensed.x)
        dx, xd_hat = task.error(task.measured(sensed.x, q), x_d), kinematics.xd_hat
        epsilon, X_k = _EMPTY, _EMPTY
        if self._predicts:
            epsilon, X_k = prediction(sensed, kinematics, a_k)
        s = OpenSignals(
            t,
            q,
            v,
            task.known_velocity(xd, xd_hat),
            xd_d,
            xdd_d,
            dx,
            xd_hat,
            task.drift(dx, xd_hat, xd_d),
            kinematic,
            a_k,
            a_d,
            a_0,
            kinematics.J,
            kinematics.Jdot_v,
            kinematics.Y_k,
            kinematics.right_inverse(self.limits.singular),
            self._filters.observe(filters, measurement, kinematics),
            adapting and not (still and np.abs(dx).max() < senses.guards.near),
            sensed,
            epsilon,
            X_k,
            None
            if self._predictor is None
            else self._predictor.observe(memory, q, v, self._check.torque(measurement.tau)),
        )
        s.__class__ = Signals  # closed from now on
        return cast(Signals, s)

    def acceleration(self, s: Signals, measurement: Measurement) -> np.ndarray:
        """Return the joint acceleration (n): the measured one if there is one, else filtered."""
        if measurement.a is not None:
            return np.asarray(measurement.a, dtype=float)
        return self._filters.acceleration(s.filtered)  # type: ignore[return-value]

    def rate(
        self, state: ControllerState, s: Signals, drives: Drives, torque: np.ndarray
    ) -> ControllerState:
        """Return d(state)/dt from what the law saw and its drives, to integrate as an ODE.

        Args:
            state: now.
            s: what the law saw.
            drives: as ``respond`` has them.
            torque: (n) that the joints see [N m or N].
        """
        if not s.adapting:
            drives = Drives(drives.dynamic.still(), drives.kinematic.still())
        return ControllerState(
            t=1.0,
            dynamic=self.adaptation_d.rate(Estimate(s.a_d, state.dynamic.memory), drives.dynamic),
            kinematic=self.adaptation_k.rate(state.kinematic, drives.kinematic),
            a_0=np.zeros(state.a_0.size),
            filters=self._filters.rate(state.filters, s),
            adapting=state.adapting,
            prediction=() if self._predictor is None else self._predictor.rate(s.predicted, torque),
        )

    def _given(self, s: Signals, torque: np.ndarray) -> np.ndarray:
        """Return the torque (n) that the joints see when the motors are sent one (n)."""
        return torque if self.compensation is None else torque + self.compensation(s.q)

    def watch(self, torque: np.ndarray, a_d: np.ndarray, a_k: np.ndarray) -> None:
        """Refuse a torque (n) or estimates that went wrong.

        Raises:
            DivergedError: they are not finite, or the estimates are larger than any robot's.
        """
        size = kernels.size_of_estimates(a_d, a_k, torque)
        if not size < math.inf:
            raise DivergedError("the torque or the estimates are no longer finite.")
        if size > self.limits.estimate**2:
            raise DivergedError(
                f"the estimates ran away: their norm is {math.sqrt(size):.3g}. Try smaller gamma_d "
                "and gamma_k, natural adaptation, or a start nearer to the truth; watch = false "
                "does not end the run."
            )

    def parameter_storage(
        self, state: ControllerState, a_k_true: np.ndarray, a_d_true: np.ndarray
    ) -> float | None:
        """Return the parameters' part of V, or None where an adaptation leaves it undefined."""
        kinematic: float | None = 0.0
        if self.law.learns_kinematics:
            kinematic = self.adaptation_k.storage(state.kinematic, a_k_true)
        dynamic = self.adaptation_d.storage(state.dynamic, a_d_true)
        return None if kinematic is None or dynamic is None else kinematic + dynamic
