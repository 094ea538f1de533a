"""``read_log``, and the formats of log files: tables, rollouts, and bags of ROS and MCAP.

A new format is a subclass of ``Format`` and an entry in ``FORMATS``.
"""

from __future__ import annotations

import csv
import json
import sys
import warnings
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .._checks import instance, name_list, word
from .._output import read_as_data
from ..exceptions import LogError
from ..robot.robot import Robot
from .bags import read_bag
from .columns import Selection, log_of_columns
from .intake import Intake
from .log import Log, check, repeated


class Format(ABC):
    """A kind of file with recorded motions.

    Attributes:
        suffixes: of such files, for messages.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def accepts(self, path: Path) -> bool:
        """Return whether a path looks like such a file or folder, without reading all of it."""

    @abstractmethod
    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log at a path.

        Raises:
            LogError: it cannot be read, or lacks a signal.
        """


class RolloutFile(Format):
    """The folder of a run of ``pinadapt run``, or its ``rollout.npz``."""

    _FILE, _SUMMARY = "rollout.npz", "summary.json"
    _ARRAYS = frozenset({"t", "q", "v", "tau", "x", "x_d", "saturated"})

    def accepts(self, path: Path) -> bool:
        """Return whether a path is the folder of a run, or its arrays."""
        if path.is_dir():
            return (path / self._FILE).is_file()
        try:
            with zipfile.ZipFile(path) as archive:
                names = {name.removesuffix(".npy") for name in archive.namelist()}
        except (OSError, zipfile.BadZipFile):
            return False
        return names >= self._ARRAYS

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log of a run, from the last change of its robot on.

        Torques are the controller's, held from each sample to the next; x is the true position of
        the task frame. A joint task's x is q and is left out.

        Raises:
            LogError: it cannot be read, or has no sample.
        """
        file = path / self._FILE if path.is_dir() else path
        found, about = _arrays(file), self._summary(file.with_name(self._SUMMARY))
        if not len(found["t"]):
            raise LogError("the run has no sample.", where=str(file))
        log = Log(
            found["t"],
            found["q"],
            found["tau"],
            found["v"],
            tuple(about.get("joint_names", ())) if found["q"].shape == found["v"].shape else (),
            None if about.get("task") == "joint" else found["x"],
            held=True,
            source=str(path),
        )
        events = about.get("changes", ())
        changes = [event["at"] for event in events if event["what"] != "announced"]
        since = max((at for at in changes if at <= log.t[-1]), default=-np.inf)
        return log.after(since)

    def _summary(self, file: Path) -> dict[str, Any]:
        """Return what else is known of a run, nothing where there is no summary."""
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return content if isinstance(content, dict) else {}


class Npz(Format):
    """An archive of numpy: arrays by name, each signal a column per joint."""

    suffixes = (".npz",)

    def accepts(self, path: Path) -> bool:
        """Return whether a path is a file of that name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in an archive: t (N), q, tau (N, n), also v, x, x_time, joint_names.

        Raises:
            LogError: it cannot be read, or lacks a signal.
        """
        return log_of_columns(_arrays(path), selection, str(path))


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an archive by name.

    Raises:
        LogError: it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = {name: archive[name] for name in archive.files}
        for name, array in found.items():
            if array.dtype.kind == "U":  # numpy does not check the characters
                codes = np.ascontiguousarray(array).reshape(-1).view(f"{array.dtype.byteorder}u4")
                if ((codes > sys.maxunicode) | ((codes >= 0xD800) & (codes < 0xE000))).any():
                    raise ValueError(f"{name} has texts with characters that do not exist")
        return found
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error


class Csv(Format):
    """A text file: one row per sample, one column a number, with or without a header."""

    suffixes = (".csv", ".txt", ".dat", ".tsv")

    def accepts(self, path: Path) -> bool:
        """Return whether a path is a file of such a name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a text file; an empty cell was not measured.

        Cells are separated by commas, semicolons, tabs or spaces. Lines that begin with ``#`` are
        comments; without another header the last one before the numbers is the header. Without any,
        columns are called 1, 2 and so on.

        Raises:
            LogError: rows of other lengths, or cells that are not numbers.
        """
        return log_of_columns(self.table(path), selection, str(path))

    def table(self, path: Path) -> dict[str, np.ndarray]:
        """Return the columns (N) of a text file by name.

        Raises:
            LogError: as ``read``.
        """
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise LogError(f"is not text: {error.reason}.", where=str(path)) from error
        header, rows = _split([line for line in lines if line.strip()], str(path))
        values = np.array(
            [_numbers(cells, header, line, str(path)) for line, cells in rows], dtype=float
        ).reshape(len(rows), len(header))
        return dict(zip(header, values.T, strict=True))


_MISSING = {"", "nan", "null", "none", "na"}  # cells of what was not measured


def _split(lines: Sequence[str], where: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header, and the cells of each row with the number of its line."""
    comments = [line.lstrip("# ") for line in lines if line.startswith("#")]
    plain = [(k + 1, line) for k, line in enumerate(lines) if not line.startswith("#")]
    if not plain:
        raise LogError("is empty.", where=where)
    mark = next((mark for mark in ",;\t" if mark in plain[0][1]), " ")
    cells = [(number, _cells(line, mark)) for number, line in plain]
    if not _is_row(cells[0][1]):
        return [name.strip() for name in cells[0][1]], cells[1:]
    if comments and len(names := _cells(comments[-1], mark)) == len(cells[0][1]):
        return [name.strip() for name in names], cells
    return [str(k + 1) for k in range(len(cells[0][1]))], cells


def _cells(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    return next(csv.reader([line], delimiter=mark, skipinitialspace=True))


def _is_row(cells: Sequence[str]) -> bool:
    """Return whether cells are numbers, of which some may be missing."""
    try:
        return bool(cells) and any(np.isfinite([_number(cell) for cell in cells]))
    except ValueError:
        return False


def _number(cell: str) -> float:
    text = cell.strip()
    return np.nan if text.lower() in _MISSING else float(text)


def _numbers(cells: Sequence[str], header: Sequence[str], line: int, where: str) -> list[float]:
    """Return the numbers of a row."""
    if len(cells) != len(header):
        raise LogError(
            f"{len(cells)} cells, and the header has {len(header)}.", where=f"{where}, line {line}"
        )
    try:
        return [_number(cell) for cell in cells]
    except ValueError:
        bad = next(k for k, cell in enumerate(cells) if not _is_number(cell))
        raise LogError(
            f"'{cells[bad]}' in column '{header[bad]}' is not a number.",
            where=f"{where}, line {line}",
            hint="Decimals need a point; an empty cell was not measured.",
        ) from None


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True


# The first format that accepts a path reads it.
class Bag(Format):
    """A bag of ROS 1 or 2 or an MCAP file with joint states, optionally with a pose topic."""

    suffixes = (".bag", ".mcap", ".db3")

    def accepts(self, path: Path) -> bool:
        """Return whether a path looks like a bag: a file, or a folder of ROS 2."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a bag, see ``read_bag``.

        Raises:
            LogError: it cannot be read, has no such topic, or lacks a joint.
        """
        return read_bag(path, selection)


FORMATS: Mapping[str, Format] = {
    "rollout": RolloutFile(),
    "npz": Npz(),
    "csv": Csv(),
    "bag": Bag(),
}


def read_log(
    source: Path | str | Log,
    robot: Robot,
    *,
    intake: Intake | Mapping[str, Any] | Path | str | None = None,
    torques: bool = True,
) -> Log:
    """Return a recorded motion of a robot, checked, its columns in the order of the joints.

    Units are rad, m, N m, N and s.

    Args:
        source: a folder or ``rollout.npz`` that `pinadapt run` has written; an npz or CSV file with
            t, q, tau and optionally v and x, by the joints' names or indices; a bag of ROS 1 or 2
            or MCAP (extra ``bags``); or a ``Log``.
        robot: whose motion it is.
        intake: how it is to be read, an ``Intake``, its fields, or a TOML file of it; by default
            the one beside the log, ``run.intake.toml`` of ``run.csv``, if there is one.
        torques: whether they are needed. A log for the geometry alone may have none, and as few
            samples as there are frames.

    Raises:
        LogError: no such file, an unknown format, a missing signal or joint, or impossible numbers;
            see ``check``.
    """
    instance(robot, Robot, "robot")
    intake = Intake.of(Intake.beside(source) if intake is None else intake)
    if not isinstance(source, Log):
        path = Path(instance(source, Path | str, "log"))
        source = _read(path, _selection(path, intake, robot, torques=torques))
    elif intake.rate is not None:
        source = replace(source, t=np.arange(len(source.t)) / intake.rate)
    log = source.from_zero()
    if intake.repeated == "drop":
        log = _without_repeated(log)
    log = intake.converted(log, robot)
    check(log, robot, torques=torques)
    return log


def _selection(path: Path, intake: Intake, robot: Robot, *, torques: bool) -> Selection:
    """Return what is to be read from a file, and from others beside it."""
    columns = {key: name_list(names, "columns", LogError) for key, names in intake.columns.items()}
    tables = {}
    for signal, name in intake.files.items():
        word(signal, ("q", "v", "tau"), "intake.files")
        tables[signal] = (_table(path.parent / name), str(path.parent / name))
    foreign = intake.foreign(robot)
    joints = foreign or robot.joint_names
    topics = intake.topics, intake.pose_topic
    return Selection(
        joints, columns, tables, intake.rate, *topics, named=bool(foreign), torques=torques
    )


def _table(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of another file."""
    if not path.is_file():
        raise LogError("there is no such file.", where=str(path))
    with read_as_data(path, LogError):
        if path.suffix.lower() in Npz.suffixes:
            return _arrays(path)
        if path.suffix.lower() in Csv.suffixes:
            return Csv().table(path)
    raise LogError(
        "a signal of its own is read from text files and npz archives only.", where=str(path)
    )


def _without_repeated(log: Log) -> Log:
    """Return a log without samples that repeat earlier ones; a warning says how many they were."""
    kept = ~repeated(log)
    if kept.all():
        return log
    warnings.warn(
        f"{log.source}: {np.count_nonzero(~kept)} of {len(kept)} samples repeat earlier ones and "
        "are left out.",
        stacklevel=2,
    )
    v, own = None if log.v is None else log.v[kept], log.x is not None and log.x_time is None
    x = log.x[kept] if own and log.x is not None else log.x
    return replace(log, t=log.t[kept], q=log.q[kept], tau=log.tau[kept], v=v, x=x)


def _read(path: Path, selection: Selection) -> Log:
    if not path.exists():
        raise LogError("there is no such file or folder.", where=str(path))
    with read_as_data(path, LogError):
        for kind in FORMATS.values():
            if kind.accepts(path):
                return kind.read(path, selection)
    known = ", ".join(suffix for kind in FORMATS.values() for suffix in kind.suffixes)
    raise LogError(
        "is not a log of a known format.",
        where=str(path),
        hint=f"Known are {known}, folders of `pinadapt run`, which have a rollout.npz, and those "
        "of bags, which have a metadata.yaml.",
    )
