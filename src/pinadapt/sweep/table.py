"""The rows of a sweep: a table of columns, and the files that hold it while it grows.

A finished case is one line of ``journal.jsonl``, appended by one write, so that neither a killed
process nor a full disk costs more than the last line. At the end the lines become ``table.csv``.
Whatever is there is read, each case once.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from .._output import columns, read_as_data, write_text
from ..exceptions import InputError, did_you_mean

JOURNAL, TABLE = "journal.jsonl", "table.csv"
FIRST, LAST = ("case", "seed"), ("seconds",)
DONE, DIVERGED, REFUSED = "done", "diverged", "refused"
FAILED, CRASHED, TIMEOUT = "failed", "crashed", "timeout"
AGAIN = (CRASHED, FAILED, TIMEOUT)  # may end otherwise when they run again
_PRINTED_ROWS = 20  # of a table; half or twice: a shorter or longer text
_WORDS = {"": None, "True": True, "False": False}


def plain(value: Any) -> Any:
    """Return a value as JSON has it; numbers that are not finite stay floats."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain(each) for each in value]
    return value if isinstance(value, bool | int | float | str | None) else str(value)


def flat_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with a column for each number of a list and each entry of a table."""
    found: dict[str, Any] = {}
    for key, value in row.items():
        value = plain(value)
        if isinstance(value, dict):
            found |= flat_row({f"{key}.{name}": each for name, each in value.items()})
        elif isinstance(value, list) and value and all(_is_number(each) for each in value):
            found |= {f"{key}[{i}]": each for i, each in enumerate(value)}
        else:
            found[key] = json.dumps(value) if isinstance(value, list) else value
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclass(frozen=True, eq=False)
class CaseTable:
    """The table of a sweep, sorted by case.

    Numbers are floats with NaN where a case has none, ``case`` and ``seed`` whole numbers, words
    and truth values objects with None.

    Attributes:
        columns: by name (N).
    """

    columns: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]]) -> CaseTable:
        """Return the table of rows; of several of one case the first counts."""
        by_case: dict[int, dict[str, Any]] = {}
        for row in rows:
            by_case.setdefault(row["case"], flat_row(row))
        ordered = [by_case[case] for case in sorted(by_case)]
        # columns in the order of their first value, which does not depend on what ended first
        filled = dict.fromkeys(k for row in ordered for k in row if row[k] is not None)
        names = [*filled, *dict.fromkeys(k for row in ordered for k in row if k not in filled)]
        names = sorted(names or ["case"], key=lambda name: name in LAST)
        return cls({name: _column(name, [row.get(name) for row in ordered]) for name in names})

    def __len__(self) -> int:
        """Number of cases."""
        return len(self.columns["case"])

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column (N).

        Raises:
            InputError: there is none of this name; the nearest is suggested.
        """
        if name not in self.columns:
            raise InputError(
                f"there is no column '{name}' among {', '.join(self.columns)}."
                f"{did_you_mean(name, self.columns)}",
                where="table",
            )
        return self.columns[name]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows as dictionaries; None where a case has no value."""
        for values in zip(*(column.tolist() for column in self.columns.values()), strict=True):
            cells = (None if value != value else value for value in values)
            yield dict(zip(self.columns, cells, strict=True))

    @property
    def lost(self) -> np.ndarray:
        """Whether a case has no result (N): it diverged, was refused, failed, crashed or hung."""
        return np.asarray(self["status"] != DONE)

    def same_as(self, other: CaseTable) -> bool:
        """Return whether two tables are equal to the bit, but for the time that cases took."""
        one, two = (
            [
                (name, column.dtype, column.tolist() if column.dtype == object else bytes(column))
                for name, column in table.columns.items()
                if name not in LAST
            ]
            for table in (self, other)
        )
        return one == two

    @classmethod
    def load(cls, path: Path) -> CaseTable:
        """Return the table of a CSV file. It is data, which runs nothing.

        Raises:
            InputError: the file is damaged.
        """
        with (
            read_as_data(path, InputError),
            path.open(encoding="utf-8", errors="replace", newline="") as file,
        ):
            names, *rows = csv.reader(file)
            cells = list(zip(*rows, strict=True)) or [()] * len(names)
            return cls({n: _of_csv(n, column) for n, column in zip(names, cells, strict=True)})

    def save(self, path: Path) -> None:
        """Write a CSV file, completely or not at all."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(
            ["" if value is None else value for value in row.values()] for row in self.rows()
        )
        write_text(path, text.getvalue())

    def __str__(self) -> str:
        """Return the first rows as text, numbers with four digits."""
        shown = [list(map(_cell, row.values())) for row in islice(self.rows(), _PRINTED_ROWS)]
        more = len(self) - len(shown)
        text = columns(list(self.columns), shown) if shown else "no case has run"
        return f"{text}\n... and {more} more" if more else text


def _cell(value: Any) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _column(name: str, values: Sequence[Any]) -> np.ndarray:
    """Return a column: whole numbers for case and seed, floats for numbers, else objects."""
    if name in FIRST:
        return np.array(values, dtype=np.int64)
    there = [each for each in values if each is not None]
    if there and all(map(_is_number, there)):
        return np.array([math.nan if each is None else each for each in values], dtype=float)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _of_csv(name: str, cells: Sequence[str]) -> np.ndarray:
    """Return a column from the cells of a CSV file."""
    if name in FIRST:
        return np.array([int(each) for each in cells], dtype=np.int64)
    with suppress(ValueError):
        if any(cells):
            return np.array([float(each) if each else math.nan for each in cells])
    return _column(name, [_WORDS.get(each, each) for each in cells])


def read(folder: Path) -> CaseTable:
    """Return the table of a folder: what was joined, and the journal.

    Raises:
        InputError: a file is damaged.
    """
    with read_as_data(folder, InputError):
        path = folder / TABLE
        joined = CaseTable.load(path).rows() if path.is_file() else ()
        return CaseTable.of([*joined, *_journal(folder)])


def _journal(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the whole lines of a journal."""
    with suppress(FileNotFoundError), (folder / JOURNAL).open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                yield json.loads(line)


class Store:
    """The files of a sweep that runs, open for one process at a time.

    Attributes:
        folder: that holds them.
    """

    def __init__(self, folder: Path) -> None:
        """Open the journal of a folder, which exists.

        Raises:
            InputError: another process writes to it.
        """
        self.folder = folder
        self._file = (folder / JOURNAL).open("ab", buffering=0)
        try:
            import fcntl

            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:  # no such locks on this system
            pass
        except OSError as error:
            self._file.close()
            raise InputError("another process runs this sweep now.", where=str(folder)) from error
        text = (folder / JOURNAL).read_bytes()
        self._file.truncate(text.rfind(b"\n") + 1)  # the end of a line that was not written whole

    def done(self) -> set[int]:
        """Return the numbers of the cases that have a row."""
        return set(read(self.folder)["case"].tolist())

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a row.

        Raises:
            OSError: it could not be written; all rows before it are kept.
        """
        line = json.dumps(flat_row(row)).encode() + b"\n"
        if self._file.write(line) != len(line):
            raise OSError(f"{self.folder / JOURNAL}: the disk is full.")

    def join(self, without: Sequence[str] = ()) -> CaseTable:
        """Write one file of all rows in place of the others and return the table.

        Args:
            without: rows of these statuses are left out.
        """
        table = read(self.folder)
        if without:
            table = CaseTable.of([row for row in table.rows() if row["status"] not in without])
        table.save(self.folder / TABLE)
        self._file.truncate(0)
        return table

    def __enter__(self) -> Store:
        """Return the store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the journal; an empty one is removed."""
        if not (self.folder / JOURNAL).stat().st_size:
            (self.folder / JOURNAL).unlink()
        self._file.close()


def remove(folder: Path) -> None:
    """Remove all rows of a folder."""
    for name in (TABLE, JOURNAL):
        (folder / name).unlink(missing_ok=True)
