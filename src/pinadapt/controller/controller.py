"""The adaptive controller: one object for simulation and for the robot."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .._compiled import compile_all, compiled
from ..adaptation.adaptation import Adaptation
from ..exceptions import DivergedError, InputError, MeasurementError, ParameterError
from ..filters.low_pass import LowPass
from ..laws.law import Command, Gradients, Law, Signals
from ..models.dynamics import Dynamics
from ..models.frame_kinematics import FrameKinematics
from ..models.right_inverse import RightInverse
from ..records import Desired, Measurement
from .filters import advance_filters
from .limits import Limits
from .state import ControllerState


class Controller:
    """A control law, the believed robot, and how its estimates adapt.

    ``init`` and ``step`` are pure: all memory is in the ``ControllerState`` that goes in and comes
    out. The private Pinocchio models are scratch, so one controller serves one thread at a time.

    Attributes: law: the control law. kinematics, dynamics: the believed robot. adaptation_k,
        adaptation_d: how its estimates move. velocity_filter: lambda of (3)-(4).
        acceleration_filter: 1 / lambda_a. limits: what it does not exceed. loop: the robot over a
        typical motion, for the check before a run; None for a controller put together by hand.
    """

    def __init__(
        self,
        law: Law,
        kinematics: FrameKinematics,
        dynamics: Dynamics,
        *,
        adaptation_k: Adaptation,
        adaptation_d: Adaptation,
        velocity_filter: LowPass,
        acceleration_filter: LowPass,
        limits: Limits | None = None,
        loop: Any = None,
    ) -> None:
        """Put the parts together; ``pinadapt.make_controller`` does so with defaults for everything."""
        self.law = law
        self.kinematics, self.dynamics = kinematics, dynamics
        self.adaptation_k, self.adaptation_d = adaptation_k, adaptation_d
        self.velocity_filter, self.acceleration_filter = velocity_filter, acceleration_filter
        self.limits = Limits() if limits is None else limits
        self.loop = loop
        compile_all()

    def limited(self, torque: np.ndarray | None) -> Controller:
        """Return this controller with other torque limits (n) [N m or N]; it shares the scratch models."""
        other = copy.copy(self)
        other.limits = replace(self.limits, torque=torque)
        return other

    def init(
        self,
        measurement: Measurement,
        *,
        a_k: np.ndarray | None = None,
        a_d: np.ndarray | None = None,
    ) -> ControllerState:
        """Return the state to start from: filters at rest, estimates as given or as the believed robot has them.

        Args: measurement: the first sample. a_k: (p_k) initial kinematic estimate [m]. a_d: (p_d)
            initial dynamic estimate; natural adaptation moves unphysical bodies into the cone, with
            a warning.

        Raises: MeasurementError: non-finite measurements. InputError: measurements of the wrong
            size, or none where the law needs one. ParameterError: estimates of the wrong size,
            non-finite, or outside the cone of natural adaptation.
        """
        self._check(measurement)
        task = self.kinematics.task
        for name, size in (
            ("q", self.kinematics.nq),
            ("v", self.kinematics.nv),
            ("x", task.coordinates),
        ):
            if np.shape(getattr(measurement, name)) != (size,):
                shape = np.shape(getattr(measurement, name))
                raise InputError(
                    f"expected {size} numbers, got shape {shape}.", where=f"measurement.{name}"
                )
        if flaw := task.flaw(measurement.x):
            raise InputError(f"{flaw}.", where="measurement.x")
        a_k = _estimate(a_k, self.kinematics.initial, "belief.kinematic", self.kinematics.names)
        a_d = _estimate(a_d, self.dynamics.initial, "belief.dynamic", self.dynamics.names)
        a_d = self.adaptation_d.admit(a_d)
        return ControllerState(
            a_d=a_d,
            a_k=self.adaptation_k.admit(a_k),
            a_0=a_d.copy(),
            W_k=np.zeros((task.positions, self.kinematics.size)),
            xi=self.velocity_filter.bandwidth * np.array(task.position(measurement.x), dtype=float),
            z=np.array(measurement.v, dtype=float),
        )

    def step(
        self, state: ControllerState, measurement: Measurement, desired: Desired, dt: float
    ) -> tuple[np.ndarray, ControllerState]:
        """Return the torque (n) [N m or N] to hold for the next dt [s], and the next state.

        Raises: MeasurementError: a signal the law uses is not finite; ``state`` is as good as
            before. InputError: the desired motion is not finite. DivergedError: torque or estimates
            went wrong, see ``watch``, or the law met a singularity.
        """
        try:
            signals = self.observe(state, measurement, desired)
            command = self.law.command(signals)
            a = self.acceleration(state, measurement)
            torque, (g_d, g_k) = self.respond(signals, command, a)
            a_d = self.adaptation_d.advance(signals.a_d, g_d, dt)
            a_k = self.adaptation_k.advance(state.a_k, g_k, dt)
            filtered = advance_filters(
                state, signals, self.velocity_filter, self.acceleration_filter, dt
            )
            after = ControllerState(a_d, a_k, state.a_0, *filtered)
            self.watch(torque, after)
        except (DivergedError, np.linalg.LinAlgError) as error:
            self._check(measurement, desired)  # a signal that fails is the likelier cause
            raise DivergedError(str(error)) from error
        return torque, after

    def respond(
        self, signals: Signals, command: Command, a: np.ndarray
    ) -> tuple[np.ndarray, Gradients]:
        """Return the torque (n) at joint acceleration a (n), within its limits, and the gradient signals.

        While a motor saturates, the tracking error tells of the lost torque as much as of the
        parameters, and following it winds the estimates up. They then learn only from what holds
        whatever the torque is, the kinematic prediction error.
        """
        torque, limits = command.at(a), self.limits.torque
        if limits is not None:
            clipped = np.minimum(np.maximum(torque, -limits), limits)
            if math.isfinite(torque.dot(torque)) and (clipped != torque).any():
                return clipped, Gradients(
                    np.zeros(signals.a_d.size), self.law.prediction_gradient(signals)
                )
        return torque, self.law.gradients(signals, command, a)

    def watch(self, torque: np.ndarray, state: ControllerState) -> None:
        """Refuse a torque (n) or estimates that went wrong.

        Raises:
            DivergedError: they are not finite, or the estimates are larger than any robot's.
        """
        size, effort = _squares(state.a_d, state.a_k, torque)
        if not math.isfinite(size + effort):
            raise DivergedError("the torque or the estimates are no longer finite.")
        if size > self.limits.estimate**2:
            raise DivergedError(
                f"the estimates ran away: their norm is {math.sqrt(size):.3g}. Try smaller gamma_d and gamma_k, natural "
                "adaptation, or a start nearer to the truth; watch = false goes on regardless."
            )

    def observe(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> Signals:
        """Evaluate the believed robot at the current estimates and return what the law may see."""
        q, v, x, xd = measurement.q, measurement.v, measurement.x, measurement.xd
        x_d, xd_d, xdd_d = desired
        v, xdd_d = np.asarray(v, dtype=float), np.asarray(xdd_d, dtype=float)
        kinematics, dynamics, task = self.kinematics, self.dynamics, self.kinematics.task
        if (
            state.a_k.size != kinematics.size
            or state.a_d.size != dynamics.size
            or state.W_k.shape != kinematics.Y_p.shape
        ):
            raise InputError("the state is that of another controller.", where="state")
        kinematics.update(state.a_k, q, v)
        a_d = self.adaptation_d.keep(state.a_d, q)
        dynamics.load(a_d)
        dx = np.asarray(task.error(x, x_d), dtype=float)
        xd_hat = kinematics.xd_hat
        if not dx.size == xdd_d.size == xd_hat.size:
            raise InputError(
                f"expected {xd_hat.size} task coordinates, got {desired}.", where="desired"
            )
        dxd_hat = xd_hat - xd_d
        y = self.velocity_filter.bandwidth * task.position(x) - state.xi
        inverse = RightInverse(kinematics.J, self.limits.singular)
        xd, delta = task.known_velocity(xd, xd_hat), task.drift(dx, xd_hat, xd_d)
        W_k, a_k, a_0, watch = state.W_k, state.a_k, state.a_0, self.limits.watch
        rate_k = partial(self.adaptation_k.rate, a_k)
        # in the order of the fields: eighteen keywords would cost more than the right inverse
        return Signals(
            q,
            v,
            xd,
            xd_d,
            xdd_d,
            dx,
            dxd_hat,
            W_k,
            y,
            a_k,
            a_d,
            a_0,
            kinematics,
            dynamics,
            inverse,
            rate_k,
            watch,
            delta,
        )

    def acceleration(self, state: ControllerState, measurement: Measurement) -> np.ndarray:
        """Return the joint acceleration (n): the measured one if there is one, else (v - z) / lambda_a."""
        if measurement.a is not None:
            return measurement.a
        return self.acceleration_filter.rate(state.z, measurement.v)

    def rate(
        self,
        state: ControllerState,
        measurement: Measurement,
        signals: Signals,
        gradients: Gradients,
    ) -> ControllerState:
        """Return d(state)/dt from what the law saw and its gradients, to integrate as an ODE; a_0 is kept as it is."""
        return ControllerState(
            a_d=self.adaptation_d.rate(signals.a_d, gradients.g_d),
            a_k=self.adaptation_k.rate(state.a_k, gradients.g_k),
            a_0=state.a_0,
            W_k=self.velocity_filter.rate(state.W_k, self.kinematics.Y_p),
            xi=self.velocity_filter.bandwidth
            * (signals.y + self.kinematics.y_p0),  # the input is lambda x + y_p0
            z=self.acceleration_filter.rate(state.z, measurement.v),
        )

    def command(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> tuple[Signals, Command]:
        """Return what the law saw and its command, torque still affine in the joint acceleration."""
        signals = self.observe(state, measurement, desired)
        return signals, self.law.command(signals)

    def _check(self, measurement: Measurement, desired: Desired | None = None) -> None:
        task = self.kinematics.task
        if desired is not None:
            if not np.isfinite(np.concatenate(desired)).all():
                raise InputError(f"the desired motion is not finite: {desired}.", where="desired")
            if flaw := task.flaw(desired.x_d):
                raise InputError(f"{flaw}.", where="desired.x_d")
        for name, value in zip(measurement._fields, measurement, strict=True):
            if value is not None and not np.isfinite(value).all():
                raise MeasurementError(name, value)
        if desired is not None and (flaw := task.flaw(measurement.x)):
            raise MeasurementError("x", measurement.x, flaw)
        if measurement.xd is None and self.law.needs_task_velocity:
            raise ParameterError(
                f"the law '{self.law.name}' needs the task velocity xd.",
                where="measurement",
                hint="Measure it, or take 'adaptive-inverse-dynamics', which does without.",
            )


def _estimate(
    given: np.ndarray | None, default: np.ndarray, where: str, names: tuple[str, ...]
) -> np.ndarray:
    """Return an initial estimate as a new array, or refuse it."""
    if given is None:
        return default.copy()
    estimate = np.array(given, dtype=float)
    if estimate.shape != default.shape or not np.isfinite(estimate).all():
        raise ParameterError(
            f"expected {default.size} finite numbers {list(names)}, got {estimate.tolist()}.",
            where=where,
        )
    return estimate


@compiled("UniTuple(f8, 2)(f8[:], f8[:], f8[:])", fills=0)
def _squares(a_d: np.ndarray, a_k: np.ndarray, torque: np.ndarray) -> tuple[float, float]:
    """Return |a_d|^2 + |a_k|^2 and |torque|^2."""
    size, effort = 0.0, 0.0
    for entry in a_d:
        size += entry * entry
    for entry in a_k:
        size += entry * entry
    for entry in torque:
        effort += entry * entry
    return size, effort
