"""The summary of a run: its numbers in files and tables, and its outcome in one line."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from textwrap import wrap
from typing import Any, TypeVar

import numpy as np

from .._output import Sheet, Table, number, percent, whole_file, write_text
from .._version import __version__
from ..controller.state import Bridged
from ..exceptions import InputError
from ..information.information import TorquePrediction
from ..laws import DEFAULT, LAWS
from ..tasks.frame import IMAGE, TASKS, ImageTask
from ..tasks.task import DISPLAYS, Display, JointTask, Task
from .limit_excess import LimitExcess
from .recording import CLOSE, Recording, Ringing, Slowdown, Transient, extreme, window

Run = TypeVar("Run", bound=Recording)

# The arrays of ``rollout.npz``.
RECORDED = ("t", "q", "v", "tau", "x", "x_d", "a_k", "a_d", "saturated", "path_time")
COMPUTED = (
    *("error", "a_k_true", "a_d_true", "lyapunov_curve", "disturbance", "disturbance_noise"),
    *("min_eig_M_hat", "singular_J_hat", "damping"),
)
_WIDTH = 70  # characters of a long cell; half: twice the lines; twice: wider than a terminal


def summary(rollout: Recording) -> dict[str, Any]:
    """Return the numbers of ``summary.json``; None stands for what is not finite."""
    return {
        "verdict": verdict(rollout),
        "error_share": error_share(rollout),
        "title": rollout.title,
        "law": rollout.law,
        "adaptation": rollout.adaptation,
        "task": rollout.task.name,
        "robot": rollout.robot,
        "nv": int(rollout.v.shape[1]),
        "joint_names": list(rollout.joint_names),
        "diverged": rollout.diverged,
        "reason": rollout.reason,
        "interrupted": rollout.interrupted,
        **_errors(rollout.distance, "error"),
        **({} if rollout.angle is None else _errors(rollout.angle, "angle")),
        **_of_picture(rollout),
        "tau_max": extreme(np.max, np.abs(rollout.tau)),
        "min_eig_M_hat": extreme(np.min, rollout.min_eig_M_hat),
        "min_singular_J_hat": extreme(np.min, rollout.min_singular_J_hat),
        "max_damping": extreme(np.max, rollout.damping),
        "max_damping_share": extreme(np.max, rollout.damping_share),
        "saturated": extreme(np.mean, rollout.saturated),
        "limits": rollout.limits.summary(),
        "steps": len(rollout.t),
        "wall_time_s": rollout.wall_time,
        "step_time_us": rollout.step_time * 1e6,
        "kinematic_names": list(rollout.kinematic_names),
        "dynamic_names": list(rollout.dynamic_names),
        "kinematic_base": rollout.kinematic_base,
        "torque_prediction": _prediction(rollout),
        "changes": [_transient(transient) for transient in rollout.transients],
        "slowed": [
            dict(zip(("from", "to", "cause", "least_rate"), each, strict=True))
            for each in rollout.slowed
        ],
        "ringing": None if rollout.ringing is None else rollout.ringing._asdict(),
        "bridged": rollout.bridged._asdict(),
        "recorded": _recorded(rollout),
        "version": __version__,
    }


def _of_picture(rollout: Recording) -> dict[str, float | None]:
    """Return the length [m] that a pixel counts as, and the tool's error in space [m]."""
    if not isinstance(rollout.task, ImageTask):
        return {}
    return {"pixel": rollout.task.pixel, "max_tool_error_last": rollout.beside_picture}


def _recorded(rollout: Recording) -> dict[str, Any]:
    """Return what ``load`` needs beside the arrays and the numbers that people read."""
    limits, task = rollout.limits, rollout.task
    found = {
        **{name: getattr(rollout, name) for name in _FIELDS},
        "continuous": task.continuous if isinstance(task, JointTask) else (),
        "slides": limits.slides,
        "limits_stated": limits.stated,
        "effort_limits": [x if np.isfinite(x) else None for x in rollout.effort_limits.tolist()],
    }
    return dict(json.loads(json.dumps(found)))  # lists in place of tuples


def _errors(norms: np.ndarray, name: str) -> dict[str, float | None]:
    """Return the largest norm in the first and last 10 %, and the rms in the last."""
    return {
        f"max_{name}_first": extreme(np.max, window(norms, True)),
        f"max_{name}_last": extreme(np.max, window(norms, False)),
        f"rms_{name}_last": extreme(_rms, window(norms, False)),
    }


def _prediction(rollout: Recording) -> dict[str, Any] | None:
    """Return how the first and the last estimate predict the torques, and what was excited."""
    found = rollout.prediction
    if found is None:
        return None
    shares = {"share_first": found.share_first, "share_last": found.share_last}
    return asdict(found) | {"not_excited": list(found.not_excited)} | shares


def _prediction_of(numbers: Mapping[str, Any] | None) -> TorquePrediction | None:
    """Return what ``_prediction`` has written."""
    if numbers is None:
        return None
    given = {field.name: numbers[field.name] for field in fields(TorquePrediction)}
    return TorquePrediction(**given | {"not_excited": tuple(given["not_excited"])})


def _prediction_rows(rollout: Recording) -> list[tuple[str, str]]:
    """Return rows for the predicted torques, for what was identifiable, and for what was not."""
    found = rollout.prediction
    if found is None:
        return []
    errors = f"{found.error_first:.3g} -> {found.error_last:.3g} N m"
    shares = f"{percent(found.share_first)} -> {percent(found.share_last)} of the torque"
    words = f"{found.identifiable} combinations of {len(rollout.dynamic_names)} parameters"
    if found.identifiable_error is not None:
        words += f", error {percent(found.identifiable_error)} of the start"
    still = wrap(found.not_excited_words(), _WIDTH, break_long_words=False)
    labels = ["not excited by this motion", *[""] * len(still)]
    return [
        ("predicted torque (rms error)", f"{errors}, {shares}"),
        ("identifiable by this motion", words),
        *zip(labels, still, strict=False),
    ]


def _transient(transient: Transient) -> dict[str, Any]:
    worst = transient.worst if np.isfinite(transient.worst) else None
    return {
        "at": transient.at,
        "what": transient.what,
        "max_error": worst,
        "time_back": transient.back,
    }


def brief(rollout: Recording) -> Sheet:
    """Return robot, law, duration and the largest errors."""
    numbers, unit = _errors(rollout.distance, "error"), rollout.task.groups[0].shown
    first, last = (
        number(numbers[f"max_error_{part}"], unit.unit, scale=unit.scale)
        for part in ("first", "last")
    )
    rows = [
        ("robot", f"{rollout.robot}, {rollout.v.shape[1]} joints, task {rollout.task.name}"),
        ("law", f"{rollout.law}, adaptation {rollout.adaptation}"),
        ("duration", f"{rollout.duration:.4g} s, {len(rollout.t)} samples"),
        ("largest error", f"{first} in the first 10 %, {last} in the last 10 %"),
    ]
    return Sheet(rollout.title, [Table([*rows, *_ended_early(rollout)])])


def sheet(rollout: Recording) -> Sheet:
    """Return a table of the main numbers, and one of the joints that exceed their limits."""
    numbers, (group, *more) = summary(rollout), rollout.task.groups
    sizes = f"{len(rollout.kinematic_names)} kinematic, {len(rollout.dynamic_names)} dynamic"
    singular = "m" if group.unit == "m" and not (more or group.display) else ""
    rows = [
        ("robot", f"{rollout.robot}, {numbers['nv']} joints"),
        ("law", rollout.law),
        ("adaptation", f"{rollout.adaptation}: {sizes}"),
        *_error_rows(numbers, "error", group.shown),
        *_error_rows(numbers, "angle", DISPLAYS["rad"]),
        ("largest torque", _largest_torque(rollout)),
        ("smallest eigenvalue of M_hat", number(numbers["min_eig_M_hat"], "kg m^2", digits=5)),
        (
            "smallest singular value of J_hat",
            number(numbers["min_singular_J_hat"], singular, digits=4),
        ),
        *_prediction_rows(rollout),
        ("V, first and last", _ends(rollout.lyapunov_curve)),
        ("joint limits", rollout.limits.verdict()),
        ("samples", f"{numbers['steps']} in {rollout.wall_time:.1f} s"),
        *_remarks(rollout, numbers),
    ]
    joints = [rollout.limits.table] if rollout.limits.exceeded else []
    return Sheet(rollout.title, [Table(rows), *joints])


def _error_rows(numbers: dict[str, Any], name: str, shown: Display) -> list[tuple[str, str]]:
    """Return rows of the errors of a name, as far as there are any, and of the tool beside it."""
    keys = {
        f"max_{name}_first": f"{name}, first 10 % (max)",
        f"max_{name}_last": f"{name}, last 10 % (max)",
        f"rms_{name}_last": f"{name}, last 10 % (rms)",
    }
    rows = [
        (words, number(numbers[key], shown.unit, scale=shown.scale))
        for key, words in keys.items()
        if key in numbers
    ]
    far, mm = numbers.get("max_tool_error_last"), DISPLAYS["m"]
    if name == "error" and far is not None:
        words = "tool error, from the picture, last 10 % (max)"
        rows.append((words, number(far, mm.unit, scale=mm.scale)))
    return rows


def _largest_torque(rollout: Recording) -> str:
    """Return the largest torque or force, and its joint."""
    tau = np.where(np.isfinite(rollout.tau), np.abs(rollout.tau), -1.0)
    if not tau.size or tau.max() < 0.0:
        return number(None)
    joint = int(np.argmax(tau.max(axis=0)))
    limits = rollout.limits
    unit = "N" if limits.slides[joint] else "N m"
    return f"{number(tau.max(), unit, digits=1)} ({limits.joints[joint]})"


def _ends(curve: Sequence[np.ndarray] | None) -> str:
    return "undefined" if curve is None else f"{curve[1][0]:.4g} -> {curve[1][-1]:.4g}"


def _remarks(rollout: Recording, numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows that only some runs have: events, damping, saturation, an early end."""
    rows = _change_rows(numbers["changes"], rollout.task.groups[0].shown)
    if numbers["max_damping"]:
        share, lost = np.mean(rollout.damping > 0.0), numbers["max_damping_share"]
        words = f"{share:.1%} of the time, up to {lost:.0%} of the task motion lost"
        rows.append(("damped near a singularity", words))
    if numbers["saturated"]:
        rows.append(("torque at its limit", f"{numbers['saturated']:.1%} of the time"))
    if rollout.slowed:
        rows.append(("path slowed", slowed_words(rollout)))
    if rollout.step_time:
        rows.append(("controller step (mean)", number(numbers["step_time_us"], "us", digits=0)))
    if any(rollout.bridged):
        found = [f"{count} of {name}" for name, count in rollout.bridged._asdict().items() if count]
        rows.append(("samples bridged by prediction", ", ".join(found)))
    return rows + _ended_early(rollout)


def _ended_early(rollout: Recording) -> list[tuple[str, str]]:
    """Return a row where the run was interrupted or diverged."""
    rows = []
    if rollout.interrupted is not None:
        rows.append(("INTERRUPTED", f"at {rollout.interrupted:.3f} s"))
    if rollout.diverged is not None:
        rows.append(("DIVERGED", f"at {rollout.diverged:.3f} s: {rollout.reason}"))
    return rows


def _change_rows(changes: list[dict[str, Any]], shown: Display) -> list[tuple[str, str]]:
    """Return one row for each change of the robot or announcement."""
    rows = []
    close = f"{CLOSE * shown.scale:.3g} {shown.unit}"
    for change in changes:
        worst = number(change["max_error"], shown.unit, scale=shown.scale)
        back = change["time_back"]
        words = f"not back under {close}" if back is None else f"under {close} after {back:.3f} s"
        rows.append((f"{change['what']} at {change['at']:g} s", f"worst {worst}, {words}"))
    return rows


def save(rollout: Recording, folder: Path) -> None:
    """Write ``rollout.npz`` and ``summary.json`` into a folder, which is created if missing.

    Each is written atomically. The recorded arrays are saved first, then again with those that are
    computed from them: this takes a while, and an interruption must not lose the run.
    """
    for names in (RECORDED, RECORDED + COMPUTED):
        arrays = {name: getattr(rollout, name) for name in names}
        with whole_file(folder / "rollout.npz") as file:
            np.savez_compressed(file, **{name: a for name, a in arrays.items() if a is not None})
    write_text(folder / "summary.json", json.dumps(summary(rollout), indent=2) + "\n")


def load(folder: Path, kind: type[Run]) -> Run:
    """Return the run that ``save`` wrote into a folder, with its numbers and without its robots.

    Args:
        folder: that has ``rollout.npz`` and ``summary.json``.
        kind: the class of the run.

    Raises:
        InputError: the files are missing, broken, or of another version of pinadapt.
    """
    if folder.is_file():
        raise InputError(
            "is a file of a run.", where=str(folder), hint=f"Give the folder: {folder.parent}."
        )
    try:
        numbers = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        with np.load(folder / "rollout.npz") as file:
            arrays = {name: file.get(name) for name in RECORDED + COMPUTED}
        rest = numbers["recorded"]
        given = {name: rest[name] for name in _FIELDS} | {name: arrays[name] for name in RECORDED}
        given |= {name: tuple(numbers[name]) for name in _NAMES}
        given |= {name: of(given[name]) for name, of in _FIELDS.items() if given[name] is not None}
        pixel, width = numbers.get("pixel"), given["x"].shape[1]
        task = _task(numbers["task"], given["joint_names"], rest["continuous"], width, pixel)
        run = kind(**given, task=task, evaluation=None)
        efforts = [np.inf if x is None else x for x in rest["effort_limits"]]
        run.__dict__.update(
            {name: arrays[name] for name in COMPUTED},
            beside_picture=numbers.get("max_tool_error_last"),
            kinematic_base=numbers["kinematic_base"],
            prediction=_prediction_of(numbers["torque_prediction"]),
            effort_limits=np.array(efforts),
            limits=LimitExcess.of_summary(
                numbers["limits"], tuple(rest["slides"]), stated=rest["limits_stated"]
            ),
        )
    except FileNotFoundError as error:
        raise InputError(
            f"has no {Path(error.filename).name}.",
            where=str(folder),
            hint="`rollout.save` and `pinadapt run` write one.",
        ) from error
    except Exception as error:  # of any kind, where a file is damaged
        raise InputError(
            f"does not hold a run of this version of pinadapt ({type(error).__name__}: {error}).",
            where=str(folder),
            hint="Run it again.",
        ) from error
    return run


_NAMES = ("joint_names", "kinematic_names", "dynamic_names")
# fields of a run as JSON has them, and what makes them again of that
_FIELDS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("title", "robot", "law", "adaptation", "reason"), str),
    **dict.fromkeys(("diverged", "interrupted", "wall_time", "step_time"), float),
    **dict.fromkeys(("path_extent", "unadapted"), float),
    "marks": lambda rows: tuple((at, what) for at, what in rows),
    "slowed": lambda rows: tuple(Slowdown(*row) for row in rows),
    "ringing": lambda row: Ringing(*row),
    "bridged": lambda row: Bridged(*row),
}


def _task(
    name: str,
    joints: tuple[str, ...],
    continuous: Sequence[bool],
    coordinates: int,
    pixel: float | None,
) -> Task:
    """Return the task of this name; a joint task needs its joints and which are continuous.

    Of a picture with so many coordinates the cameras are not kept.
    """
    if name == IMAGE:
        return ImageTask.seen_by(
            TASKS["xyz"], [np.eye(4)[[0, 1, 3]]] * (coordinates // 2 + coordinates % 2), pixel
        )
    return TASKS[name] if name in TASKS else JointTask(name, joints, tuple(continuous))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# The outcome in one line: accuracy, limits exceeded, what to try

ACCURATE, ROUGH = 0.02, 0.2  # errors in the last 10 %, relative to the path's extent
BETTER = 0.2  # error relative to that without adaptation, above which adaptation hardly helps
FOLLOWS, ROUGHLY, LOST = "follows", "follows roughly", "does not follow"
TURN = 0.2  # [rad] taken as the extent of a change of orientation
_POINT = CLOSE / ACCURATE  # taken as the extent of a point [m or rad]
_OFTEN = (
    0.05  # share of the samples; half or twice: other advice for runs that fail for two reasons
)
_SETTLED = 5.0  # [s] after which a loop with default gains has converged; half or twice: as _OFTEN
_READABLE = 1e6  # larger numbers are written with an exponent
_MOTION = "desired"  # first word of the reason if the desired motion ended the loop
_LEAST_LAG, _MOST_LAG = 0.01, 0.03  # [s]; motors 15 ms late ring at 0.01, and not at 0.015 or 0.06


def error_share(rollout: Recording) -> float | None:
    """Return the largest error of the last 10 % relative to the path's extent; None for a point."""
    error = extreme(np.max, window(rollout.distance, False))
    return error / rollout.extent if error is not None and rollout.extent else None


def grade(rollout: Recording) -> str:
    """Return the verdict in a few words."""
    if rollout.diverged is not None:
        return f"diverged at {rollout.diverged:.3f} s"
    if rollout.interrupted is not None:
        return f"interrupted at {rollout.interrupted:.3f} s"
    worst = _worst(rollout)
    if worst is None:
        return "no finite error"
    return FOLLOWS if worst <= ACCURATE else ROUGHLY if worst <= ROUGH else LOST


def verdict(rollout: Recording) -> str:
    """Return the verdict in one line."""
    reason = str(rollout.reason or "").rstrip(".")
    slowed = f"path slowed {slowed_words(rollout)}" if rollout.slowed else ""
    predicted = _prediction_words(rollout)
    rings = "" if rollout.ringing is None else ringing_words(rollout.ringing, rollout.law)
    parts = (reason, _error(rollout), slowed, _beyond(rollout), predicted, rings, _advice(rollout))
    return f"{grade(rollout)}: {'; '.join(part for part in parts if part)}."


def _worst(rollout: Recording) -> float | None:
    """Return the largest relative error of the last 10 %, of position or orientation."""
    error = extreme(np.max, window(rollout.distance, False))
    if error is None or rollout.angle is None:
        return None if error is None else error / (rollout.extent or _POINT)
    angle = extreme(np.max, window(rollout.angle, False))
    return None if angle is None else max(error / (rollout.extent or _POINT), angle / TURN)


def _error(rollout: Recording) -> str:
    """Return the error in the last 10 %: absolute, relative, and against no adaptation."""
    error = extreme(np.max, window(rollout.distance, False))
    if error is None:
        return "nothing was measured"
    unit, scale = rollout.task.groups[0].shown
    text = f"error of the last 10 % up to {_short(scale * error)} {unit}"
    if (share := error_share(rollout)) is not None:
        text += (
            f", {_short(100 * share, 2)} % of the path's {_short(scale * rollout.extent)} {unit}"
        )
    if rollout.beside_picture is not None:
        text += f", {_short(1e3 * rollout.beside_picture)} mm at the tool"
    if rollout.angle is not None:
        turn, angle = DISPLAYS["rad"], extreme(np.max, window(rollout.angle, False))
        text += "" if angle is None else f", and {_short(turn.scale * angle)} {turn.unit}"
    if rollout.unadapted is not None:
        without = f"{_short(scale * rollout.unadapted)} {unit} without adaptation"
        text += f", {_relative(error, rollout.unadapted)} the {without}"
    return text


def _prediction_words(rollout: Recording) -> str:
    """Return how well the last estimate predicts the torques of the motion, and the first did."""
    found = rollout.prediction
    if found is None or rollout.diverged is not None:
        return ""
    return (
        f"torques predicted to {percent(found.share_last)}, at first {percent(found.share_first)}"
    )


def ringing_words(ringing: Ringing, law: str) -> str:
    """Return that a torque rings under a law of this name, and what to do about it.

    A loop with damping at the rate 1 / lag and motors that are late by T rings at the frequency
    1 / (4 T) at its limit of stability; the lag is to be 2 T.
    """
    lag = min(max(0.5 / ringing.frequency, _LEAST_LAG), _MOST_LAG)
    longer = f"take a longer lag, for example lag = {lag:.2g}"
    slower = longer if hasattr(LAWS.get(law), "lag") else "lower the gains"
    return (
        f"the torque of {ringing.joint} rings at {ringing.frequency:.0f} Hz, {ringing.share:.0%} "
        "of its rms: declare the motors' delay or the joints' stiffness (limits.actuators), or "
        f"{slower}"
    )


def _relative(error: float, other: float) -> str:
    """Return an error relative to another one, as a share or a factor."""
    tiny = np.finfo(float).tiny
    if error > BETTER * other:
        return f"{error / max(other, tiny):.0%} of"
    return f"{_short(other / max(error, tiny), 2)} times less than"


def _short(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent up to a million."""
    whole = 10.0**digits <= value < _READABLE
    return f"{value:.0f}" if whole else f"{value:.{digits}g}"


def slowed_words(rollout: Recording) -> str:
    """Return when a governor slowed the path most, and why, and how late the path is at the end."""
    longest = max(rollout.slowed, key=lambda each: each.end - each.start)
    words = (
        f"{len(rollout.slowed)} times, longest from {_short(longest.start)} to "
        f"{_short(longest.end)} s by {longest.cause} (rate down to {longest.least_rate:.2g})"
    )
    if rollout.path_time is not None:
        late = float(rollout.t[-1] - rollout.path_time[-1])
        words += f", {_short(late, 2)} s late at the end"
    return words


def _beyond(rollout: Recording) -> str:
    """Return which joints exceed which limits, if the description states any."""
    limits = rollout.limits
    return limits.words() if limits.exceeded else "joint limits kept" if limits.stated else ""


def _advice(rollout: Recording) -> str:
    """Return the most likely remedy for a run that went badly, or nothing."""
    if rollout.interrupted is not None or grade(rollout) == FOLLOWS or rollout.ringing is not None:
        return ""
    if str(rollout.reason).startswith(_MOTION):
        return ""
    saturated, law = float(rollout.saturated.mean()), LAWS.get(rollout.law)
    if rollout.adaptation == "none" or (law is not None and not law.adapts):
        return 'nothing was adapted: try controller.adaptation = "natural", or another law'
    if saturated > _OFTEN:
        return (
            f"the motors were at their limit {saturated:.0%} of the time: try a longer "
            "trajectory.period, a smaller path, or a smaller load"
        )
    if rollout.diverged is not None:
        return (
            "try a fifth of controller.gamma_k or gamma_d, a longer trajectory.period, or a "
            "shorter controller.dt"
        )
    if (rollout.damping > 0.0).mean() > _OFTEN:
        return "the path comes close to a singularity: try another robot.q0 or a smaller path"
    if law is not None and law.set_point:
        return (
            "this law does not adapt the kinematics: measure the tool, take a set point inside "
            f'the workspace, or set controller.law = "{DEFAULT}", which adapts'
        )
    if rollout.t[-1] < _SETTLED:
        return "the error may still fall: try a longer simulation.duration"
    return "try controller.gamma_d three times as large, then gamma_k"
