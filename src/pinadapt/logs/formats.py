"""``read_log``, and the formats of log files: tables, rollouts, and bags of ROS and MCAP.

A new format is a function of a path, names of joints and ``ImportOptions``, and an entry in
``FORMATS``.
"""

from __future__ import annotations

import csv
import math
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import TypeAlias

import numpy as np

from .._checks import instance
from .._output import read_as_data
from ..exceptions import LogError
from ..information.information import measured_frames
from ..robot.robot import Robot
from ..rollout.rollout import Rollout
from .bags import read_bag
from .columns import log_of_columns
from .import_options import ImportOptions, Options
from .log import Log, check, check_times, repeated


def read_arrays(path: Path, joints: Sequence[str], options: ImportOptions) -> Log:
    """Return the log in an archive: t (N), q, tau (N, n), also v, x, x_time, joint_names.

    Raises:
        LogError: it cannot be read, or lacks a signal.
    """
    if path.name == "rollout.npz" and path.with_name("summary.json").is_file():
        return replace(log_of_rollout(Rollout.load(path.parent)), source=str(path))
    with np.load(path, allow_pickle=False) as archive:
        return log_of_columns(dict(archive), joints, options, str(path))


def log_of_rollout(rollout: Rollout) -> Log:
    """Return the log of a rollout: its measurements, or the true motion if these are not kept.

    It begins at the last change of the robot; the torques are the controller's, held from each
    sample to the next. An x that follows from q is left out.
    """
    since = max((at for at, what in rollout.marks if what != "announced"), default=-math.inf)
    evaluation = rollout.evaluation
    framed = rollout.task.positions > 0
    log = Log(rollout.t, rollout.q, rollout.tau, rollout.v, held=True, source="rollout")
    if evaluation is None or not evaluation.samples:
        return replace(log, x=rollout.x if framed else None).after(since)
    measured = [sample.measurement for sample in evaluation.samples]
    t, q, v = (np.array([getattr(part, name) for part in measured]) for name in "tqv")
    log = replace(log, t=t, q=q, v=v)
    times, x = measured_frames(measured)
    if framed and len(times):
        log = replace(log, x=x, x_time=times)
    return log.after(since)


def read_text(path: Path, joints: Sequence[str], options: ImportOptions) -> Log:
    """Return the log in a text file, a row per sample; an empty cell was not measured.

    Cells are separated by commas, semicolons, tabs or spaces. Lines that begin with ``#`` are
    comments; without another header the last one before the numbers is the header. Without any,
    columns are called 1, 2 and so on.

    Raises:
        LogError: rows of other lengths, or no numbers.
    """
    lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    rows = [line for line in lines if not line.startswith("#")] or [""]
    mark = next((mark for mark in ",;\t" if mark in rows[0]), None)
    header = _cells(rows[0], mark)
    above = takewhile(lambda line: line.startswith("#"), lines)
    comments = [_cells(line.lstrip("# "), mark) for line in above]
    if all(map(_is_number, header)):
        header = [str(k + 1) for k in range(len(header))]
        if comments and len(comments[-1]) == len(header):
            header = comments[-1]
    else:
        del rows[0]
    if not any(rows):
        raise LogError("is empty.", where=path)
    if twice := [name for name, count in Counter(header).items() if count > 1]:
        raise LogError(f"there are several columns '{twice[0]}'.", where=path)
    bare = (row.replace('"', "") for row in rows)
    columns = np.genfromtxt(bare, delimiter=mark).reshape(len(rows), -1).T
    if len(columns) != len(header):
        raise LogError(
            f"{len(columns)} cells in a row, and the header has {len(header)}.", where=path
        )
    return log_of_columns(dict(zip(header, columns, strict=True)), joints, options, str(path))


def _cells(line: str, mark: str | None) -> list[str]:
    """Return the cells of a line; without a mark they are separated by spaces."""
    cells = line.split() if mark is None else next(csv.reader([line], delimiter=mark))
    return [cell.strip() for cell in cells]


def _is_number(cell: str) -> bool:
    """Return whether a cell is a number, or empty."""
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True


# Ending of a file's name -> its reader.
FORMATS: Mapping[str, Callable[[Path, Sequence[str], ImportOptions], Log]] = {
    ".npz": read_arrays,
    **dict.fromkeys((".csv", ".txt", ".dat", ".tsv"), read_text),
    **dict.fromkeys((".bag", ".mcap", ".db3"), read_bag),
}


Source: TypeAlias = Path | str | Log | Rollout  # of a log


def read_log(
    source: Source,
    robot: Robot,
    *,
    import_options: Options | None = None,
    torques: bool = True,
) -> Log:
    """Return a recorded motion of a robot, checked, its columns in the order of the joints.

    Units are rad, m, N m, N and s.

    Args:
        source: a folder or ``rollout.npz`` that `pinadapt run` has written; an npz or CSV file with
            t, q, tau and optionally v and x, by the joints' names or indices; a bag of ROS 1 or 2
            or MCAP (extra ``bags``); or a ``Log`` or ``Rollout``, see ``log_of_rollout``.
        robot: whose motion it is.
        import_options: how it is to be read: ``ImportOptions``, their fields, or a TOML file of
            them; by default the one beside the log, ``run.import_options.toml`` of ``run.csv``, if
            there is one.
        torques: whether they are needed. A log for the geometry alone may have none, and as few
            samples as there are frames.

    Raises:
        LogError: no such file, an unknown format, a missing signal or joint, or impossible numbers;
            see ``check``.
        InputError: import options that cannot be used.
    """
    instance(robot, Robot, "robot")
    options = ImportOptions.of(import_options, source)
    if isinstance(source, Rollout):
        source = log_of_rollout(source)
    if not isinstance(source, Log):
        path = Path(instance(source, Path | str, "log"))
        with read_as_data(path, LogError):
            stated = () if isinstance(options.joints, Mapping) else options.joints
            joints = robot.joint_names
            source = _read(path, joints if set(stated) <= set(joints) else stated, options)
    if options.rate is not None:
        t = np.arange(len(source.t)) / options.rate
        frames = source.x_time
        if frames is not None:  # frames with times of their own: on the new clock
            check_times(source)
            frames = np.interp(frames, source.t, t, np.nan, np.nan)
        source = replace(source, t=t, x_time=frames)
    if options.repeated == "drop" and (again := repeated(source)).any():
        warnings.warn(
            f"{source.source}: {np.count_nonzero(again)} of {len(again)} samples repeat earlier "
            "ones and are left out.",
            stacklevel=2,
        )
        source = source.sampled(~again)
    log = options.converted(source, robot)
    check(log, robot, torques=torques)
    return log


def _read(path: Path, joints: Sequence[str], options: ImportOptions) -> Log:
    """Return the log in a file, in the folder of a run, or in that of a bag.

    Raises:
        LogError: there is none, nothing reads it, or as its reader.
    """
    if path.is_dir() and (path / "metadata.yaml").is_file():
        return read_bag(path, joints, options)
    run = path / "rollout.npz"
    file = run if run.is_file() else path
    ending = file.suffix.lower()
    if not file.is_file() or ending not in FORMATS:
        raise LogError(
            "is not a log of a known format." if path.exists() else "no such file or folder.",
            where=path,
            hint=f"Known are {', '.join(FORMATS)}, folders of `pinadapt run`, which have a "
            "rollout.npz, and those of bags, which have a metadata.yaml.",
        )
    return FORMATS[ending](file, joints, options)
