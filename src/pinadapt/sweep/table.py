"""The rows of a sweep: a table of columns, and the files that hold it while it grows.

A finished case is one line of ``journal.jsonl``, so that a killed process or a full disk costs no
more than the last line. At the end, and when a sweep is resumed, the lines move to ``table.csv``.
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
PRINTED_ROWS = 20  # of a list; half or twice: a shorter or longer text
_WORDS = {"": None, "True": True, "False": False}


def plain(value: Any) -> Any:
    """Return a value as JSON and TOML have it, without what is None in a table."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items() if each is not None}
    if isinstance(value, list | tuple | range):
        return [plain(each) for each in value]
    return value if isinstance(value, bool | int | float | str | None) else str(value)


def flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the entries of nested tables by dotted keys."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        inside = isinstance(value, Mapping)
        found |= flat(value, f"{prefix}{key}.") if inside else {f"{prefix}{key}": value}
    return found


def flat_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with a column for each entry of a table and each number of a list."""
    found: dict[str, Any] = {}
    for key, value in flat(row).items():
        value = plain(value)
        if isinstance(value, list) and value and all(map(_is_number, value)):
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
            return cls({n: _csv_column(n, column) for n, column in zip(names, cells, strict=True)})

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
        shown = [list(map(cell, row.values())) for row in islice(self.rows(), PRINTED_ROWS)]
        more = len(self) - len(shown)
        text = columns(list(self.columns), shown) if shown else "no case has run"
        return f"{text}\n... and {more} more" if more else text


def cell(value: Any) -> str:
    """Return a value of a row as text, numbers with four digits."""
    if value is None or value != value:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


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


def _csv_column(name: str, cells: Sequence[str]) -> np.ndarray:
    """Return a column from the cells of a CSV file."""
    if name in FIRST:
        return np.array([int(each) for each in cells], dtype=np.int64)
    with suppress(ValueError):
        if any(cells):
            return np.array([float(each) if each else math.nan for each in cells])
    return _column(name, [_WORDS.get(each, each) for each in cells])


def read(folder: Path) -> CaseTable:
    """Return the table of a folder: the rows of ``table.csv`` and of the journal.

    Raises:
        InputError: a file is damaged.
    """
    with read_as_data(folder, InputError):
        path = folder / TABLE
        rows = list(CaseTable.load(path).rows()) if path.is_file() else []
        with suppress(FileNotFoundError), (folder / JOURNAL).open("rb") as file:
            # the last line may not be whole
            rows += [json.loads(line) for line in file if line.endswith(b"\n")]
        return CaseTable.of(rows)


def append(folder: Path, row: Mapping[str, Any]) -> None:
    """Append a row to the journal of a folder.

    Raises:
        OSError: it could not be written; all rows before it are kept.
    """
    with (folder / JOURNAL).open("a", encoding="utf-8") as file:
        file.write(json.dumps(flat_row(row)) + "\n")


def join(folder: Path, without: Sequence[str] = ()) -> CaseTable:
    """Move the rows of the journal of a folder to ``table.csv`` and return the table.

    Args:
        folder: of the sweep.
        without: rows of these statuses are left out.
    """
    kept = [row for row in read(folder).rows() if row["status"] not in without]
    table = CaseTable.of(kept)
    table.save(folder / TABLE)
    (folder / JOURNAL).unlink(missing_ok=True)
    return table
