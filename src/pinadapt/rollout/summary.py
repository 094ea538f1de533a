"""The summary of a run: one record of numbers, from which files, tables and the verdict follow."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, TypeAlias

import numpy as np

from .._output import Report, Table, as_json, percent, read_as_data, short
from .._version import __version__
from ..controller.controller import Controller
from ..controller.state import Bridged
from ..exceptions import InputError
from ..models.excited import names_together, rms
from ..tasks.frame import IMAGE, TASKS, ImageTask
from ..tasks.task import DISPLAYS, Display, JointTask, Task
from .recording import (
    CLOSE,
    FOLLOWS,
    Recording,
    Ringing,
    Shortfall,
    Slowdown,
    extreme,
    window,
)

Numbers: TypeAlias = dict[str, Any]  # those of ``summary.json``

# The arrays of ``rollout.npz``.
RECORDED = ("t", "q", "v", "tau", "x", "x_d", "a_k", "a_d", "saturated", "path_time")
COMPUTED = (
    "error",
    "a_k_true",
    "a_d_true",
    "lyapunov",
    "disturbance",
    "effort_limits",
    "min_eig_M_hat",
    "min_singular_J_hat",
)
# What ``load`` needs of a run beside these: as in the summary, and what people do not read.
_NAMED = (
    "title",
    "robot",
    "law",
    "adaptation",
    "diverged",
    "reason",
    "interrupted",
    "joint_names",
    "kinematic_names",
    "dynamic_names",
)
_KEPT = ("wall_time", "step_time", "marks", "path_extent", "unadapted", "not_identified")


def summary(run: Recording) -> Numbers:
    """Return the numbers of ``summary.json``; None stands for what is not finite."""
    numbers = {
        "verdict": "",  # follows from the others
        "error_share": run.error_share,
        **{name: getattr(run, name) for name in _NAMED},
        "task": run.task.name,
        "nv": run.v.shape[1],
        **_errors(run.distance, "error"),
        **({} if run.angle is None else _errors(run.angle, "angle")),
        "tau_max": extreme(np.max, np.abs(run.tau)),
        "min_eig_M_hat": extreme(np.min, run.min_eig_M_hat),
        "min_singular_J_hat": extreme(np.min, run.min_singular_J_hat),
        "saturated": extreme(np.mean, run.saturated),
        "limits": run.limits.summary(),
        "steps": len(run.t),
        "wall_time_s": run.wall_time,
        "step_time_us": run.step_time * 1e6,
        "kinematic_base": run.kinematic_base,
        "torque_prediction": run.prediction and vars(run.prediction),
        "changes": [each._asdict() for each in run.transients],
        "slowed": [each._asdict() for each in run.slowed],
        "infeasible": [each._asdict() for each in run.infeasible],
        "ringing": run.ringing and run.ringing._asdict(),
        "bridged": run.bridged._asdict(),
        "recorded": {name: getattr(run, name) for name in _KEPT},
        "version": __version__,
    }
    if isinstance(run.task, JointTask):
        task = run.task
        of_joints = task.labels, task.continuous, task.places, task.dofs, task.slides
        numbers["recorded"]["joints"] = of_joints
    if run.task.frames:
        numbers["recorded"]["frames"] = run.task.frames
    if isinstance(run.task, ImageTask):
        numbers |= {"pixel": run.task.pixel, "max_tool_error_last": run.beside_picture}
    numbers["verdict"] = _verdict(run, numbers)
    return as_json(numbers)


def _errors(norms: np.ndarray, name: str) -> dict[str, float | None]:
    """Return the largest norm in the first and last 10 %, and the rms in the last."""
    last = window(norms, False)
    return {
        f"max_{name}_first": extreme(np.max, window(norms, True)),
        f"max_{name}_last": extreme(np.max, last),
        f"rms_{name}_last": extreme(rms, last),
    }


def report_of(run: Recording, numbers: Numbers) -> Report:
    """Return a table of the main numbers, which ``summary`` has made; zeros are left out."""
    shown = run.task.groups[0].shown
    angle = DISPLAYS["rad"]
    cells = [
        ("error, first 10 % (max)", "max_error_first", shown),
        ("error, last 10 % (max)", "max_error_last", shown),
        ("error, last 10 % (rms)", "rms_error_last", shown),
        ("tool error, from the picture, last 10 % (max)", "max_tool_error_last", DISPLAYS["m"]),
        ("angle, first 10 % (max)", "max_angle_first", angle),
        ("angle, last 10 % (max)", "max_angle_last", angle),
        ("largest torque", "tau_max", Display("N m or N", 1.0)),
        ("torque at its limit", "saturated", Display("% of the time", 100.0)),
        ("smallest eigenvalue of M_hat", "min_eig_M_hat", Display("kg m^2 or kg", 1.0)),
        ("smallest singular value of J_hat", "min_singular_J_hat", Display("", 1.0)),
        ("controller step (mean)", "step_time_us", Display("us", 1.0)),
    ]
    adapted = f"{len(run.kinematic_names)} kinematic, {len(run.dynamic_names)} dynamic"
    rows = [
        ("robot", f"{run.robot}, {numbers['nv']} joints"),
        ("law", run.law),
        ("adaptation", f"{run.adaptation}: {adapted}"),
        *((words, _size(numbers[key], unit)) for words, key, unit in cells if numbers.get(key)),
        *_prediction_rows(numbers),
        ("samples", f"{numbers['steps']} in {run.wall_time:.1f} s"),
    ]
    for change in numbers["changes"]:
        back = change["time_back"]
        near = _size(CLOSE, shown)
        words = f"not back under {near}" if back is None else f"under {near} after {back:.3f} s"
        worst = f"worst {_size(change['max_error'], shown)}, {words}"
        rows.append((f"{change['what']} at {change['at']:g} s", worst))
    return Report(run.title, [Table(rows)])


def _size(value: float | None, shown: Display) -> str:
    """Return a number in the unit in which it is shown, a dash for None."""
    return "-" if value is None else f"{short(shown.scale * value)} {shown.unit}".rstrip()


def _prediction_rows(numbers: Numbers) -> list[tuple[str, str]]:
    """Return rows for the predicted torques, for what was identifiable, and for what was not."""
    found = numbers["torque_prediction"]
    if found is None:
        return []
    errors = f"{found['error_first']:.3g} -> {found['error_last']:.3g} N m or N"
    shares = f"{percent(found['share_first'])} -> {percent(found['share_last'])} of the torque"
    words = f"{found['identifiable']} combinations of {len(numbers['dynamic_names'])} parameters"
    if found["identifiable_error"] is not None:
        words += f", error {percent(found['identifiable_error'])} of that at the start"
    rows = [
        ("predicted torque (rms error)", f"{errors}, {shares}"),
        ("identifiable by this motion", words),
    ]
    label = "not excited by this motion"
    for line in wrap(names_together(found["not_excited"]), break_long_words=False):
        rows.append((label, line))
        label = ""
    return rows


def load(folder: Path) -> dict[str, Any]:
    """Return the fields of a run that ``save`` wrote into a folder; it has no robots.

    Args:
        folder: that has ``rollout.npz`` and ``summary.json``; or one of the two.

    Raises:
        InputError: the files are missing, broken, or of another version of pinadapt.
    """
    folder = folder.parent if folder.is_file() else folder
    with read_as_data(folder, InputError), np.load(folder / "rollout.npz") as file:
        numbers = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        ringing = numbers["ringing"]
        fields = {name: numbers[name] for name in _NAMED} | numbers["recorded"]
        return {
            **{name: tuple(x) if isinstance(x, list) else x for name, x in fields.items()},
            **{name: file.get(name) for name in RECORDED + COMPUTED},
            "numbers": numbers,
            "ringing": ringing and Ringing(**ringing),
            "bridged": Bridged(**numbers["bridged"]),
            "slowed": tuple(Slowdown(**row) for row in numbers["slowed"]),
            "infeasible": tuple(Shortfall(**row) for row in numbers["infeasible"]),
            "evaluation": None,
            "task": _task(numbers, file["x"].shape[1]),
        }


def _task(numbers: Numbers, coordinates: int) -> Task:
    """Return the task of a run; of a picture with so many coordinates without the cameras."""
    name = numbers["task"]
    recorded = numbers["recorded"]
    if "joints" in recorded:
        return JointTask(name, *map(tuple, recorded["joints"]))
    if name == IMAGE:
        cameras = [np.eye(4)[[0, 1, 3]]] * -(-coordinates // 2)
        return ImageTask.seen_by(TASKS["xyz"], cameras, numbers["pixel"])
    frames = recorded.get("frames")
    return TASKS[name] if frames is None else TASKS[name].of_frames(frames)


# Error relative to that without adaptation, above which it hardly helps; half or twice: fewer or
# more robots of the zoo do.
BETTER = 0.2


def _verdict(run: Recording, numbers: Numbers) -> str:
    """Return the verdict in one line."""
    found = numbers["torque_prediction"]
    parts = [(run.reason or "").rstrip("."), _error(run, numbers)]
    if run.slowed and run.path_time is not None:
        reached = f"{short(float(run.path_time[-1]))} of {short(float(run.t[-1]))} s"
        parts.append(f"path slowed to {reached}, {_longest(run.slowed)}")
    if run.infeasible:
        most = short(max(each.largest for each in run.infeasible))
        parts.append(f"torque infeasible {_longest(run.infeasible)}, up to {most} N or N m missed")
    parts.append(str(run.limits))
    if found is not None and run.diverged is None:
        parts.append(
            f"torques predicted to {percent(found['share_last'])}, "
            f"at first {percent(found['share_first'])}"
        )
    if numbers["saturated"] and run.grade != FOLLOWS:
        parts.append(f"the motors were at their limit {numbers['saturated']:.0%} of the time")
    if run.ringing is not None:
        parts.append(ringing_words(run.ringing, run.evaluated().controller))
    return f"{run.grade}: {'; '.join(part for part in parts if part)}."


def _longest(episodes: Sequence[Slowdown | Shortfall]) -> str:
    """Return how many times something happened, and when and why it did longest."""
    longest = max(episodes, key=lambda each: each.end - each.start)
    when = f"from {short(longest.start)} to {short(longest.end)} s"
    count = "once," if len(episodes) == 1 else f"{len(episodes)} times, longest"
    return f"{count} {when} by {longest.cause}"


def _error(run: Recording, numbers: Numbers) -> str:
    """Return the error in the last 10 %: absolute, relative, and against no adaptation."""
    error = numbers["max_error_last"]
    shown = run.task.groups[0].shown
    if error is None:
        return "nothing was measured"
    size = _size(error, shown)
    text = f"error of the last 10 % {f'below{size[1:]}' if size[0] == '<' else f'up to {size}'}"
    if (share := numbers["error_share"]) is not None:
        text += f", {percent(share)} of the path's {_size(run.extent, shown)}"
    if (tool := numbers.get("max_tool_error_last")) is not None:
        text += f", {_size(tool, DISPLAYS['m'])} at the tool"
    if (angle := numbers.get("max_angle_last")) is not None:
        text += f", and {_size(angle, DISPLAYS['rad'])}"
    if run.unadapted and error:
        share = error / run.unadapted
        ratio = (
            f"{short(1.0 / share, 2)} times less than" if share < BETTER else f"{percent(share)} of"
        )
        text += f", {ratio} the {_size(run.unadapted, shown)} without adaptation"
    return text


def ringing_words(ringing: Ringing, controller: Controller) -> str:
    """Return that a torque rings under a controller, and what to do about it.

    A loop with damping at the rate 1 / lag and motors that are late by T rings at the frequency
    1 / (4 T) at its limit of stability; the lag is to be 2 T, and longer than it was. Where T is
    less than a sampling period, the motors are not the cause.
    """
    late = 0.25 / ringing.frequency
    lag = getattr(controller.law, "lag", None)
    slower = "lower the gains"
    if lag is not None:
        slower = f"take a longer lag, for example lag = {2.0 * max(late, lag):.2g}"
    cause = "declare the motors' delay or the joints' stiffness (limits.actuators)"
    if late < controller.period < np.inf:
        cause = "the feedback is too fast for dt, or the arm near a singularity: keep away from it"
    return (
        f"the torque of {ringing.joint} rings at {ringing.frequency:.0f} Hz, {ringing.share:.0%} "
        f"of its rms: {cause}, or {slower}"
    )
