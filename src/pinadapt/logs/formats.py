"""Formats of log files: what a format must do, and those that need no other package.

A new format is a subclass of ``Format`` in a file of its own, as ``Bag``, and a line in
``read.FORMATS``.
"""

from __future__ import annotations

import csv
import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..exceptions import LogError
from .columns import Selection, log_of_columns
from .log import Log


class Format(ABC):
    """A kind of file with recorded motions.

    Attributes:
        suffixes: of such files, for messages.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def accepts(self, path: Path) -> bool:
        """Tell whether a path looks like such a file or folder, without reading all of it."""

    @abstractmethod
    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log at a path.

        Raises:
            LogError: it cannot be read, or lacks a signal.
        """


class RolloutFile(Format):
    """The folder of a run of ``pinadapt run``, or its ``rollout.npz``."""

    _FILE, _SUMMARY = "rollout.npz", "summary.json"
    _ANNOUNCEMENTS = ("announced", "told")  # events that left the robot as it was; now, formerly
    _ARRAYS = frozenset({"t", "q", "v", "tau", "x", "x_d", "saturated"})

    def accepts(self, path: Path) -> bool:
        """Tell whether a path is the folder of a run, or its arrays."""
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
        changes = [event["at"] for event in events if event["what"] not in self._ANNOUNCEMENTS]
        since = max((at for at in changes if at <= log.t[-1]), default=-np.inf)
        return log.after(since)

    def _summary(self, file: Path) -> dict[str, Any]:
        """Return what else is known of a run, nothing where there is no summary."""
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}


class Npz(Format):
    """An archive of numpy: arrays by name, each signal a column per joint."""

    suffixes = (".npz",)

    def accepts(self, path: Path) -> bool:
        """Tell whether a path is a file of that name."""
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
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error


class Csv(Format):
    """A text file with a header: one row per sample, one column a number."""

    suffixes = (".csv", ".txt", ".dat", ".tsv")

    def accepts(self, path: Path) -> bool:
        """Tell whether a path is a file of such a name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a text file; an empty cell was not measured.

        Cells are separated by commas, semicolons, tabs or spaces. Lines that begin with ``#`` are
        comments; without another header the last one before the numbers is the header.

        Raises:
            LogError: no header, rows of other lengths, or cells that are not numbers.
        """
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise LogError(f"is not text: {error.reason}.", where=str(path)) from error
        header, rows = _split([line for line in lines if line.strip()], str(path))
        values = np.array(
            [_numbers(cells, header, line, str(path)) for line, cells in rows], dtype=float
        ).reshape(len(rows), len(header))
        return log_of_columns(dict(zip(header, values.T, strict=True)), selection, str(path))


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
    raise LogError(
        "has no header: its first row holds numbers.",
        where=where,
        hint="Begin with a line of column names such as t,q0,q1,v0,v1,tau0,tau1.",
    )


def _cells(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    return next(csv.reader([line], delimiter=mark, skipinitialspace=True))


def _is_row(cells: Sequence[str]) -> bool:
    """Tell whether cells are numbers, of which some may be missing."""
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
