"""``read_log``, and the formats of log files: tables, rollouts, and bags of ROS and MCAP.

A new format is a function of a path, names of joints and ``ImportOptions``, and an entry in
``FORMATS``.
"""

from __future__ import annotations

import csv
import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import instance
from .._output import read_as_data
from ..exceptions import LogError
from ..robot.robot import Robot
from .bags import read_bag
from .columns import log_of_columns
from .import_options import ImportOptions
from .log import Log, check, repeated

_ROLLOUT = frozenset({"t", "q", "v", "tau", "x", "x_d", "saturated"})  # arrays of a run
_MISSING = {"", "nan", "null", "none", "na"}  # cells of what was not measured


def read_arrays(path: Path, joints: Sequence[str], options: ImportOptions) -> Log:
    """Return the log in an archive: t (N), q, tau (N, n), also v, x, x_time, joint_names.

    That of a run of ``pinadapt run`` begins at the last change of its robot: its torques are the
    controller's, held from each sample to the next, and x is the true position of the task frame.
    A joint task's x is q and is left out.

    Raises:
        LogError: it cannot be read, or lacks a signal.
    """
    with np.load(path, allow_pickle=False) as archive:
        found = {name: archive[name] for name in archive.files}
    if not found.keys() >= _ROLLOUT:
        return log_of_columns(found, joints, options, str(path))
    about: dict[str, Any] = {}
    if (summary := path.with_name("summary.json")).is_file():
        about = json.loads(summary.read_text(encoding="utf-8"))
    names = about.get("joint_names", ()) if found["q"].shape == found["v"].shape else ()
    x = None if about.get("task") == "joint" else found["x"]
    parts: dict[str, Any] = {name: found[name] for name in ("t", "q", "tau", "v")}
    log = Log(**parts, joints=tuple(names), x=x, held=True, source=str(path))
    if not len(log.t):
        raise LogError("the run has no sample.", where=str(path))
    events = about.get("changes", ())
    changes = [event["at"] for event in events if event["what"] != "announced"]
    return log.after(max((at for at in changes if at <= log.t[-1]), default=-math.inf))


def read_text(path: Path, joints: Sequence[str], options: ImportOptions) -> Log:
    """Return the log in a text file, a row per sample; an empty cell was not measured.

    Cells are separated by commas, semicolons, tabs or spaces. Lines that begin with ``#`` are
    comments; without another header the last one before the numbers is the header. Without any,
    columns are called 1, 2 and so on.

    Raises:
        LogError: rows of other lengths, or cells that are not numbers.
    """
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    plain = [(k + 1, line) for k, line in enumerate(lines) if line.strip() and line[0] != "#"]
    if not plain:
        raise LogError("is empty.", where=str(path))
    mark = next((mark for mark in ",;\t" if mark in plain[0][1]), None)
    rows = [(number, _cells(line, mark)) for number, line in plain]
    header = [str(k + 1) for k in range(len(rows[0][1]))]
    comments = [_cells(line.lstrip("# "), mark) for line in lines if line.startswith("#")]
    if any(map(_is_text, rows[0][1])):
        _, header = rows.pop(0)
    elif comments and len(comments[-1]) == len(header):
        header = comments[-1]
    values = []
    for number, cells in rows:
        text = next(filter(_is_text, cells), None)
        if len(cells) != len(header) or text is not None:
            words = f"{len(cells)} cells for {len(header)} columns."
            raise LogError(
                words if text is None else f"'{text}' is not a number.",
                where=f"{path}, line {number}",
                hint="Decimals need a point; an empty cell was not measured.",
            )
        values.append([math.nan if cell.lower() in _MISSING else float(cell) for cell in cells])
    columns = np.array(values).reshape(-1, len(header)).T
    return log_of_columns(dict(zip(header, columns, strict=True)), joints, options, str(path))


def _cells(line: str, mark: str | None) -> list[str]:
    """Return the cells of a line; without a mark they are separated by spaces."""
    cells = line.split() if mark is None else next(csv.reader([line], delimiter=mark))
    return [cell.strip() for cell in cells]


def _is_text(cell: str) -> bool:
    """Return whether a cell is neither a number nor a missing one."""
    try:
        float(cell)
    except ValueError:
        return cell.lower() not in _MISSING
    return False


# Ending of a file's name -> its reader.
FORMATS: Mapping[str, Callable[[Path, Sequence[str], ImportOptions], Log]] = {
    ".npz": read_arrays,
    **dict.fromkeys((".csv", ".txt", ".dat", ".tsv"), read_text),
    **dict.fromkeys((".bag", ".mcap", ".db3"), read_bag),
}


def read_log(
    source: Path | str | Log,
    robot: Robot,
    *,
    intake: ImportOptions | Mapping[str, Any] | Path | str | None = None,
    torques: bool = True,
) -> Log:
    """Return a recorded motion of a robot, checked, its columns in the order of the joints.

    Units are rad, m, N m, N and s.

    Args:
        source: a folder or ``rollout.npz`` that `pinadapt run` has written; an npz or CSV file with
            t, q, tau and optionally v and x, by the joints' names or indices; a bag of ROS 1 or 2
            or MCAP (extra ``bags``); or a ``Log``.
        robot: whose motion it is.
        intake: how it is to be read: ``ImportOptions``, their fields, or a TOML file of them; by
            default the one beside the log, ``run.intake.toml`` of ``run.csv``, if there is one.
        torques: whether they are needed. A log for the geometry alone may have none, and as few
            samples as there are frames.

    Raises:
        LogError: no such file, an unknown format, a missing signal or joint, or impossible numbers;
            see ``check``.
        InputError: import options that cannot be used.
    """
    instance(robot, Robot, "robot")
    options = ImportOptions.of(ImportOptions.beside(source) if intake is None else intake)
    if not isinstance(source, Log):
        path = Path(instance(source, Path | str, "log"))
        with read_as_data(path, LogError):
            source = _reader(path)(_file_of(path), options.read_joints(robot), options)
    elif options.rate is not None:
        source = replace(source, t=np.arange(len(source.t)) / options.rate)
    log = source.from_zero()
    if options.repeated == "drop" and (again := repeated(log)).any():
        warnings.warn(
            f"{log.source}: {np.count_nonzero(again)} of {len(again)} samples repeat earlier ones "
            "and are left out.",
            stacklevel=2,
        )
        log = log.sampled(~again)
    log = options.converted(log, robot)
    check(log, robot, torques=torques)
    return log


def _file_of(path: Path) -> Path:
    """Return the file of a run's folder, or the path itself."""
    file = path / "rollout.npz"
    return file if file.is_file() else path


def _reader(path: Path) -> Callable[[Path, Sequence[str], ImportOptions], Log]:
    """Return what reads a file or folder.

    Raises:
        LogError: there is none, or nothing reads it.
    """
    if path.is_dir() and (path / "metadata.yaml").is_file():
        return read_bag
    file = _file_of(path)
    if not file.is_file() or file.suffix.lower() not in FORMATS:
        raise LogError(
            "is not a log of a known format." if path.exists() else "no such file or folder.",
            where=str(path),
            hint=f"Known are {', '.join(FORMATS)}, folders of `pinadapt run`, which have a "
            "rollout.npz, and those of bags, which have a metadata.yaml.",
        )
    return FORMATS[file.suffix.lower()]
