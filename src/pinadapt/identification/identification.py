"""Identification of a robot from a recorded motion: ``identify``."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .._checks import name_list, positive
from ..controller.controller import Controller
from ..controller.limits import SLIP, Limits
from ..exceptions import InputError, LogError, ParameterError, TorqueMismatchError
from ..information.measured_motion import Averages, MeasuredMotion
from ..logs.formats import Source, read_log
from ..logs.import_options import ImportOptions, Options
from ..logs.log import Log, in_sequence, joined
from ..models.bodies import PAYLOAD
from ..models.joint_effects import KINDS
from ..models.physical_fit import physical_set
from ..models.translations import FIRST
from ..robot.loading import load
from ..robot.motors import compensation_of
from ..robot.robot import Robot
from ..tasks.task import JointTask
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown, UnknownLike, nominal_dynamics
from .estimator import Estimator
from .fits import (
    Windows,
    bounds_of_masses,
    load_fit,
    mass_equation,
    position_fit,
    position_windows,
    torque_fit,
)
from .logged_motion import motion_of_log, several
from .report import Identification
from .selection import choose_effects, with_shafts
from .torque_check import check_torques, on_wall

# windows, both in the fitted and in the held-out part; half, twice: shorter and longer logs refused
_FEWEST = 4
_PAUSE = 5.0  # [s] between logs: longer than any window, whatever it is; half, twice: the same


@threadpool_limits.wrap(limits=1, user_api="blas")
def identify(
    log: Source | Sequence[Any],
    robot: Robot | Path | str,
    *,
    test: Any = (),
    empty: Any = None,
    unknown: UnknownLike = None,
    total_mass: float | None = None,
    known_load: float | None = None,
    mass_bounds: Mapping[str, tuple[float, float]] | None = None,
    import_options: Options | None = None,
) -> Identification:
    """Identify a robot from a recorded motion, whatever controller moved it.

    The result is the least-squares estimate over the whole log in the physical cone, see
    ``physical_fit``: translations first, then bodies, rotors and friction at the lengths found.
    Effects of the joints beside viscous and Coulomb friction, and rotor inertias, are chosen by
    cross-validation in the learning part, see ``choose_effects``. The last quarter of the log is
    held out once, to measure how well the rest predicts it. Before anything is learned,
    ``check_torques`` compares the torques with the description.

    Of a robot with constraints, whose contacts all hold, only what no constraint force changes is
    compared; units and signs are not checked, and no effects are chosen.

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
        total_mass: of the whole robot when it moved, base and load included [kg], where a scale
            told it: bodies that the motion does not tell apart then share it.
        known_load: mass of the load that the log with ``empty`` lacks [kg]: the gain of each
            joint's torque is then found from what is not held out, and divided out.
        mass_bounds: least and largest mass of bodies [kg], by the joints that move them; one that
            the log alone would put beyond is put there, to a thousandth.
        import_options: how all logs are to be read, ``ImportOptions``, their fields or a TOML
            file; by default, each by the file beside it.

    Raises:
        LogError: a log that cannot be used, or is given twice.
        TorqueMismatchError: torques that cannot be those of the described robot; its ``check`` has
            the likely causes. ``import_options={"doubtful": True}`` learns nevertheless.
        RobotError: a robot that cannot be loaded, or several task frames whose payload is unknown.
        InputError: unknown words, a mass that is not positive, bounds that are none, a known load
            without ``empty``, or nothing is unknown.
        ParameterError: a total mass that leaves nothing for the unknown bodies, or a known load
            that the torques do not show.
    """
    unmounted = described = robot if isinstance(robot, Robot) else load(robot)
    for name, mass in (("total_mass", total_mass), ("known_load", known_load)):
        if mass is not None:
            positive(mass, name, error=InputError)
    if known_load is not None and empty is None:
        raise InputError(
            "one log does not tell wrong gains from a heavier or lighter arm.",
            where="known_load",
            hint="Record the arm without the load too: --empty, in Python empty=...",
        )
    sources = several(log)
    tests = several(test)
    logs = list[Log]()
    all_options = []
    for source in (*sources, *tests, *([] if empty is None else [empty])):
        all_options.append(ImportOptions.of(import_options, source))
        one, hung = log_and_robot(source, unmounted, all_options[-1])
        if logs and not np.array_equal(hung.model.gravity.linear, described.model.gravity.linear):
            raise LogError(
                f"the arm is mounted in another way than in {logs[0].source}.",
                where=one.source,
                hint="Identify each alone.",
            )
        described = hung
        for other in logs:
            if np.array_equal(one.tau, other.tau, equal_nan=True):
                raise LogError(
                    f"has the same torques as {other.source}.",
                    where=one.source,
                    hint="A test, and an arm without its load, need recordings of their own.",
                )
        logs.append(one)
    without = [] if empty is None else [logs.pop()]
    logs = in_sequence(logs, _PAUSE)
    found = joined(logs)
    given = replace(Unknown.of(unknown), regressor="nominal")
    if given.bodies == PAYLOAD:
        described.check_single_frame()
    frames, nominal = _frames_and_task(found, described, given)
    unknown = given.with_joints()
    controller = _controller(nominal, unknown)
    dynamics = controller.dynamics
    kinematics = controller.kinematics
    if not (dynamics.size or kinematics.size):
        raise InputError("nothing is unknown, so there is nothing to identify.", where="identify")
    physical_set(dynamics, nominal)  # refuses other parameters
    check = None
    if dynamics.size and not described.constraints:
        checks = (check_torques(one, described) for one in (*logs, *without))
        check = min(checks, key=lambda one: one.fits)  # the first that does not, if there is one
        if not (check.fits or any(way.doubtful for way in all_options)):
            refusal = TorqueMismatchError(
                check.verdict,
                where=f"{check.source}: tau",
                hint="--accept-doubts learns nevertheless, without trust in the result; in Python "
                'import_options={"doubtful": True}.',
            )
            refusal.check = check
            raise refusal
    # one after another, each smoothed alone
    *arrays, smoothed = zip(*(motion_of_log(nominal, one) for one in logs), strict=True)
    motion = MeasuredMotion._make([*map(np.concatenate, arrays), any(smoothed)])
    _check_contacts(nominal, motion)
    split = float(0.25 * motion.t[0] + 0.75 * motion.t[-1])
    learned = np.inf  # until then
    if tests:
        learned = split = float(logs[len(sources)].t[0]) - 0.5 * _PAUSE
    seen = position_windows(kinematics, motion, *frames)
    located = position_fit(kinematics, seen.between(last=learned))
    placed = nominal
    if any(part.joint not in (None, FIRST) for part in kinematics.translations):
        placed = replace(nominal, model=nominal.model.copy())
        kinematics.write(placed.model, located.estimate)
    online = Unknown(
        bodies=given.bodies,
        friction=given.friction,
        armature=given.armature,
        effects=given.effects,
    )
    estimator = Estimator(placed, online, period=found.period, held=False)
    averages = Averages(motion.t, found.period)
    everything = nominal_dynamics(with_shafts(placed), replace(unknown, effects=KINDS), ())
    windows = Windows.of(motion, averages, everything, described)
    first = windows.between(last=split)
    if min(len(first.t), len(windows.t) - len(first.t)) < _FEWEST:
        raise LogError(
            f"only {len(windows.t)} windows of {windows.length:.2g} s have no gap, "
            f"{len(first.t)} of them before the held-out part.",
            where=found.source,
            hint="Record longer, without gaps between samples.",
        )
    effects = None
    others = given.friction is None and not given.effects
    if not described.constraints and (given.armature is None or others):
        effects = choose_effects(
            nominal,
            motion,
            averages,
            first,
            everything,
            armature=given.armature is None,
            effects=others,
        )
        nominal, placed = (replace(one, friction=effects.friction) for one in (nominal, placed))
        given = replace(
            given,
            effects=(*name_list(given.effects, "unknown.effects"), *effects.words),
            armature=bool(given.armature),
        )
        unknown = given.with_joints()
        controller = _controller(nominal, unknown)
    dynamics = controller.dynamics
    model = nominal_dynamics(placed, unknown, ())
    physical = physical_set(dynamics, nominal)
    windows = Windows.of(motion, averages, model, described)
    weighed = mass_equation(dynamics, nominal, total_mass)
    bounds = bounds_of_masses(dynamics, mass_bounds)
    load_estimate = gains = None
    for one in without:
        still = motion_of_log(nominal, one)
        bare = Windows.of(still, Averages(still.t, one.period), model, described)
        part = learned if known_load is None else split
        load_estimate, gains = load_fit(
            model, (windows.between(last=part), bare), nominal, known_load
        )
    if gains is not None:
        motion = motion._replace(tau=motion.tau / gains.estimate)
        windows = windows.over(gains.estimate)
    return Identification(
        log=found,
        motion=motion,
        described=described,
        controller=controller,
        windows=windows,
        rows=seen,
        split=split,
        dynamic=torque_fit(physical, windows.between(last=learned), weighed, bounds),
        kinematic=located,
        before_split=torque_fit(physical, windows.between(last=split), weighed, bounds).estimate,
        unknown=unknown,
        effects=effects,
        position_before_split=position_fit(kinematics, seen.between(last=split)).estimate,
        estimator=estimator,
        tested=tuple(one.source for one in logs[len(sources) :]),
        load=load_estimate,
        gains=gains,
        check=check,
        stated=weighed,
        import_options=all_options[0],
    )


def _check_contacts(robot: Robot, motion: MeasuredMotion) -> None:
    """Refuse a motion in which a contact lifts or slips.

    Raises:
        LogError: one does.
    """
    constraints = robot.constrained
    footing = np.zeros((0, 3))
    steps = np.diff(motion.t, prepend=motion.t[0])
    samples = zip(motion.t, steps, motion.q, motion.v, strict=True)
    for t, step, q, v in samples if robot.contacts else ():
        constraints.at(q, v)
        before = footing[:0] if step >= _PAUSE else footing  # of the same log
        footing, moved = constraints.footing(before, None, step)
        if moved.max() > SLIP:
            frame = robot.contacts[moved.argmax()].frame
            raise LogError(
                f"the contact '{frame}' moves by {1e3 * moved.max():.3g} mm at {t:.3g} s.",
                where="q",
                hint="pa.Estimator is told which contacts stand, sample by sample.",
            )


def _controller(robot: Robot, unknown: Unknown) -> Controller:
    """Return a controller with these parameters, without the warning that concerns closed loops."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*nominal regressor")
        return make_controller(robot, unknown=unknown, limits=Limits(torque=False))


def log_and_robot(source: Any, robot: Robot, import_options: ImportOptions) -> tuple[Log, Robot]:
    """Return the log of a path, a ``Log`` or a ``Rollout``, and the robot as it was mounted.

    Raises:
        LogError: as ``read_log``.
    """
    robot = import_options.mounted(robot)
    log = read_log(source, robot, import_options=import_options)
    if import_options.mount == "wall":
        robot = on_wall(log, robot)
    added = compensation_of(robot, import_options.compensated)
    if added is None:
        return log, robot
    return replace(log, tau=log.tau + [added(q) for q in log.configurations(robot)]), robot


def _frames_and_task(
    log: Log, robot: Robot, unknown: Unknown
) -> tuple[tuple[np.ndarray, np.ndarray], Robot]:
    """Return the frames of a log and the robot; with a joint task if there are no frames.

    They are times (M) [s], and coordinates of the task (M, m).

    Raises:
        LogError: coordinates that the task does not have.
        ParameterError: translations are unknown, and there are no frames.
        RobotError: there are several task frames.
    """
    (t, x), wanted = log.frames(), robot.task.coordinates
    if len(t) and robot.task.positions:
        robot.check_single_frame()
        if wanted <= 3 <= x.shape[1] != wanted:
            x = x[:, :3][:, robot.frame_task.place]
        if x.shape[1] != wanted:
            raise LogError(
                f"{x.shape[1]} coordinates, and the task '{robot.task.name}' has {wanted}.",
                where=f"{log.source}: x",
                hint="Positions are x, y, z in world axes, in metres, poses x, y, z, qx, qy, qz, "
                'qw; a robot is loaded with task = "xyz" or "pose".',
            )
        return (t, x), robot
    if unknown.translation_words(tool=False):
        raise ParameterError(
            "the log has no positions of the task frame, so no translations can be identified.",
            where="unknown",
            hint="Record x (a bag: --pose-topic), and load the robot with a task of the frame.",
        )
    return (t[:0], x[:0]), replace(robot, task=JointTask.of_joints(robot.model))
