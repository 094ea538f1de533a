"""The model that was identified from a log, its uncertainty, and the errors of its predictions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..adaptation.adaptation import Estimate
from ..controller.estimator import Estimator
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..information.information import Excitation, Information
from ..information.measured_motion import MeasuredMotion
from ..information.payload import PayloadEstimate, explanations_of, payload_estimate
from ..information.torque_check import TorqueCheck
from ..logs.intake import Intake
from ..logs.log import Log
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown
from .fits import PositionRows
from .online import OnlineEstimates
from .selection import ChosenEffects, ChosenWeight
from .windows import Windows


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

    def summary(self) -> dict[str, list[float] | float | None]:
        """Return all numbers for a file; None where there are none."""
        rows: dict[str, list[float] | float | None] = {
            name: part.tolist() if np.isfinite(part).all() else None
            for name, part in self._asdict().items()
        }
        return rows | {"gain": self.gain}


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
        weight: of the description, as cross-validation chose it; None without dynamic parameters.
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
    weight: ChosenWeight | None = None
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
