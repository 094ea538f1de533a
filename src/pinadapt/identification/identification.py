"""What was learned from a recorded motion."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import instance, positive
from .._table import Sheet
from ..adaptation.adaptation import Adaptation, Estimate
from ..controller.estimator import Estimator
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..exceptions import InputError, LogError, ParameterError
from ..information.information import Excitation, Information
from ..information.payload import PayloadEstimate, payload_estimate
from ..logs.log import Log
from ..logs.read import read_log
from ..models.translations import FIRST, PlacedTranslations
from ..robot.loading import load
from ..robot.motors import Compensation, compensation_of
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from ..simulation.simulate import Progress, watched
from ..tasks.joint import JointTask
from ..tuning.make_controller import make_estimator
from ..tuning.unknowns import Words
from . import report as words
from .fits import (
    Frames,
    PositionRows,
    Windows,
    frames_of,
    position_fit,
    position_rows,
    torque_fit,
    windows_of,
)
from .motion import motion_of
from .online import OnlineEstimates, estimate_online, measurements
from .physical_fit import physical_set
from .report import Errors, columns_rms


def log_of(source: Any, robot: Robot, **options: Any) -> Log:
    """Return the checked log of a path, a ``Log``, or a ``Rollout``, for a robot.

    Of a rollout what its sensors said, since the last change of its robot, and the torques that
    were held.

    Raises:
        LogError: as ``read_log``.
    """
    return read_log(_recorded(source) if isinstance(source, Rollout) else source, robot, **options)


def _recorded(rollout: Rollout) -> Log:
    since = max((at for at, what in rollout.marks if what != "told"), default=-np.inf)
    evaluation, framed = rollout.evaluation, rollout.task.positions > 0
    x = rollout.x if framed else None
    if evaluation is None or not evaluation.samples:
        log = Log(rollout.t, rollout.q, rollout.tau, rollout.v, x=x, held=True, source="rollout")
        return log.after(since)
    measured = [sample.measurement for sample in evaluation.samples]
    seen = [part for part in measured if framed and part.x is not None]
    return Log(
        np.array([part.t for part in measured]),
        np.array([part.q for part in measured]),
        rollout.tau,
        np.array([part.v for part in measured]),
        x=np.array([part.x for part in seen]) if seen else None,
        x_time=np.array([part.t if part.x_time is None else part.x_time for part in seen]),
        held=True,
        source="rollout",
    ).after(since)


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """What a log told of a robot; ``print`` shows a report.

    Attributes:
        log: the motion, its columns in the order of the joints.
        described: the robot as described.
        estimator: that learned online; its ``controller`` has models and names.
        windows: rows of the torque, low-passed.
        rows: rows of the positions.
        split: time [s] from which on the log was held out once.
        smooth: whether velocities were taken from the positions.
        dynamic: the dynamic parameters from the whole log, and what is known of them.
        kinematic: the translations from the whole log, likewise.
        before_split: (p_d) the dynamic parameters from what was not held out.
        position_before_split: (p_k) the translations from it.
        online: the estimates in time.
    """

    log: Log
    described: Robot
    estimator: Estimator
    windows: Windows
    rows: PositionRows
    split: float
    smooth: bool
    dynamic: Information
    kinematic: Information
    before_split: np.ndarray
    position_before_split: np.ndarray
    online: OnlineEstimates

    @property
    def state(self) -> ControllerState:
        """The state of a controller with these estimates; see ``Controller.learned``."""
        return self.online.state._replace(
            dynamic=Estimate(self.dynamic.estimate), kinematic=Estimate(self.kinematic.estimate)
        )

    @property
    def robot(self) -> Robot:
        """The robot as learned; ``robot.save("learned.urdf")`` writes it.

        Raises:
            ParameterError: a body is on the border of what is physical.
        """
        learned = self.estimator.learned(self.state)
        return replace(learned, drawn=self.described.drawn, task=self.described.task)

    def parameters(self) -> LearnedParameters:
        """Return the estimates by name, from which a controller can start."""
        return LearnedParameters.of(self.estimator.controller, self.state)

    def payload(self) -> PayloadEstimate:
        """Return the load that explains best what was learned of all bodies.

        Raises:
            ParameterError: the last body is not among the parameters.
        """
        return payload_estimate(self.estimator.controller, self.dynamic)

    def excitation(self) -> Excitation:
        """Return which combinations of the parameters the motion could tell apart."""
        return Excitation(self.dynamic, self.kinematic, self.parameters().units)

    @cached_property
    def described_parameters(self) -> np.ndarray:
        """The dynamic parameters (p_d) of the description, its friction and rotors included."""
        value = self.estimator.controller.dynamics.value(self.described)
        return self.estimator.controller.dynamics.initial if value is None else value

    @cached_property
    def torque_errors(self) -> Errors:
        """Errors of the low-passed torques of the joints (n) [N m or N]."""
        last = self.windows.between(self.split, np.inf)
        return Errors(
            columns_rms(self.windows.tau),
            columns_rms(self.windows.residual(self.described_parameters)),
            columns_rms(self.windows.residual(self.dynamic.estimate)),
            columns_rms(last.residual(self.described_parameters)),
            columns_rms(last.residual(self.before_split)),
        )

    @cached_property
    def online_held_out(self) -> np.ndarray:
        """Errors (n) of the held-out torques by the online estimate of before [N m or N]."""
        last = self.windows.between(self.split, np.inf)
        return columns_rms(last.residual(self.online.at(self.split)))

    @cached_property
    def position_errors(self) -> Errors | None:
        """Errors of the positions (m) [m], or None where none were learned from."""
        rows, start = self.rows, self.estimator.controller.kinematics.initial
        if not len(rows.t) or not self.kinematic.names:
            return None
        last = rows.split(self.split)[1]
        return Errors(
            columns_rms(rows.r - rows.r.mean(axis=0)),
            columns_rms(rows.r),
            columns_rms(rows.r - rows.W @ (self.kinematic.estimate - start)),
            columns_rms(last.r),
            columns_rms(last.r - last.W @ (self.position_before_split - start)),
        )

    @property
    def verdict(self) -> str:
        """What it came to, in one line."""
        return words.verdict(self)

    def report(self) -> str:
        """Return what was learned, how well it predicts, and what the motion left open."""
        return str(self._sheet())

    def __repr__(self) -> str:
        """Return the report."""
        return self.report()

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        return words.sheet(self)

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None where no finite number is to be had."""
        return words.summary(self)

    def save(self, folder: Path | str) -> None:
        """Write ``learned.urdf``, ``learned.json``, ``estimates.npz`` and ``summary.json``.

        Raises:
            ParameterError: no URDF can have the estimates; the other files are written.
            OSError: they cannot be written.
        """
        words.save(self, Path(folder))

    def plot(self, folder: Path | str | None = None) -> Any:
        """Draw torques before and after, and the online estimates in time.

        Args:
            folder: into which to write ``torque.png`` and ``parameters.png``.

        Returns:
            The paths of the files; without a folder the two pictures, which show themselves in
            Jupyter.
        """
        from .pictures import draw, pictures_of

        return pictures_of(self) if folder is None else draw(self, Path(folder))


_FEWEST = 4  # windows, learned from and held out


def identify(
    log: Path | str | Log | Rollout,
    robot: Robot | Path | str,
    *,
    kinematic: Words | None = None,
    dynamic: str | Sequence[str] = "all",
    joint: str | Sequence[str] = "all",
    adaptation: str | Adaptation = "natural-memory",
    compensated: Compensation | str | None = None,
    held_out: float = 0.25,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    degrees: bool = False,
    topic: str | None = None,
    pose_topic: str | None = None,
    progress: Progress | bool | None = None,
) -> Identification:
    """Learn a robot from a motion that was recorded, whoever moved it.

    Twice: online, sample by sample, by an ``Estimator`` as it would have run beside the controller;
    and offline, by least squares over the whole log in the physical cone, see ``physical_fit``.
    The latter is the result, translations first, then what turns and rubs at the lengths found. The
    last quarter is held out once, to see what the rest predicts of it.

    Args:
        log: a file, folder or ``Log``, see ``read_log``; or a rollout.
        robot: as it is described, a ``Robot`` or what ``load`` takes.
        kinematic: unknown translations, as ``make_controller`` has them: by default the tool where
            the log has positions of the frame, else none.
        dynamic: unknown bodies: "all", "payload" (the last one), "none", or joint names.
        joint: unknown coefficients of the joints: "all", "none", or some of "armature", "viscous",
            "coulomb".
        adaptation: of the estimator: one that predicts the torque, by name or as an object.
        compensated: what the arm adds to the torques in the log, where these leave it out:
            "nominal" for gravity as described, or a callable of q (nq) that returns it (n).
        held_out: share of the log.
        columns: signal -> its columns in the file; see ``read_log``.
        degrees: whether angles are in degrees.
        topic: of a bag's joint states.
        pose_topic: of the frame's position in a bag.
        progress: of the online estimates, as of ``simulate``: by default a bar on a terminal.

    Raises:
        LogError: a log that cannot be used.
        RobotError: a robot that cannot be loaded.
        InputError: unknown words, or nothing to learn.
    """
    described = robot if isinstance(robot, Robot) else load(robot)
    share = positive(held_out, "held_out", error=InputError)
    if share > 0.5:
        raise InputError(f"at most a half can be held out, got {share:g}.", where="held_out")
    found = log_of(
        log, described, columns=columns, degrees=degrees, topic=topic, pose_topic=pose_topic
    )
    found = _compensated(found, described, compensated)
    frames, seen = _seen(found, described, kinematic)
    options: dict[str, Any] = {
        "adaptation": adaptation,
        "kinematic": kinematic,
        "dynamic": dynamic,
        "joint": joint,
        "dt": found.period,
        "regressor": "nominal",
    }
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*nominal regressor")  # no loop to prove
        estimator = make_estimator(seen, **options)
    dynamics, kinematics = estimator.controller.dynamics, estimator.controller.kinematics
    if not (dynamics.size or kinematics.size):
        raise InputError("nothing is unknown, so nothing can be learned.", where="identify")
    physical = physical_set(dynamics, seen)
    motion = motion_of(found, seen)
    split = float(motion.t[-1] - share * (motion.t[-1] - motion.t[0]))
    rows = position_rows(kinematics, motion, frames)
    located = position_fit(kinematics, rows)
    placed = _placed(estimator, seen, located.estimate, options)
    windows = windows_of(motion, placed.controller.dynamics, found.period, held=found.held)
    first = windows.between(-np.inf, split)
    _check(windows, first, found)
    steps = watched(range(len(found.t)), progress, "online")
    samples = (sample for sample, _ in zip(measurements(found, seen, frames), steps, strict=False))
    return Identification(
        log=found,
        described=described,
        estimator=estimator,
        windows=windows,
        rows=rows,
        split=split,
        smooth=motion.smooth,
        dynamic=torque_fit(dynamics, physical, windows),
        kinematic=located,
        before_split=torque_fit(dynamics, physical, first).estimate,
        position_before_split=position_fit(kinematics, rows.split(split)[0]).estimate,
        online=estimate_online(estimator, samples, len(found.t)),
    )


def _placed(
    estimator: Estimator, robot: Robot, a_k: np.ndarray, options: Mapping[str, Any]
) -> Estimator:
    """Return an estimator whose bodies are where the translations of joints were found to be."""
    kinematics = estimator.controller.kinematics
    if all(part.joint in (None, FIRST) for part in kinematics.translations):
        return estimator
    model = robot.model.copy()
    PlacedTranslations(model, robot.frame_id, kinematics.translations).write(a_k)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*nominal regressor")
        return make_estimator(replace(robot, model=model), **options)


def _compensated(log: Log, robot: Robot, compensated: Compensation | str | None) -> Log:
    """Return a log with the torques of the joints, where the arm adds some by itself."""
    added = compensation_of(robot, compensated)
    if added is None:
        return log
    q, tau = log.configurations(robot), log.tau.copy()
    for k in np.flatnonzero(np.isfinite(q).all(axis=1)):
        tau[k] += added(q[k])
    return replace(log, tau=tau)


def _seen(log: Log, robot: Robot, kinematic: Words | None) -> tuple[Frames, Robot]:
    """Return the frames of a log, and the robot with a task of which they tell."""
    instance(kinematic, str | Sequence | None, "kinematic")
    unseen = log.x is None or robot.task.positions == 0
    frames = Frames(np.zeros(0), np.zeros((0, 0))) if unseen else frames_of(log, robot)
    if len(frames.t):
        return frames, robot
    if kinematic:
        raise ParameterError(
            "the log has no positions of the task frame, so no translations can be learned.",
            where="kinematic",
            hint="Record x (a bag: --pose-topic), and load the robot with a task of the frame.",
        )
    return frames, replace(robot, task=JointTask.of_chain(robot.model))


def _check(windows: Windows, first: Windows, log: Log) -> None:
    """Refuse a log that is in pieces.

    Raises:
        LogError: it is.
    """
    if min(len(first.t), len(windows.t) - len(first.t)) < _FEWEST:
        raise LogError(
            f"only {len(windows.t)} windows of {windows.length:.2g} s have no hole in them, "
            f"{len(first.t)} of them before what is held out.",
            where=log.source,
            hint="Record longer, without pauses between samples.",
        )
