"""Results of a log: the identified model, its uncertainty, the estimates at each sample."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..adaptation.adaptation import Estimate
from ..controller.estimator import Estimator
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..exceptions import LogError, MeasurementError
from ..information.information import Excitation, Information
from ..information.measured_motion import Averages, MeasuredMotion
from ..information.payload import (
    ArmPrior,
    PayloadEstimate,
    described_robot,
    payload_estimate,
    payload_of_uncertain_arm,
)
from ..logs.import_options import ImportOptions
from ..logs.log import Log
from ..records import Measurement
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown
from .fits import Frames, PositionRows, Windows, columns_rms
from .selection import ChosenEffects
from .torque_check import TorqueCheck

_KEPT = 2000  # estimates that are stored
_SAME = 1e-9  # [s] up to which two times are the same


class Errors(NamedTuple):
    """Root mean squares over time of n joints or m coordinates.

    Attributes:
        size: (n) of the measured signal, less its mean for positions [N m, N or m].
        described: (n) error of the description, over the whole log.
        learned: (n) error of the estimate from the whole log, over the whole log.
        described_held_out: (n) error of the description, over the held-out part.
        learned_held_out: (n) error of the estimate from the first part, over the held-out part.
        gain: factor by which the held-out error falls, all signals together; None without data.
    """

    size: np.ndarray
    described: np.ndarray
    learned: np.ndarray
    described_held_out: np.ndarray
    learned_held_out: np.ndarray
    gain: float | None

    @classmethod
    def of(cls, *signals: np.ndarray) -> Errors:
        """Take the signal, and the errors (N, n) in the order of the attributes."""
        size, described, learned, *held_out = (columns_rms(part) for part in signals)
        before, after = held_out
        seen = len(signals[3]) and rms(signals[4]) > 0.0
        gain = rms(signals[3]) / rms(signals[4]) if seen else None
        return cls(size, described, learned, before, after, gain)


def rms(values: np.ndarray) -> float:
    """Return the root mean square of all numbers; NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else np.nan


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
        dynamic: the dynamic parameters from the whole log, with their information.
        kinematic: the translations from the whole log, likewise.
        before_split: (p_d) the dynamic parameters from the log before ``split``.
        position_before_split: (p_k) the translations from it.
        online: the online estimates in time.
        unknown: what was identified. A controller with the same parameters is
            ``make_controller(found.robot, unknown=found.unknown)``.
        effects: of the joints, as cross-validation chose them; None where the caller named them.
        tested: names of the logs that were held out; empty where it is the last part of one log.
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
    dynamic: Information
    kinematic: Information
    before_split: np.ndarray
    position_before_split: np.ndarray
    online: OnlineEstimates
    unknown: Unknown
    effects: ChosenEffects | None = None
    tested: tuple[str, ...] = ()
    load: PayloadEstimate | None = None
    check: TorqueCheck | None = None
    intake: ImportOptions = field(default_factory=ImportOptions)

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
        controller, found = self.estimator.controller, self.dynamic
        dynamics = controller.dynamics
        if dynamics.per_body and len(dynamics.bodies) == len(self.described.joint_names):
            return payload_of_uncertain_arm(controller, dynamics, found)
        prior = ArmPrior.of(described_robot(controller), dynamics, 0.0)
        return payload_estimate(controller, found, prior)

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
    def _held_out(self) -> Windows:
        return self.windows.between(self.split, np.inf)

    @cached_property
    def torque_errors(self) -> Errors:
        """Errors of the window-averaged torques of the joints (n) [N m or N]."""
        windows, last, start = self.windows, self._held_out, self.described_parameters
        learned = windows.residual(self.dynamic.estimate)
        held_out = last.residual(start), last.residual(self.before_split)
        return Errors.of(windows.tau, windows.residual(start), learned, *held_out)

    @cached_property
    def online_held_out(self) -> np.ndarray:
        """Errors (n) of the held-out torques with the online estimate at the split [N m or N]."""
        return columns_rms(self._held_out.residual(self.online.at(self.split)))

    @cached_property
    def late(self) -> tuple[float, float]:
        """How much later the torques seem to be than the positions, and its deviation [s]."""
        averages, noise = Averages(self.motion.t, self.log.period), self.dynamic.noise
        effect = -averages.derivative(self.motion.tau)[averages.whole] / noise
        left = self.windows.residual(self.dynamic.estimate) / noise
        return self.dynamic.beside(self.windows.W / noise[:, None], left, effect)

    @cached_property
    def position_errors(self) -> Errors | None:
        """Errors of the positions (m) [m], or None where no translation was estimated."""
        rows, start = self.rows, self.estimator.controller.kinematics.initial
        if not len(rows.t) or not self.kinematic.names:
            return None
        last, learned = rows.split(self.split)[1], rows.residual(self.kinematic.estimate - start)
        held_out = last.r, last.residual(self.position_before_split - start)
        return Errors.of(rows.r - rows.r.mean(axis=0), rows.r, learned, *held_out)


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """Estimates in time.

    Attributes:
        t: (K) times [s].
        a_k: (K, p_k) kinematic estimates [m].
        a_d: (K, p_d) dynamic estimates.
        state: at the end.
    """

    t: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    state: ControllerState

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
    reason, every = None, max(1, count // _KEPT)
    for k, sample in enumerate(samples):
        try:
            state = estimator.init(sample) if state is None else estimator.step(state, sample)
        except MeasurementError as error:
            reason = reason or f"at {sample.t:g} s '{error.field}' {error.flaw}"
            continue
        if k % every == 0:
            stored.append(state)
    if state is None:
        raise LogError(f"the estimator refuses every sample: {reason}.", where="log")
    t, a_k, a_d = zip(*((each.t, each.a_k, each.a_d) for each in (*stored, state)), strict=True)
    return OnlineEstimates(np.array(t), np.array(a_k), np.array(a_d), state)


def measurements(motion: MeasuredMotion, frames: Frames, *, held: bool) -> Iterator[Measurement]:
    """Yield one measurement a sample: q, v, the mean torque since the last one, x if there is one.

    Args:
        motion: of a log.
        frames: of the log.
        held: whether torques were held from each sample to the next.
    """
    tau = motion.tau
    mean = np.vstack([tau[:1], tau[:-1] if held else 0.5 * (tau[1:] + tau[:-1])])
    last = np.searchsorted(frames.t, motion.t + _SAME, side="right") - 1
    new = np.diff(last, prepend=-1) > 0
    for k, t in enumerate(motion.t.tolist()):
        x = frames.x[last[k]] if new[k] else None
        taken = min(float(frames.t[last[k]]), t) if new[k] else None
        yield Measurement(t, motion.q[k], motion.v[k], x, taken, tau=mean[k])
