"""Estimators of dynamics against each other, on logs of real arms and on simulated motions.

``make estimators.table`` runs the sweep ``estimators.toml`` and writes ``estimators.csv``. The logs
are those of ``real_logs.py``, in the folder that ``REAL_LOGS`` names. All contenders get the same
samples of the first three quarters and, but for the default ``identify``, the same model: bodies,
rotors, viscous and Coulomb friction, constant torques. The rest of the log is held out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from time import process_time
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.identification.fits import Windows
from pinadapt.identification.identification import log_and_robot
from pinadapt.identification.logged_motion import motion_of_log
from pinadapt.information.measured_motion import Averages
from pinadapt.logs.import_options import ImportOptions
from pinadapt.models.regressor import inertial_parameters
from pinadapt.tasks.task import JointTask
from pinadapt.tuning.unknowns import nominal_dynamics

from .contenders.estimation import Estimates, LearningProblem
from .contenders.figaroh_fit import figaroh_fit
from .contenders.kalman_filter import kalman_filter
from .contenders.mujoco_sysid import mujoco_sysid
from .contenders.recursive_least_squares import recursive_least_squares
from .identification import LOAD, with_noise
from .real_logs import NAMES, folder, logs_of
from .shared import Row, grouped, markdown, quiet, table_rows

SAME = pa.Unknown(friction=True, armature=True, effects=("offset",))
HELD_OUT = 0.25
CARRIED = 5.0, 10.0, 15.0  # [s] a load comes, goes, and the held-out part begins
# What is tried, the best one held out counts: memory [s]; noise, deviation of bodies
# at the start, and what they gain in a second.
MEMORIES = [(memory,) for memory in (np.inf, 10.0, 3.0, 1.0, 0.3)]
SPREADS = list(product((5.0, 20.0, 80.0), (0.03, 0.1, 0.3), (0.0, 0.03)))
SIMULATED = "load", "load that comes and goes"


def problem_of(log: pa.Log, robot: pa.Robot) -> LearningProblem:
    """Return what can be learned from a log of a robot as described."""
    robot = replace(robot, task=JointTask.of_joints(robot.model))
    motion = motion_of_log(robot, log)
    dynamics = nominal_dynamics(robot, replace(SAME, tool=False), ())
    windows = Windows.of(motion, Averages(motion.t, log.period), dynamics, robot)
    split = float(motion.t[-1] - HELD_OUT * (motion.t[-1] - motion.t[0]))
    return LearningProblem(log, robot, motion, dynamics, windows, split)


@lru_cache(maxsize=1)
def problem(name: str) -> LearningProblem:
    """Return the problem of a real log or of a simulated motion."""
    if name in SIMULATED:
        return problem_of(*simulated(comes_and_goes=name != SIMULATED[0]))
    ((_, file, robot),) = logs_of(folder(), name)
    return problem_of(*log_and_robot(file, robot, ImportOptions.of(ImportOptions.beside(file))))


def simulated(*, comes_and_goes: bool) -> tuple[pa.Log, pa.Robot]:
    """Return a noisy log of a Panda with friction and a load, and the robot as described."""
    robot = pa.load("panda")
    bare = robot.changed(viscous=0.5, coulomb=0.8, armature=0.05)
    loaded = bare.changed(payload=LOAD)
    path = pa.trajectories.Lissajous(robot.position(robot.q0), [0.12, 0.2, 0.12], [3, 4, 5], 8.0)
    on, off, split = CARRIED
    run = pa.simulate(
        bare if comes_and_goes else loaded,
        pa.make_controller(robot),
        path.as_given(),
        duration=split / (1.0 - HELD_OUT) if comes_and_goes else 14.0,
        events=pa.Events({on: loaded, off: bare}) if comes_and_goes else None,
    )
    return replace(with_noise(run, robot), x=None, x_time=None), robot


# --- contenders ---


def identified(at: LearningProblem, unknown: pa.Unknown | None) -> tuple[Estimates, float]:
    """Return what ``identify`` finds, and its error; with effects of its own choice by default."""
    started = process_time()
    found = pa.identify(at.log, at.robot, unknown=unknown)
    seconds = process_time() - started
    size = at.dynamics.inertial.size
    a = found.before_split
    if unknown is None:  # the effects of the joints are others
        a = np.append(a[:size], at.dynamics.initial[size:])
    error = float(np.sqrt(np.mean(found.torque_errors.learned_held_out**2)))
    return Estimates(np.array([at.split]), a[None], seconds), error


def estimated(at: LearningProblem) -> tuple[Estimates, float]:
    """Return what the ``Estimator`` finds sample by sample, and its error."""
    motion = at.motion
    stops = [CARRIED[1] - 0.02, np.inf]
    samples = [
        pa.Measurement(t, q, v, tau=tau)
        for t, q, v, tau in zip(motion.t, motion.q, motion.v, motion.tau, strict=True)
        if t < at.split
    ]
    started = process_time()
    estimator = pa.Estimator(at.robot, period=at.log.period, held=False)
    state = estimator.init(samples[0])
    found = []
    for sample in samples[1:]:
        if sample.t >= stops[0]:
            stops.pop(0)
            found.append((state.t, estimator.estimate(state)))
        state = estimator.step(state, sample)
    found.append((state.t, estimator.estimate(state)))
    seconds = process_time() - started
    a = [
        np.append(inertial_parameters(one.model), at.dynamics.initial[at.dynamics.inertial.size :])
        for _, one in found
    ]
    masses = [0.0 if one.load is None else one.load.mass for _, one in found]
    t = np.array([t for t, _ in found])
    return Estimates(t, np.array(a), seconds, np.array(masses)), at.rms_of(found[-1][1].robot)


def best(
    at: LearningProblem, estimate: Callable[..., Estimates], settings: Sequence[tuple[float, ...]]
) -> tuple[tuple[float, ...], Estimates]:
    """Return the setting of an estimator with the least held-out error, and its estimates."""
    tried = [(setting, estimate(at, *setting)) for setting in settings]
    return min(tried, key=lambda one: at.rms(one[1].at(at.split)))


def estimates(at: LearningProblem, contender: str) -> tuple[str, Estimates, float]:
    """Return the setting of a contender, its estimates and its held-out error [N m].

    Raises:
        ValueError: it has none.
    """
    if contender == "identify":
        return "", *identified(at, None)
    if contender == "Estimator":
        return "", *estimated(at)
    note = ""
    if contender == "recursive least squares":
        (memory,), found = best(at, recursive_least_squares, MEMORIES)
        note = f"memory {memory:g} s"
    elif contender == "extended Kalman filter":
        (noise, deviation, walk), found = best(at, kalman_filter, SPREADS)
        note = f"noise {noise:g}, deviation {deviation:g}, walk {walk:g}"
    elif contender == "MuJoCo sysid":
        found = mujoco_sysid(at)
    elif contender == "identify, same model":
        found, _ = identified(at, SAME)
    else:
        stage = "fit" if contender == "figaroh, base parameters" else "physical_fit"
        found = figaroh_fit(at, stage)
    return note, found, at.rms(found.at(at.split))


@quiet()
def measure(log: str, contender: str) -> dict[str, Any]:
    """Return held-out error [N m], load [kg], bodies that are not physical, and time [s].

    ``note``: the setting that is best held out, or why there is no estimate. A contender whose
    package is not installed keeps its row.
    """
    at = problem(log)
    row: dict[str, Any] = dict.fromkeys(["rms", "unphysical", "cpu", "load_on", "load"])
    row |= {"note": "", "bodies": at.physical.bodies, "samples": len(at.learned.t)}
    try:
        row["note"], found, row["rms"] = estimates(at, contender)
    except ValueError as error:
        return row | {"note": str(error)}
    except ModuleNotFoundError:
        kept = grouped(table_rows("estimators"), "log", "contender").get((log, contender), [row])
        return dict(kept[0])
    row |= {"unphysical": at.unphysical(found.at(at.split)), "cpu": found.seconds}
    if log in SIMULATED:
        row["load"] = found.load(at, at.split)
    if log == SIMULATED[1]:
        row["load_on"] = found.load(at, CARRIED[1] - 0.02)
    return row


# --- tables ---

ONLINE = "recursive least squares", "extended Kalman filter", "Estimator"


def report(rows: Sequence[Row]) -> str:
    """Return errors, loads, bodies that are not physical, and times, by contender."""
    cells = []
    logs = [*grouped(rows, "log")]
    for contender, own in grouped(rows, "contender").items():
        line = [contender]
        for row in own:
            numbers = [row[key] for key in ("rms", "load_on", "load") if row[key] is not None]
            line.append(" / ".join(f"{number:.2f}" for number in numbers) or "none")
        worst = max(own, key=lambda row: row["unphysical"] or 0)
        wrong = worst["unphysical"]
        line.append(f"{wrong} of {worst['bodies']}" if wrong else "none")
        timed = own[logs.index(SIMULATED[0])]
        time = ""
        if timed["cpu"] is not None:
            time = f"{timed['cpu']:.2g} s"
        if contender in ONLINE:
            time = f"{1e3 * timed['cpu'] / timed['samples']:.2g} ms a sample"
        cells.append([*line, time])
    head = ["error [N m]", *(NAMES.get(log, log) for log in logs), "not physical", "time"]
    return markdown(head, cells)
