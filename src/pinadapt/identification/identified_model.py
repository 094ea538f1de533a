"""Results of a log: the identified model, its uncertainty, the estimates at each sample."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..adaptation.adaptation import Estimate
from ..controller.estimator import Estimator
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..exceptions import LogError, MeasurementError
from ..information.information import Excitation, Information
from ..information.measured_motion import CUTOFF, MeasuredMotion
from ..information.payload import PayloadEstimate, explanations_of, payload_estimate
from ..logs.intake import Intake
from ..logs.log import Log
from ..records import Measurement
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown
from .fits import Frames, PositionRows, Windows
from .selection import ChosenEffects
from .torque_check import TorqueCheck

_KEPT = 2000  # estimates that are stored
_RATE = 2.0 * math.pi * CUTOFF  # [1/s] of the causal low pass
_SETTLED = 10.0 / _RATE  # [s]
_SAME = 1e-9  # [s] up to which two times are the same


class Errors(NamedTuple):
    """Root mean squares over time of n joints or m coordinates.

    Attributes:
        size: (n) of the measured signal, less its mean for positions [N m, N or m].
        described: (n) error of the description, over the whole log.
        learned: (n) error of the estimate from the whole log, over the whole log.
        described_held_out: (n) error of the description, over the held-out part.
        learned_held_out: (n) error of the estimate from the first part, over the held-out part.
    """

    size: np.ndarray
    described: np.ndarray
    learned: np.ndarray
    described_held_out: np.ndarray
    learned_held_out: np.ndarray

    @property
    def gain(self) -> float | None:
        """Factor by which the held-out error falls, all signals together; None without data."""
        before, after = rms(self.described_held_out), rms(self.learned_held_out)
        return None if not np.isfinite(before) or not after > 0.0 else before / after

    def summary(self) -> dict[str, Any]:
        """Return all numbers for a file."""
        return {**self._asdict(), "gain": self.gain}


def rms(values: np.ndarray) -> float:
    """Return the root mean square of all numbers; NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else np.nan


def _columns_rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column of (N, n); NaN of none."""
    if not len(values):
        return np.full(values.shape[1], np.nan)
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedModel:
    """Estimates from a log, in SI units.

    Attributes:
        log: the motion, its columns in the order of the joints.
        motion: in it, with the velocities that were used.
        described: the robot as described.
        estimator: of the online estimates; its ``controller`` has models and names.
        windows: equations of the torque, averaged over windows.
        rows: equations of the positions.
        split: time [s] from which on the log was held out once.
        smoothed: whether velocities were computed from low-passed positions.
        dynamic: the dynamic parameters from the whole log, with their information.
        kinematic: the translations from the whole log, likewise.
        before_split: (p_d) the dynamic parameters from the log before ``split``.
        position_before_split: (p_k) the translations from it.
        online: the online estimates in time.
        unknown: what was identified. A controller with the same parameters is
            ``make_controller(found.robot, unknown=found.unknown)``.
        effects: of the joints, as cross-validation chose them; None where the caller named them.
        tested: names of the logs that were held out; empty where it is the last part of one log.
        for_load: the dynamic parameters with hardly any weight of the description, from which the
            load follows; None: ``dynamic``.
        load: estimated from this log and one without it; None without such a log.
        check: the comparison of the torques with the description, None where none were needed.
        intake: how the log was read.
    """

    log: Log
    motion: MeasuredMotion
    described: Robot
    estimator: Estimator
    windows: Windows
    rows: PositionRows
    split: float
    smoothed: bool
    dynamic: Information
    kinematic: Information
    before_split: np.ndarray
    position_before_split: np.ndarray
    online: OnlineEstimates
    unknown: Unknown
    effects: ChosenEffects | None = None
    tested: tuple[str, ...] = ()
    load: PayloadEstimate | None = None
    for_load: Information | None = None
    check: TorqueCheck | None = None
    intake: Intake = field(default_factory=Intake)

    @property
    def state(self) -> ControllerState:
        """The state of a controller with these estimates; see ``Controller.learned``."""
        return self.online.state._replace(
            dynamic=Estimate(self.dynamic.estimate), kinematic=Estimate(self.kinematic.estimate)
        )

    @property
    def robot(self) -> Robot:
        """The robot with the estimated parameters; ``robot.save("learned.urdf")`` writes it.

        Raises:
            ParameterError: a body is on the border of what is physical.
        """
        learned = self.estimator.learned(self.state)
        return replace(learned, drawn=self.described.drawn, task=self.described.task)

    def parameters(self) -> LearnedParameters:
        """Return the estimates by name and their information, from which a controller can start."""
        rows = self.dynamic.equations[0][: self.dynamic.rank]
        return LearnedParameters.of(self.estimator.controller, self.state, rows=rows)

    def payload(self) -> PayloadEstimate:
        """Return the load that best explains the change of all bodies, and what else does.

        With a log of the arm without its load: the load that explains the difference.

        Raises:
            ParameterError: the last body is not among the parameters.
        """
        if self.load is not None:
            return self.load
        controller = self.estimator.controller
        dynamics = controller.dynamics
        whole = dynamics.per_body and len(dynamics.bodies) == len(self.described.joint_names)
        found = self.for_load or self.dynamic
        others = explanations_of(controller, dynamics, found) if whole else ()
        return payload_estimate(controller, found, others=others)

    def excitation(self) -> Excitation:
        """Return which parameters the motion can identify, and how well."""
        return Excitation(self.dynamic, self.kinematic, self.parameters().units)

    @cached_property
    def described_parameters(self) -> np.ndarray:
        """The dynamic parameters (p_d) of the description, its friction and rotors included."""
        controller = self.estimator.controller
        value = controller.dynamics.value(controller.kinematics.robot)
        return controller.dynamics.initial if value is None else value

    @cached_property
    def torque_errors(self) -> Errors:
        """Errors of the window-averaged torques of the joints (n) [N m or N]."""
        last = self.windows.between(self.split, np.inf)
        return Errors(
            _columns_rms(self.windows.tau),
            _columns_rms(self.windows.residual(self.described_parameters)),
            _columns_rms(self.windows.residual(self.dynamic.estimate)),
            _columns_rms(last.residual(self.described_parameters)),
            _columns_rms(last.residual(self.before_split)),
        )

    @cached_property
    def online_held_out(self) -> np.ndarray:
        """Errors (n) of the held-out torques with the online estimate at the split [N m or N]."""
        last = self.windows.between(self.split, np.inf)
        return _columns_rms(last.residual(self.online.at(self.split)))

    @cached_property
    def position_errors(self) -> Errors | None:
        """Errors of the positions (m) [m], or None where no translation was estimated."""
        rows, start = self.rows, self.estimator.controller.kinematics.initial
        if not len(rows.t) or not self.kinematic.names:
            return None
        last = rows.split(self.split)[1]
        return Errors(
            _columns_rms(rows.r - rows.r.mean(axis=0)),
            _columns_rms(rows.r),
            _columns_rms(rows.r - rows.W @ (self.kinematic.estimate - start)),
            _columns_rms(last.r),
            _columns_rms(last.r - last.W @ (self.position_before_split - start)),
        )


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """Estimates in time.

    Attributes:
        t: (K) times [s].
        a_k: (K, p_k) kinematic estimates [m].
        a_d: (K, p_d) dynamic estimates.
        state: at the end.
        refused: number of samples that were refused.
        reason: why the first of them was, or None.
    """

    t: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    state: ControllerState
    refused: int
    reason: str | None

    def at(self, t: float) -> np.ndarray:
        """Return the last stored dynamic estimate (p_d) before a time [s]."""
        return np.asarray(self.a_d[max(int(np.searchsorted(self.t, t, side="right")) - 1, 0)])


def estimate_online(
    estimator: Estimator, samples: Iterable[Measurement], count: int
) -> OnlineEstimates:
    """Return the estimates of an estimator over at most ``count`` measurements.

    Measurements that the estimator refuses are skipped, as in the loop of a robot.

    Raises:
        LogError: all of them were refused.
        DivergedError: the estimates diverged.
    """
    state: ControllerState | None = None
    stored: list[ControllerState] = []
    refused, reason, every = 0, None, max(1, count // _KEPT)
    for k, sample in enumerate(samples):
        try:
            state = estimator.init(sample) if state is None else estimator.step(state, sample)
        except MeasurementError as error:
            refused += 1
            reason = reason or f"at {sample.t:g} s '{error.field}' {error.flaw}"
            continue
        if k % every == 0:
            stored.append(state)
    if state is None:
        raise LogError(f"the estimator refuses every sample: {reason}.", where="log")
    return OnlineEstimates(*_stacked([*stored, state]), state=state, refused=refused, reason=reason)


def _stacked(states: Sequence[ControllerState]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.array([state.t for state in states]),
        np.array([state.a_k for state in states]),
        np.array([state.a_d for state in states]),
    )


def measurements(log: Log, robot: Robot, frames: Frames) -> Iterator[Measurement]:
    """Yield one measurement a sample: q, v, the mean torque since the last one, x if there is one.

    If the log has no velocities, positions and torques pass the same causal low pass, and the
    velocity is the rate of its output. It delays all of them, and the frames, by 11 ms.
    """
    q, v, tau = log.configurations(robot), log.v, log.tau
    before = np.where(np.isfinite(tau[:-1]), tau[:-1], tau[1:])
    mean = np.vstack([tau[:1], tau[:-1] if log.held else 0.5 * (tau[1:] + before)])
    delay = 0.0 if v is not None else 1.0 / _RATE
    low_pass = _CausalLowPass(robot.model)
    count, taken = 0, frames.t + delay
    for k, t in enumerate(log.t.tolist()):
        x, x_time = None, None
        while count < len(taken) and taken[count] <= t + _SAME:
            x, x_time = frames.x[count], min(float(taken[count]), t)
            count += 1
        x_time = None if x_time is None or abs(x_time - t) <= _SAME else x_time
        if v is not None:
            yield Measurement(t, q[k], v[k], x, x_time, tau=mean[k])
            continue
        position, velocity, torque = low_pass.step(t, q[k], mean[k])
        if t >= log.t[0] + _SETTLED:
            yield Measurement(t, position, velocity, x, x_time, tau=torque)


class _CausalLowPass:
    """Positions and torques through a first-order low pass, exact for linear changes in between."""

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._memory: tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None

    def step(
        self, t: float, q: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and tau after the low pass; v is NaN if the sample is not finite."""
        if not (np.isfinite(q).all() and np.isfinite(tau).all()):
            return q, np.full(self._model.nv, np.nan), tau
        t_0, q_0, tau_0, slow, torque = self._memory or (t, q, tau, q, tau)
        lag = pin.difference(self._model, slow, q_0)
        change, x = pin.difference(self._model, q_0, q), _RATE * (t - t_0)
        share = -math.expm1(-x)
        ramp = 1.0 - share / x if x > 0.0 else 0.0  # of the change over the step
        slow = pin.integrate(self._model, slow, share * lag + ramp * change)
        torque = torque + share * (tau_0 - torque) + ramp * (tau - tau_0)
        self._memory = t, q, tau, slow, torque
        return slow, _RATE * pin.difference(self._model, slow, q), torque
