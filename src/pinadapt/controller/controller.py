"""The adaptive controller: one object for simulation and for the robot."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from threading import Lock
from types import EllipsisType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import flag, is_array, positive, shown, vector
from .._kernels import samples as kernels
from ..adaptation.adaptation import Adaptation, Drives, Estimate, Frozen
from ..description.chain import angles_from_configuration, position_limits
from ..exceptions import ContactError, DivergedError, InputError, PinadaptError
from ..filters import FilteredRegressor, FilteredTorque
from ..laws.fast_feedback import FastFeedback
from ..laws.law import Command, EstimatedModel, Law
from ..laws.posture import Posture
from ..models.delay_compensation import SensedState
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..models.typical_motion import TypicalMotion
from ..records import Desired, Measurement
from ..robot.changes import Load
from ..robot.motors import Compensation, LateTorque, torque_bounds, torque_limits
from ..robot.robot import Robot
from ..signals import Signals
from ..trajectories.trajectory import Trajectory, motion_failed
from .announcement import NominalRobot, announced_state, at_lengths
from .clock import LATEST
from .constraint_forces import FEASIBLE, ConstraintForces, Solution
from .governor import PathTime
from .inputs import InputCheck, initial_estimate, made_by, squared
from .learned import AlongExcited
from .limits import ControllerLimits
from .residuals import Guards
from .sensing import Senses
from .state import ControllerState

_HELD = Frozen()
# [s] of a controller that was made for none: the rate of most arms' interfaces; half and twice:
# damping of ``safe`` twice and half as fast at most
PERIOD = 1e-3
# Of the torque limits, that a spring of an arm at rest may take; and of its speed that a joint
# loses in a period, at most. Half and twice: arms drift as far after every fault.
_SPRING = 0.5
_DAMPED = 0.3


class Controller:
    """A control law, a model of the robot, and the adaptation of its parameters; immutable.

    ``init`` and ``step`` are pure: all memory is in the ``ControllerState`` that goes in and comes
    out. The models' Pinocchio data are scratch, so one controller serves one thread at a time, and
    a second one gets an error; a copy (``copy.deepcopy``, ``pickle``) has scratch of its own and
    gives the same torques to the bit.

    Attributes:
        law: the control law.
        kinematics, dynamics: the model of the robot.
        adaptation_k, adaptation_d: how its estimates move.
        limits: what it does not exceed.
        senses: how it takes what the sensors say.
        motion: the model along a typical motion, for the check before a run; None for a
            controller put together by hand.
        compensation: what the arm adds to the torque that it is sent, of q (nq), or None.
        sensors: that it was made for; ``simulate`` simulates these by default.
        period: sampling period that it was made for [s]; infinite if unknown.
        nominal: what an announced load or tool is added to; by default the kinematics' robot.
    """

    def __init__(
        self,
        law: Law | FastFeedback,
        kinematics: TaskKinematics,
        dynamics: Dynamics,
        *,
        adaptation_k: Adaptation,
        adaptation_d: Adaptation,
        limits: ControllerLimits | None = None,
        senses: Senses | None = None,
        motion: TypicalMotion | None = None,
        compensation: Compensation | None = None,
        period: float = math.inf,
        nominal: NominalRobot | None = None,
    ) -> None:
        """Put the parts together; ``pinadapt.make_controller`` does so with defaults."""
        self.law = law
        self.kinematics = kinematics
        self.dynamics = dynamics
        self.adaptation_k = adaptation_k
        self.adaptation_d = adaptation_d
        self.limits = ControllerLimits() if limits is None else limits
        self.senses = senses or Senses(Guards(kinematics.robot.model))
        self.sensors = self.senses.sensors
        self.motion = motion
        self.period = period
        self.nominal = nominal or NominalRobot(kinematics.robot)
        self.compensation = compensation
        self._inputs = InputCheck(kinematics, dynamics.size)
        self._filters = law.filters
        self._projects = adaptation_d.projects
        bandwidth = adaptation_d.torque_bandwidth
        self._torque_filter = None
        self._lead = None
        if bandwidth is not None:
            motors = None
            if self.limits.actuators.late:
                joints = self.limits.actuators.of(kinematics.robot)
                motors = LateTorque(joints)
                self._lead = bandwidth * (joints.delay + 1.0 / joints.bandwidth)
            self._torque_filter = FilteredRegressor(
                dynamics, bandwidth, motors, kinematics.constraints
            )
        self._forces = None
        squeezes = (getattr(part, "squeeze", None) for part in kinematics.robot.constraints)
        if not kinematics.robot.motors.all() or any(each is not None for each in squeezes):
            self._forces = ConstraintForces(kinematics.robot, kinematics.constraints)
        self._make_scratch()

    def __copy__(self) -> Controller:
        """Copy by reference, the lock as well: the scratch is for one thread."""
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Copy all but lock and scratch, deeply."""
        own = ("_alone", "_data", "_estimated")
        return {name: value for name, value in vars(self).items() if name not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make lock and scratch anew."""
        self.__dict__.update(state)
        self._make_scratch()

    def _make_scratch(self) -> None:
        """Make the model that a law gets, Pinocchio's data, and the lock for a thread's use."""
        nothing = Estimate(np.zeros(0))
        self._estimated = EstimatedModel(
            self.kinematics,
            self.dynamics,
            self.adaptation_k,
            self.adaptation_d,
            nothing,
            nothing,
            stop_on_divergence=self.limits.stop_on_divergence,
        )
        self._alone = Lock()
        self._data = self.kinematics.robot.model.createData()

    def __repr__(self) -> str:
        """Return law, task, what is adapted and how, and what it was made for."""
        kinematics = self.kinematics
        actuators = self.limits.actuators
        frames = " and ".join(kinematics.robot.frames)
        made = "" if actuators.ideal else f", made for {actuators.words}"
        return (
            f"controller: {self.law.name} of {kinematics.task.name} of {frames}, "
            f"{kinematics.size} kinematic parameters ({self.adaptation_k.name}), "
            f"{self.dynamics.size} dynamic ones ({self.adaptation_d.name}){made}"
        )

    def limited(self, torque: ArrayLike | bool | None) -> Controller:
        """Return this controller with other torque limits; it shares the scratch.

        Args:
            torque: a number or (n) [N m or N]; True for those of the description, None for none.

        Raises:
            GainError: wrong size, or limits that are not positive.
        """
        other = copy.copy(self)
        other.limits = replace(self.limits, torque=torque_limits(self.kinematics.robot, torque))
        return other

    def resting_at(self, q: np.ndarray) -> Controller:
        """Return this controller whose posture rests at q (nq); it shares the scratch.

        An arm that is not at its home does not return there in its null space. Robots under
        constraints keep their posture, and so do laws without one.

        Raises:
            InputError: q is of another size.
        """
        robot = self.kinematics.robot
        posture = getattr(self.law, "posture", None)
        if posture is None or robot.constraints:
            return self
        q = vector(q, robot.model.nq, "q", fills=False)
        angles = np.clip(angles_from_configuration(robot.model, q), *position_limits(robot.model))
        other = copy.copy(self)
        other.law = self.law.adjusted(posture=Posture(robot, angles, posture.frequency))
        return other

    def init(
        self,
        measurement: Measurement,
        *,
        a_k: np.ndarray | None = None,
        a_d: np.ndarray | None = None,
        information: np.ndarray | None = None,
        information_k: np.ndarray | None = None,
        adapting: bool = True,
    ) -> ControllerState:
        """Return the state to start from: filters at rest, estimates as given or nominal.

        Args:
            measurement: the first sample.
            a_k: (p_k) initial kinematic estimate [m].
            a_d: (p_d) initial dynamic estimate; natural adaptation moves unphysical bodies into the
                cone, with a warning.
            information: (r, p_d) rows R of the information of other data on ``a_d``, R^T R its
                inverse covariance; an adaptation with a memory begins with it. None: nothing.
            information_k: (r, p_k) the same of ``a_k``, for least squares. The run then starts
                from the position that ``a_k`` predicts, not from the first frame.
            adapting: whether the estimates move from the start; see ``ControllerState.adapt``.

        Raises:
            MeasurementError: measurements of the wrong size, not finite, or missing.
            ImplausibleError: the robot cannot be there, see ``Guards``.
            InputError: no measurement.
            ParameterError: estimates of the wrong size, non-finite, or outside of their domain.
            InputError: another thread is using this controller.
        """
        flag(adapting, "adapting")
        kinematics = self.kinematics
        dynamics = self.dynamics
        with self.reserved():
            measurement = self._inputs.first(measurement)
            if a_k is None:
                a_k = kinematics.initial_at(measurement.q, measurement.x)
            a_k = initial_estimate(a_k, kinematics.initial, "start.a_k", kinematics.names)
            a_d = initial_estimate(a_d, dynamics.initial, "start.a_d", dynamics.names)
            dynamic = self.adaptation_d.init(a_d, squared(information, dynamics.size))
            H = squared(information_k, kinematics.size, "information_k")
            kinematic = self.adaptation_k.init(a_k, H)
            sensed = self.senses.init(measurement, kinematics, kinematic.value)
            if information_k is not None:
                sensed = predicted_at_rest(sensed, kinematics, kinematic.value)
            return ControllerState(
                t=measurement.t,
                dynamic=dynamic,
                kinematic=kinematic,
                a_0=dynamic.value.copy(),
                filters=self._filters.init(sensed, kinematics),
                adapting=adapting,
                load=self.nominal.load,
                sensed=sensed,
                torque_filter=()
                if self._torque_filter is None
                else self._torque_filter.init(measurement.q, measurement.v),
                path=None if self.limits.governor is None else PathTime(),
            )

    def _reserve(self) -> None:
        """Take the scratch, or refuse it to another thread."""
        if not self._alone.acquire(blocking=False):
            raise InputError(
                "another thread is using this controller, whose models hold intermediate results.",
                where="controller",
                hint="Give each thread a copy: copy.deepcopy(controller). States may be shared.",
            )

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """Have the scratch for one thread, as ``step`` and all that needs it do by themselves.

        Raises:
            InputError: another thread is using this controller.
        """
        self._reserve()
        try:
            yield
        finally:
            self._alone.release()

    def desired(self, state: ControllerState, motion: Trajectory, t: float) -> Desired:
        """Return the desired motion at a time t [s], counted as the motion counts it.

        With a governor that is the motion at its own time s = t - lag, with derivatives by the
        chain rule; without one ``motion.at(t)``.

        Raises:
            InputError: a motion without ``at``, or one that failed there.
        """
        try:
            return motion.at(t) if state.path is None else state.path.desired(motion, t)
        except PinadaptError:
            raise
        except Exception as reason:  # whatever an object of the user raises
            raise motion_failed(t, reason) from reason

    def announce(
        self,
        state: ControllerState,
        *,
        payload: Load | EllipsisType = ...,
        tool_translation: ArrayLike | Mapping[str, ArrayLike] | None = None,
    ) -> ControllerState:
        """Return the state after announcing what the robot carries from now on.

        Pure, as ``step``, but it takes a millisecond or more.

        Args:
            state: until now.
            payload: the whole load from now on, None for none; left out, the load is as before.
                Where bodies have parameters of their own, those of the last body become the
                description's with this load, whatever was learned there before; the others keep
                what was learned. Other parameters (a basis, lumped ones) cannot separate the last
                body from the arm: they change by the difference between this load and the one last
                announced; a load that was learned without being announced stays in them. Of several
                task frames the loads are given by the frames' names, and so are tools.
            tool_translation: (3) [m] of the tool from now on, from the description's frame, in its
                axes; None: as before.

        Raises:
            InputError: the parameters cannot express it, or the load or tool is impossible.
        """
        self._inputs.state(state)
        after = announced_state(self, state, payload, tool_translation)
        if self._torque_filter is None or after.dynamic is state.dynamic:
            return after
        # what the low passes hold is of the load before
        return after._replace(
            filters=self._filters.undisturbed(after.filters),
            torque_filter=self._torque_filter.init(after.sensed.q, after.sensed.v),
        )

    def learned(self, state: ControllerState, along: AlongExcited | None = None) -> Robot:
        """Return the robot with the estimates of a state: bodies, translations, joints.

        What is not adapted is as described, with the load announced at first. The robot can serve
        as the model of another controller or as a plant, or be written with ``Robot.save``.

        Args:
            state: with the estimates.
            along: what the motion excited, from ``information.along_excited(controller, samples)``:
                bodies and joints are then the nearest to those at the start that predict the same
                torques. None: every estimate as it is.

        Raises:
            ParameterError: the bodies are not physical, as adaptation "gradient" may leave them, or
                the parameters are lumped products of lengths and inertias.
        """
        a_d, words = (state.a_d, "") if along is None else along.estimate(self, state)
        nominal = self.nominal.robot(self.nominal.load)
        learned = at_lengths(self.dynamics.robot(a_d, nominal), self.kinematics, state.a_k)
        return replace(learned, loads=(), remark=words)

    def recorded(self, state: ControllerState) -> ControllerState:
        """Return what a record keeps of a state: enough to ``observe``, and for V, not to go on.

        The filters of torque and regressor and a memory of past torques are left out: at every
        sample they would be most of what a run leaves.
        """
        dynamic = self.adaptation_d.recorded(state.dynamic)
        kinematic = self.adaptation_k.recorded(state.kinematic)
        same = dynamic is state.dynamic and kinematic is state.kinematic
        if same and not state.torque_filter and state.start is None:
            return state
        return state._replace(dynamic=dynamic, kinematic=kinematic, torque_filter=(), start=None)

    def disturbance(self, state: ControllerState) -> np.ndarray | None:
        """Return the torque (n) that acts on the joints and is not in the model [N m or N].

        The low-passed prediction error of the torque that the law subtracts, a momentum observer at
        the present estimate: contact, friction and lateness of motors that are not modelled, errors
        of the estimate. None for a law without ``lambda_d``, or an adaptation that does not predict
        the torque.
        """
        if self._torque_filter is None or not np.any(getattr(self.law, "lambda_d", 0.0)):
            return None
        filters = state.filters if state.start is None else state.start.filters
        return filters.disturbance

    def disturbance_noise(self, q: np.ndarray, dt: float) -> np.ndarray | None:
        """Return the deviation (n) of ``disturbance`` by noise of the joint velocity [N m or N].

        The noise n of v enters with the momentum M n and passes c / (p + c) of the senses,
        a p / (p + a) of the prediction and b / (p + b) of the disturbance. White noise leaves

            dt (a b c)^2 / (2 (a + b) (b + c) (c + a))

        of its variance; differences n = p r of the counts of an encoder, rounded by r, leave a b +
        b c + c a times as much of the variance of r, the square of a count over 12.

        Args:
            q: (nq) configuration.
            dt: sampling period [s].

        Returns:
            None where there is no ``disturbance``.
        """
        a = self.adaptation_d.torque_bandwidth
        b = np.asarray(getattr(self.law, "lambda_d", 0.0))
        if not (a and b.any() and dt < math.inf):
            return None
        low_pass = self.senses.low_pass
        sensors = self.sensors
        c = min(math.inf if low_pass is None else low_pass.bandwidth, 2.0 / dt)
        model = self.kinematics.robot.model
        constraints = self.kinematics.constraints
        M = pin.crba(model, model.createData(), q)
        if constraints is not None:
            M = constraints.free(q, np.zeros(len(M)))[0] @ M
        counts = np.broadcast_to(np.asarray(sensors.encoder, dtype=float), len(M))
        noise = sensors.deviation("v") ** 2 + (a * b + b * c + c * a) / 12.0 * counts**2
        passed = 0.5 * dt * (a * b * c) ** 2 / ((a + b) * (b + c) * (c + a))
        return np.sqrt(passed * ((M * M) @ noise))

    def step(
        self, state: ControllerState, measurement: Measurement, desired: Desired, dt: float
    ) -> tuple[np.ndarray, ControllerState]:
        """Return the torque (n) [N m or N] to hold for the next dt [s], and the next state.

        Everything that comes in is checked; ``state`` is as good as before, whatever is raised. A
        joint task ignores x.

        Raises:
            MeasurementError: a signal that the law uses is missing, of the wrong size or type, or
                not finite.
            ImplausibleError: a measurement that cannot be true of this robot, see ``Guards``.
            InputError: the desired motion, dt or the state cannot be used.
            DivergedError: torque or estimates went wrong, see ``watch``, or the law met a
                singularity.
            ContactError: a contact that stands lifted or slipped, unless there are no guards.
            InputError: another thread is using this controller.
        """
        self._reserve()
        try:
            s, sensed, elapsed = self._observe(state, measurement, desired, dt)
            if not elapsed:  # the time of the sample before
                s.adapting = False
            footing = self._footing(state.footing, s.stands, elapsed)
            model = self._model(state, s, elapsed)
            torque, drives = self.sent(s, self.law.command(s, model))
            dynamic = model.adaptation_d.step(model.dynamic, drives.dynamic, elapsed)
            kinematic = model.adaptation_k.step(model.kinematic, drives.kinematic, elapsed)
            for after, before in ((dynamic, s.a_d), (kinematic, s.a_k)):
                if not is_array(after.value, before.shape):
                    raise TypeError(f"the estimate is {shown(after.value)}")
            filters = self._filters.step(state.filters, s, elapsed)
            torque_filter = state.torque_filter
            path = state.path
            given = torque if self.compensation is None else torque + self.compensation(s.q)
            held = given.copy()  # the torque that goes out is the caller's
            if sensed.first is not None:
                sensed = sensed._replace(first=sensed.first._replace(sent=held))
            if path is not None:
                path = self._governed(path, s, sensed, given, elapsed)
            if self._torque_filter is not None:
                torque_filter = self._torque_filter.step(s.filtered_torque, held, elapsed)
            self.watch(torque, dynamic.value, kinematic.value)
        except ContactError:
            raise
        except (DivergedError, np.linalg.LinAlgError) as error:
            # a signal that is not finite is the likelier cause
            self._inputs.finite(*self._inputs.sample(state, measurement, desired))
            raise DivergedError(str(error)) from error
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            if not isinstance(error, PinadaptError):
                self._check_parts(state, measurement, desired)
            raise
        finally:
            self._alone.release()
        return torque, ControllerState(
            s.t, dynamic, kinematic, s.a_0, filters, state.adapting, state.load, sensed,
            torque_filter, path, missed=s.missed, footing=footing,
        )  # fmt: skip

    def safe(
        self,
        state: ControllerState,
        measurement: Measurement | None = None,
        *,
        damping: float = 30.0,
        hold: bool = True,
        beside: ArrayLike = 0.0,
    ) -> tuple[np.ndarray, ControllerState]:
        """Return the torque (n) that brings the arm to rest [N m or N], and the next state.

        Gravity by the estimate, damping, and springs that keep what the estimate has wrong from
        moving the arm far:

            tau = g(q; a_d) - diag(M(q)) (damping v + (damping / 2)^2 (q - q_0)),

        with M of the description, q_0 where it was called with ``hold`` first, and springs of at
        most half of the torque limits. The contacts that stood at the last step bear it.

        For an arm whose ``step`` was refused: it needs no x, and of q and v only what can be
        believed, joint by joint: while both follow from the sample before, both; differences of q
        where v does not; the integral of v where q does not, or is stuck; where neither does, or
        without a measurement, the motion of an arm that is damped. Hand the state on from sample to
        sample, as soon as one was refused. The estimates rest; to go on, begin with ``init`` and
        ``a_d=state.a_d``, or after a single refused sample with ``step`` and the state before it.

        A joint of which nothing is measured is braked by the model alone, and moves on where that
        is wrong. Look at ``state.unseen``, which tells it after 15 ms, and let the arm's brakes
        engage; only they rest it. This is no emergency stop, which needs no sensor.

        Args:
            state: the last one, of ``init``, ``step`` or ``safe``.
            measurement: whatever there is of the sample; None: nothing came.
            damping: rate at which a joint alone loses its speed [1/s]; less where the period of the
                controller is long.
            hold: whether there are springs; not for an arm that is moved by hand.
            beside: torque (n) that is added to gravity [N m or N], of a load that is not learned.

        Raises:
            InputError: the state is that of another controller, another thread is using this one,
                or a damping that is negative.
        """
        damping = positive(damping, "damping", zero=True)
        hold = flag(hold, "hold")
        with self.reserved():
            self._inputs.state(state)
            t = self._inputs.time(getattr(measurement, "t", None))
            period = self.period if math.isfinite(self.period) else PERIOD
            elapsed = t - state.t
            dt = elapsed if 0.0 < elapsed <= LATEST * period else period
            damping = min(damping, _DAMPED / period)
            model = self.kinematics.robot.model
            sensed = self.senses.fallback(state.sensed, measurement, dt, damping)
            zero = np.zeros(model.nv)
            self.dynamics.load(state.a_d)
            torque = self.dynamics.torque(sensed.q, zero, zero) + vector(beside, model.nv, "beside")
            inertia = np.diag(pin.crba(model, self._data, sensed.q))
            limits = torque_bounds(self.limits.torque, model.nv)
            torque -= damping * inertia * sensed.v
            displaced = sensed.monitor.joints[kernels.DISPLACED]
            if not hold:
                displaced[:] = 0.0
            spring = 0.25 * damping**2 * inertia * displaced
            torque -= np.clip(spring, -_SPRING * limits, _SPRING * limits)
            if self._forces is not None:
                torque = self._forces.solve(
                    sensed.q, torque, state.stands, limits=self.limits.torque
                ).torque
        torque = np.clip(torque, -limits, limits)
        if self.compensation is not None:
            torque = torque - self.compensation(sensed.q)
        later = t if t > state.t else state.t + dt
        return torque, state._replace(t=later, sensed=sensed)

    def _governed(
        self,
        path: PathTime,
        s: Signals,
        sensed: SensedState,
        torque: np.ndarray,
        elapsed: float | None,
    ) -> PathTime:
        """Return the time of the path after the elapsed time [s], or its derivative for None."""
        governor = self.limits.governor
        if governor is None:  # as in a ``SlowStart``, whose path has its own rate
            return path if elapsed is not None else PathTime(0.0, 0.0)
        age = 0.0 if sensed.frame is None else s.t - sensed.frame.t
        desired = s.xd_d, s.xdd_d
        limits = self.limits.torque
        target, cause = governor.target(path, s.dx, s.q, desired, s.inverse, torque, age, limits)
        if elapsed is None:
            return governor.rate(path, target, cause)
        return governor.step(path, target, cause, elapsed)

    def observe(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> Signals:
        """Return what the law uses: measurements, references, and the model at the estimates.

        Raises:
            MeasurementError, InputError: as ``step``.
        """
        with self.reserved():
            return self._seen(state, measurement, desired)

    def _seen(self, state: ControllerState, measurement: Measurement, desired: Desired) -> Signals:
        """Return what ``observe`` does, to a thread that has the controller to itself."""
        self._inputs.finite(*self._inputs.sample(state, measurement, desired))
        s = self._observe(state, measurement, desired)[0]
        s.xd, s.xd_d, s.xdd_d = s.xd.copy(), s.xd_d.copy(), s.xdd_d.copy()
        return s

    def command(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> tuple[Signals, Command]:
        """Return what the law uses, and its command: torque without limits, and drives.

        Raises:
            MeasurementError, InputError: as ``step``.
        """
        with self.reserved():
            s = self._seen(state, measurement, desired)
            return s, self.law.command(s, self._model(state, s, None))

    def contact_forces(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> np.ndarray:
        """Return forces [N] and torques [N m] (c, 6) that ``step`` chooses for c contacts.

        They act on the contacts' frames, in world axes; zero in the air.

        Raises:
            MeasurementError, InputError: as ``step``.
        """
        s, command = self.command(state, measurement, desired)
        if self._forces is None:
            return np.zeros((0, 6))
        return self._forces.of_contacts(self._borne(self._forces, s, command.torque).forces)

    def _borne(self, forces: ConstraintForces, s: Signals, wanted: np.ndarray) -> Solution:
        """Return motor torques and constraint forces of a torque (n) that the law asks for."""
        disturbance = getattr(s.filtered, "disturbance", None)
        return forces.solve(s.q, wanted, s.stands, disturbance, self.limits.torque)

    def respond(self, state: ControllerState, s: Signals) -> tuple[np.ndarray, Drives]:
        """Return the torque (n) to send for signals of ``observe`` [N m or N], and the drives.

        Args:
            state: of which the signals are.
            s: the signals; ``s.a`` may be replaced by another acceleration.

        Raises:
            InputError: another thread is using this controller.
        """
        with self.reserved():
            self.kinematics.update(s.a_k, s.q, s.v)  # another state may have been there since
            self.dynamics.load(s.a_d)
            return self.sent(s, self.law.command(s, self._model(state, s, None)))

    def _check_parts(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> None:
        """Look whether a law or an adaptation, perhaps a user's own, is why a step failed.

        Raises:
            InputError: one returns something else than arrays of the right sizes.
        """
        s = self._seen(state, measurement, desired)
        model = self._model(state, s, None)
        shapes = {
            "torque": s.v.shape,
            "drives.dynamic.gradient": s.a_d.shape,
            "drives.kinematic.gradient": s.a_k.shape,
        }
        drives = made_by(self.law, "command", (s, model), shapes).drives
        for part, before, drive in (
            (model.adaptation_d, model.dynamic, drives.dynamic),
            (model.adaptation_k, model.kinematic, drives.kinematic),
        ):
            made_by(part, "step", (before, drive, PERIOD), {"value": before.value.shape})

    def sent(self, s: Signals, command: Command) -> tuple[np.ndarray, Drives]:
        """Return the torque (n) to send for a command of the law [N m or N], and the drives.

        The limits of the motors hold for their torque, with the compensation that the arm adds.

        While a motor or a contact is at its limit, the tracking error shows the missing torque as
        well as the errors of the parameters, and would wind the estimates up. They then learn only
        from what holds for any torque, the prediction errors.

        Where motors are declared late, and the adaptation predicts the torque, the feedforward
        that a law returns leads by that time. dV/dt is then no equality; nor is it with late
        motors.
        """
        limits = self.limits.torque
        torque = command.torque
        drives = command.drives
        if not is_array(torque, s.v.shape):  # which no kernel would notice
            raise TypeError(f"the torque is {shown(torque)}")
        if command.feedthrough is not None:
            torque = torque + command.feedthrough @ s.a
        if s.filtered_torque is not None and s.residual is not None:
            drive = drives.dynamic
            drive.W = s.filtered_torque.W
            drive.residual = s.residual
            drive.weight = None
            if self._lead is not None and command.feedforward is not None:
                torque = torque + self._led(command.feedforward, s.filtered_torque, s.residual)
        if self._forces is not None:
            torque, _, s.missed = self._borne(self._forces, s, torque)
            if s.missed.size:
                drives = drives.without_tracking()
        if limits is not None and kernels.exceeds(torque, limits):
            torque = np.clip(torque, -limits, limits)
            drives = drives.without_tracking()
        return (torque if self.compensation is None else torque - self.compensation(s.q)), drives

    def _footing(self, before: np.ndarray, stands: np.ndarray | None, elapsed: float) -> np.ndarray:
        """Return where contacts stand (c, 3); the constraints are those of this sample.

        Raises:
            ContactError: one has moved.
        """
        constraints = self.kinematics.constraints
        if constraints is None:
            return before
        footing, moved = constraints.footing(before, stands, elapsed)
        if moved.max(initial=0.0) > self.limits.slip:
            foot = int(moved.argmax())
            frame = self.kinematics.robot.contacts[foot].frame
            raise ContactError(
                f"the contact '{frame}' lifted or slipped: it moved by {1e3 * moved[foot]:.3g} mm. "
                "Look for less friction than was declared, an obstacle, or a desired motion that "
                "is too fast.",
                frame,
            )
        return footing

    def _led(
        self, feedforward: np.ndarray, filtered: FilteredTorque, residual: np.ndarray
    ) -> np.ndarray:
        """Return T dtau_f/dt (n) through the low pass of the prediction, T the motors' lateness.

        It is T lambda (tau_f - F tau_f), F tau_f = W a_d over how far the low pass has risen: the
        feedforward at the measured motion.
        """
        if not filtered.state.underway:  # the first sample
            return np.zeros(feedforward.size)
        risen = -math.expm1(-filtered.bandwidth * filtered.state.underway.t)
        predicted = residual + filtered.state.y  # with the known part of the torque
        return self._lead * (filtered.state.projected(feedforward) - predicted / risen)

    def _model(self, state: ControllerState, s: Signals, dt: float | None) -> EstimatedModel:
        """Return the model at the estimates, for a torque that is held for dt [s], or None."""
        dynamic = state.dynamic
        if s.a_d is not dynamic.value:  # projected
            dynamic = dynamic.with_value(s.a_d)
        adaptation_k = self.adaptation_k
        adaptation_d = self.adaptation_d
        if not s.adapting:
            adaptation_k = adaptation_d = _HELD
        model = self._estimated
        model.adaptation_k = adaptation_k
        model.adaptation_d = adaptation_d
        model.kinematic = state.kinematic
        model.dynamic = dynamic
        model.dt = dt
        return model

    def _observe(
        self,
        state: ControllerState,
        measurement: Measurement,
        desired: Desired,
        dt: float | EllipsisType = ...,
    ) -> tuple[Signals, SensedState, float]:
        """Return the signals of a sample, what is kept of the sensors, and the elapsed time [s].

        The models are evaluated at the estimates. The references of the signals are those given.
        Without a period dt [s] the time is not checked.
        """
        sensed, resting, sample, desired, elapsed = self._sensed(state, measurement, desired, dt)
        kinematics, dynamic, (x_d, xd_d, xdd_d) = self.kinematics, state.dynamic, desired
        s = Signals()
        assert sensed.x is not None  # the first sample had one
        s.t, s.q, s.v, s.x, s.w = sample.t, sensed.q, sensed.v, sensed.x, sample.w
        s.a_k = state.kinematic.value
        s.a_0 = state.a_0
        s.a_d = dynamic.value
        if self._projects:
            s.a_d = self.adaptation_d.project(dynamic, s.q)
        self.dynamics.load(s.a_d)
        s.J = kinematics.J
        s.Jdot_v = kinematics.Jdot_v
        s.Y_k = kinematics.Y_k
        s.inverse = kinematics.inverse(s.q, s.v, self.limits.singular)
        feet = desired.feet
        s.stands = None if feet is None else feet.stands
        s.missed = FEASIBLE
        if feet is not None and kinematics.constraints is not None:
            alpha = self.law.alpha  # type: ignore[union-attr]  # of laws that are constrained
            s.inverse.moving(*kinematics.constraints.references(feet, s.v, alpha))
        s.xd_hat = kinematics.xd_hat
        s.xd_d = xd_d
        s.xdd_d = xdd_d
        s.dx, s.xd, s.delta = kinematics.task.errors(s.x, x_d, sample.xd, s.xd_hat, xd_d)
        s.epsilon = sensed.epsilon
        s.X_k = sensed.X_k
        s.filtered = self._filters.observe(state.filters, sensed, kinematics)
        a: Any = sample.a
        if a is None:
            a = getattr(s.filtered, "a", None)
        s.a = a
        s.filtered_torque = None
        s.residual = None
        if self._torque_filter is not None and (state.torque_filter or dt is not ...):
            tau = None  # what was commanded, unless a torque sensor is declared
            if self.sensors.torque_offset is not None and "tau" in self.sensors.noise:
                tau = self._inputs.torque(sample.tau)
            filtered = self._torque_filter.observe(state.torque_filter, s.q, s.v, tau, s.stands)
            s.filtered_torque, s.residual = filtered, filtered.W.dot(s.a_d) - filtered.y
            if self.limits.torque is not None:
                of_model = filtered.error(s.a_0)  # which no estimate explains away
                self.senses.guards.check_momentum(
                    sample, of_model, filtered.state.y, self.limits.torque, sensed.monitor
                )
        still = resting and not (xd_d.any() or xdd_d.any())
        still = still and np.abs(s.dx).max() < self.senses.guards.near
        s.adapting = state.adapting and not still
        return s, sensed, elapsed

    def _sensed(
        self,
        state: ControllerState,
        measurement: Measurement,
        desired: Desired,
        dt: float | EllipsisType,
    ) -> tuple[SensedState, bool, Measurement, Desired, float]:
        """Return what is kept of a sample, whether the joints rest, the inputs as they are used.

        That are the sample with what was bridged replaced, and the desired motion; and the elapsed
        time [s]. Without a period dt [s] the time is not checked.
        """
        measurement, desired = self._inputs.sample(state, measurement, desired)
        sensed, resting, measurement, elapsed = self.senses.read(
            state.sensed, state.t, measurement, self.kinematics, state.kinematic.value, dt,
            self.period, getattr(state.torque_filter, "tau", None),
        )  # fmt: skip
        return sensed, resting, measurement, desired, elapsed

    def rate(
        self, state: ControllerState, s: Signals, drives: Drives, torque: np.ndarray
    ) -> ControllerState:
        """Return d(state)/dt for the signals and the drives, to integrate as an ODE.

        Args:
            state: now.
            s: what the law used.
            drives: as ``respond`` returned them.
            torque: (n) of the joints [N m or N].
        """
        if not s.adapting:
            drives = Drives.none(s.a_d.size, s.a_k.size)
        memory = state.torque_filter
        path = state.path
        if self._torque_filter is not None:
            memory = self._torque_filter.rate(s.filtered_torque, torque)
        if path is not None:
            path = self._governed(path, s, state.sensed, torque, None)
        return ControllerState(
            t=1.0,
            dynamic=self.adaptation_d.rate(state.dynamic.with_value(s.a_d), drives.dynamic),
            kinematic=self.adaptation_k.rate(state.kinematic, drives.kinematic),
            a_0=np.zeros(state.a_0.size),
            filters=self._filters.rate(state.filters, s),
            adapting=state.adapting,
            torque_filter=memory,
            path=path,
        )

    def watch(self, torque: np.ndarray, a_d: np.ndarray, a_k: np.ndarray) -> None:
        """Refuse a torque (n) or estimates that diverged.

        Raises:
            DivergedError: they are not finite, or the estimates are larger than any robot's.
        """
        size = kernels.size_of_estimates(a_d, a_k, torque)
        if size < self.limits.estimate**2:
            return
        if not size < math.inf:
            raise DivergedError("the torque or the estimates are no longer finite.")
        raise DivergedError(
            f"the estimates diverged: their norm is {math.sqrt(size):.3g}. Try smaller gamma_d "
            "and gamma_k, natural adaptation, or a start nearer to the truth; "
            "stop_on_divergence=False does not end the run."
        )

    def parameter_storage(
        self, state: ControllerState, a_k_true: np.ndarray, a_d_true: np.ndarray
    ) -> float | None:
        """Return the parameters' part of V, or None where an adaptation leaves it undefined."""
        kinematic: float | None = 0.0
        if self.law.learns_kinematics:
            kinematic = self.adaptation_k.storage(state.kinematic, a_k_true)
        dynamic = self.adaptation_d.storage(state.dynamic, a_d_true)
        if kinematic is None or dynamic is None:
            return None
        return kinematic + dynamic


def predicted_at_rest(
    sensed: SensedState, kinematics: TaskKinematics, a_k: np.ndarray
) -> SensedState:
    """Return what was sensed at rest, the frame being where an estimate a_k (p) predicts it.

    Orientations and coordinates of joints are as measured.
    """
    kinematics.update(a_k, sensed.q, np.zeros(kinematics.nv))
    x = np.array(sensed.x, dtype=float)
    x[: kinematics.positions] = kinematics.p_hat
    return sensed._replace(x=x, frame=None, history=())
