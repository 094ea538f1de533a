"""Identification of a robot from a recorded motion: ``identify``, and its result."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .._checks import positive
from .._output import Sheet
from ..adaptation.adaptation import Adaptation
from ..controller.estimator import Estimator
from ..exceptions import InputError, LogError, ParameterError, TorqueMismatchError
from ..information.measured_motion import CUTOFF, Averages, MeasuredMotion
from ..information.payload import PayloadEstimate
from ..logs.formats import read_log
from ..logs.intake import Intake
from ..logs.log import Log, joined, starts_of
from ..models.physical_fit import physical_set
from ..models.translations import FIRST, PlacedTranslations
from ..robot.loading import load
from ..robot.motors import Compensation, compensation_of
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from ..simulation.simulate import Progress, watched
from ..tasks.task import JointTask
from ..tuning.make_controller import make_estimator
from ..tuning.unknowns import Unknown
from . import report
from .fits import (
    WEIGHT,
    Frames,
    Windows,
    frames_of,
    load_fit,
    position_fit,
    position_rows,
    torque_fit,
    windows_of,
)
from .identified_model import IdentifiedModel, estimate_online, measurements
from .logged_motion import motion_of_log
from .selection import ChosenEffects, blocks_of, choose_effects, effect_spread
from .torque_check import TorqueCheck, check_torques, on_wall

_FEWEST = 4  # windows, both in the fitted and in the held-out part
_PAUSE = 5.0  # [s] between logs, longer than any window


@dataclass(frozen=True, eq=False, repr=False)
class Identification(IdentifiedModel):
    """A robot identified from a log; ``print`` shows a report.

    The estimates and their errors are those of ``IdentifiedModel``.
    """

    @property
    def trusted(self) -> bool:
        """Whether the log can be one of the described robot, by its torques and positions."""
        fits = self.check is None or self.check.fits
        return fits and (not self.dynamic.names or report.position_doubt(self) is None)

    @property
    def verdict(self) -> str:
        """The result in one line."""
        return report.verdict(self)

    def report(self) -> str:
        """Return the estimates, their prediction errors, and what is not identifiable."""
        return str(self._sheet())

    def __repr__(self) -> str:
        """Return the report."""
        return self.report()

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        return report.sheet(self)

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None stands for what is not finite."""
        return report.summary(self)

    def save(self, folder: Path | str, *, mjcf: bool = False) -> None:
        """Write ``learned.urdf``, ``learned.json``, ``estimates.npz`` and ``summary.json``.

        Args:
            folder: that takes the files.
            mjcf: whether to write ``learned.xml`` too, see ``Robot.mjcf``.

        Raises:
            ParameterError: files of the robot that could not be written; the others are.
            OSError: they cannot be written.
        """
        report.save(self, Path(folder), mjcf=mjcf)

    def page(self, compared: Mapping[str, Robot] | None = None) -> str:
        """Return the report as one web page with pictures, without external resources.

        Args:
            compared: other models of the same chain by name, such as a published one, with their
                friction; the page compares their errors.

        Raises:
            ParameterError: a compared robot has other joints.
        """
        return report.page(self, compared)

    def plot(self, folder: Path | str | None = None) -> Any:
        """Draw measured and predicted torques, and the online estimates in time.

        Args:
            folder: into which to write ``torque.png`` and ``parameters.png``.

        Returns:
            The paths of the files; without a folder the two figures, which Jupyter displays.
        """
        return report.pictures_of(self) if folder is None else report.draw(self, Path(folder))


@threadpool_limits.wrap(limits=1, user_api="blas")
def identify(
    log: Path | str | Log | Rollout | Sequence[Any],
    robot: Robot | Path | str,
    *,
    test: Any = (),
    empty: Any = None,
    unknown: Unknown | str | Sequence[str] | None = None,
    adaptation: str | Adaptation = "natural-memory",
    compensated: Compensation | str | None = None,
    held_out: float = 0.25,
    intake: Intake | Mapping[str, Any] | Path | str | None = None,
    progress: Progress | bool | None = None,
) -> Identification:
    """Identify a robot from a recorded motion, whatever controller moved it.

    The result is the least-squares estimate over the whole log in the physical cone, see
    ``physical_fit``: translations first, then bodies, rotors and friction at the lengths found.
    Effects of the joints beside viscous and Coulomb friction, and rotor inertias, are chosen by
    cross-validation in the learning part, see ``choose_effects``. An ``Estimator`` also runs
    through the log sample by sample, as it would on the robot. The last
    quarter of the log is held out once, to measure how well the rest predicts it. Before anything
    is learned, ``check_torques`` compares the torques with the description.

    Args:
        log: a file, folder or ``Log``, see ``read_log``; or a rollout; or several of these.
        robot: as it is described, a ``Robot`` or what ``load`` takes.
        test: a log, or several, from which nothing is learned and whose torques are predicted, in
            place of the last part of ``log``.
        empty: a log of the same arm without its load: the load is then estimated from both, with
            bodies, friction and offsets in common.
        unknown: what is identified, an ``Unknown`` or words for it; by default the tool where the
            log has positions of the frame, all bodies, and effects of the joints as the log shows
            them. Those effects are not chosen but taken as given with ``armature``, and with
            ``friction`` or ``effects``.
        adaptation: of the estimator: one that predicts the torque, by name or as an object.
        compensated: torque that the arm adds by itself and the log leaves out: "nominal" for the
            description's gravity, or a callable of q (nq) that returns the torque (n).
        held_out: share of the log that is held out, at most a half.
        intake: how all logs are to be read, an ``Intake``, its fields or a TOML file; by default,
            each by the file beside it.
        progress: of the stages, then of the online estimates, as of ``simulate``: by default a bar
            on a terminal. A function wraps the samples of the online estimates alone.

    Raises:
        LogError: a log that cannot be used.
        TorqueMismatchError: torques that cannot be those of the described robot; its ``check`` has
            the likely causes. ``intake={"doubtful": True}`` learns nevertheless.
        RobotError: a robot that cannot be loaded.
        InputError: unknown words, or nothing is unknown.
    """
    described = robot if isinstance(robot, Robot) else load(robot)
    share = positive(held_out, "held_out", error=InputError)
    if share > 0.5:
        raise InputError(f"at most a half can be held out, got {share:g}.", where="held_out")
    sources, tests = _several(log), _several(test)
    given = (*sources, *tests, *(() if empty is None else (empty,)))
    intakes = [Intake.of(Intake.beside(one) if intake is None else intake) for one in given]
    logs: list[Log] = []
    for source, way in zip((*sources, *tests), intakes, strict=False):
        one, described = log_and_robot(source, described, way, compensated)
        logs.append(one)
    first_log, found = logs[0], joined(logs, _PAUSE)
    unknown = Unknown.of(unknown)
    frames, nominal = _frames_and_task(found, described, unknown)
    options: dict[str, Any] = {
        "adaptation": adaptation,
        "unknown": replace(unknown, regressor="nominal"),
        "dt": found.period,
    }
    estimator = _estimator(nominal, options)
    dynamics, kinematics = estimator.controller.dynamics, estimator.controller.kinematics
    if not (dynamics.size or kinematics.size):
        raise InputError("nothing is unknown, so there is nothing to identify.", where="identify")
    physical_set(dynamics, nominal)  # refuses other parameters
    doubtful = any(way.doubtful for way in intakes)
    check = _torques_checked(logs, described, doubtful=doubtful) if dynamics.size else None
    bar = _stages(progress)
    motion, starts = _motion_of(nominal, logs), starts_of(logs, _PAUSE)
    split = float(motion.t[-1] - share * (motion.t[-1] - motion.t[0]))
    if tests:
        split = starts[len(sources)] + float(logs[len(sources)].t[0]) - 0.5 * _PAUSE
    rows = position_rows(kinematics, motion, frames)
    located = position_fit(kinematics, rows.split(split)[0] if tests else rows)
    placed = _placed(estimator, nominal, located.estimate, options)
    bodies = windows_of(motion, placed.controller.dynamics.inertial, found.period, held=found.held)
    _check(bodies, bodies.between(-np.inf, split), found)
    next(bar)
    effects = _effects(placed, nominal, motion, bodies, split, unknown, found)
    if effects is not None:
        nominal = replace(nominal, friction=effects.friction)
        options["unknown"] = replace(options["unknown"], **effects.unknown(unknown))
        estimator = _estimator(nominal, options)
        placed = _placed(estimator, nominal, located.estimate, options)
        dynamics = estimator.controller.dynamics
    next(bar)
    physical = physical_set(dynamics, nominal)
    windows = windows_of(
        motion, placed.controller.dynamics, found.period, held=found.held, inertial=bodies
    )
    first = windows.between(-np.inf, split)
    learned_from = first if tests else windows
    load_estimate = None
    if empty is not None:
        one, _ = log_and_robot(empty, described, intakes[-1], compensated)
        _torques_checked([one], described, doubtful=doubtful)
        load_estimate = _load_between(placed, nominal, learned_from, one)
    blocks = blocks_of(len(learned_from.t))
    dynamic = torque_fit(dynamics, physical, learned_from, WEIGHT, blocks)
    if effects is not None and dynamic.spread is not None:
        others = effect_spread(
            nominal, motion, Averages(motion.t, found.period), learned_from, physical, dynamic
        )
        dynamic = replace(dynamic, spread=np.vstack([dynamic.spread, others]))
    for_load = torque_fit(dynamics, physical, learned_from) if empty is None else None
    next(bar, None)
    steps = watched(range(len(first_log.t)), progress, "online")
    samples = (
        sample for sample, _ in zip(measurements(first_log, nominal, frames), steps, strict=False)
    )
    return Identification(
        log=found,
        motion=motion,
        described=described,
        estimator=estimator,
        windows=windows,
        rows=rows,
        split=split,
        smoothed=motion.smoothed,
        dynamic=dynamic,
        kinematic=located,
        before_split=torque_fit(dynamics, physical, first, WEIGHT).estimate,
        unknown=options["unknown"].with_joints(),
        effects=effects,
        position_before_split=position_fit(kinematics, rows.split(split)[0]).estimate,
        online=estimate_online(estimator, samples, len(first_log.t)),
        tested=tuple(one.source for one in logs[len(sources) :]),
        load=load_estimate,
        for_load=for_load,
        check=check,
        intake=intakes[0].updated(**first_log.assumed),
    )


def _load_between(
    placed: Estimator, nominal: Robot, loaded: Windows, empty: Log
) -> PayloadEstimate:
    """Return the load that an arm carries in some windows, and not in a log."""
    dynamics = placed.controller.dynamics
    motion = motion_of_log(nominal, empty, cutoff=CUTOFF)
    without = windows_of(motion, dynamics, empty.period, held=empty.held)
    blocks = blocks_of(len(loaded.t)), blocks_of(len(without.t))
    physical = physical_set(dynamics, nominal)
    return load_fit(dynamics, physical, (loaded, without), nominal, WEIGHT, blocks)


def _stages(progress: Progress | bool | None) -> Iterator[int]:
    """Return a bar of the stages before the online estimates: next() ends one.

    They are the windows, the effects of the joints, the estimate.
    """
    stages = iter(watched(range(3), False if callable(progress) else progress, "identify"))
    next(stages)
    return stages


def _several(given: Any) -> tuple[Any, ...]:
    """Return one or several logs as a tuple."""
    return tuple(given) if isinstance(given, list | tuple) else (given,)


def _motion_of(robot: Robot, logs: Sequence[Log]) -> MeasuredMotion:
    """Return the motions of logs one after another, as in ``joined``; each is smoothed alone."""
    parts = [motion_of_log(robot, log, cutoff=CUTOFF) for log in logs]
    if len(parts) == 1:
        return parts[0]
    shifts = starts_of(logs, _PAUSE)
    t = np.concatenate([part.t + shift for part, shift in zip(parts, shifts, strict=True)])
    q, v, a, tau = (np.concatenate([part[k] for part in parts]) for k in range(1, 5))
    return MeasuredMotion(t, q, v, a, tau, any(part.smoothed for part in parts))


def _estimator(robot: Robot, options: Mapping[str, Any]) -> Estimator:
    """Return an estimator without the warning that concerns closed loops."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*nominal regressor")
        return make_estimator(robot, **options)


def _effects(
    placed: Estimator,
    robot: Robot,
    motion: MeasuredMotion,
    bodies: Windows,
    split: float,
    unknown: Unknown,
    log: Log,
) -> ChosenEffects | None:
    """Return the effects of the joints that the learning part shows, None if all were named."""
    dynamics = placed.controller.dynamics
    armature, others = unknown.armature is None, unknown.friction is None and not unknown.effects
    if not (armature or others) or dynamics.joints is None:
        return None
    return choose_effects(
        robot,
        motion,
        Averages(motion.t, log.period),
        bodies.between(-np.inf, split),
        physical_set(dynamics.inertial, robot),
        armature=armature,
        effects=others,
    )


def _torques_checked(logs: Sequence[Log], robot: Robot, *, doubtful: bool) -> TorqueCheck:
    """Return the check of the first log, or of the first one that does not fit.

    Raises:
        TorqueMismatchError: one does not fit, and doubts are not accepted.
    """
    checks = [check_torques(one, robot) for one in logs]
    check = next((one for one in checks if not one.fits), checks[0])
    if check.fits or doubtful:
        return check
    raise TorqueMismatchError(
        check.verdict,
        where=f"{check.source}: tau",
        hint="--accept-doubts learns nevertheless, without trust in the result; in Python "
        'intake={"doubtful": True}.',
        check=check,
    )


def log_and_robot(
    source: Any, robot: Robot, intake: Intake, compensated: Compensation | str | None
) -> tuple[Log, Robot]:
    """Return the log of a path, a ``Log`` or a ``Rollout``, and the robot as it was mounted.

    Raises:
        LogError: as ``read_log``, or no direction of gravity for an arm on a wall.
    """
    robot = intake.mounted(robot)
    log = log_of(source, robot, intake=intake)
    if intake.mount == "wall":
        robot = on_wall(log, robot)
    return _compensated(log, robot, compensated or intake.compensated), robot


def _placed(
    estimator: Estimator, robot: Robot, a_k: np.ndarray, options: Mapping[str, Any]
) -> Estimator:
    """Return an estimator for the robot with the estimated translations of its joints."""
    kinematics = estimator.controller.kinematics
    if all(part.joint in (None, FIRST) for part in kinematics.translations):
        return estimator
    model = robot.model.copy()
    PlacedTranslations(model, robot.frame_id, kinematics.translations).write(a_k)
    return _estimator(replace(robot, model=model), options)


def _compensated(log: Log, robot: Robot, compensated: Compensation | str | None) -> Log:
    """Return a log whose torques include what the arm adds by itself."""
    added = compensation_of(robot, compensated)
    if added is None:
        return log
    q, tau = log.configurations(robot), log.tau.copy()
    for k in np.flatnonzero(np.isfinite(q).all(axis=1)):
        tau[k] += added(q[k])
    return replace(log, tau=tau)


def _frames_and_task(log: Log, robot: Robot, unknown: Unknown) -> tuple[Frames, Robot]:
    """Return the frames of a log and the robot; with a joint task if there are no frames."""
    without = log.x is None or robot.task.positions == 0
    frames = Frames(np.zeros(0), np.zeros((0, 0))) if without else frames_of(log, robot)
    if len(frames.t):
        return frames, robot
    if unknown.translation_words(tool=False):
        raise ParameterError(
            "the log has no positions of the task frame, so no translations can be identified.",
            where="unknown",
            hint="Record x (a bag: --pose-topic), and load the robot with a task of the frame.",
        )
    return frames, replace(robot, task=JointTask.of_chain(robot.model))


def _check(windows: Windows, first: Windows, log: Log) -> None:
    """Check that there are enough windows to fit and to hold out.

    Raises:
        LogError: there are not.
    """
    if min(len(first.t), len(windows.t) - len(first.t)) < _FEWEST:
        raise LogError(
            f"only {len(windows.t)} windows of {windows.length:.2g} s have no gap, "
            f"{len(first.t)} of them before the held-out part.",
            where=log.source,
            hint="Record longer, without gaps between samples.",
        )


def log_of(source: Any, robot: Robot, **options: Any) -> Log:
    """Return the checked log of a path, a ``Log``, or a ``Rollout``, for a robot.

    The log of a rollout has its measurements since the last change of its robot, and the torques
    held in between.

    Raises:
        LogError: as ``read_log``.
    """
    return read_log(_recorded(source) if isinstance(source, Rollout) else source, robot, **options)


def _recorded(rollout: Rollout) -> Log:
    """Return the log of a rollout: its measurements, or the true motion if these are not kept."""
    since = max((at for at, what in rollout.marks if what != "announced"), default=-np.inf)
    evaluation, framed = rollout.evaluation, rollout.task.positions > 0
    x = rollout.x if framed else None
    if evaluation is None or not evaluation.samples:
        log = Log(rollout.t, rollout.q, rollout.tau, rollout.v, x=x, held=True, source="rollout")
        return log.after(since)
    measured = [sample.measurement for sample in evaluation.samples]
    frames = [part for part in measured if framed and part.x is not None]
    return Log(
        np.array([part.t for part in measured]),
        np.array([part.q for part in measured]),
        rollout.tau,
        np.array([part.v for part in measured]),
        x=np.array([part.x for part in frames]) if frames else None,
        x_time=np.array([part.t if part.x_time is None else part.x_time for part in frames]),
        held=True,
        source="rollout",
    ).after(since)
