"""The rows of a sweep: a table of columns, and the files that hold it while it grows.

A finished case is one line of ``journal.jsonl``, so that a killed process or a full disk costs no
more than the last line. At the end, and when a sweep is resumed, the lines move to ``table.csv``.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .._checks import word
from .._output import Record, Table, read_as_data, write_text
from ..exceptions import InputError
from ..scenario.tables import flat, plain

JOURNAL, TABLE = "journal.jsonl", "table.csv"
FIRST, LAST = ("case", "seed"), ("seconds",)
DONE, DIVERGED, REFUSED = "done", "diverged", "refused"
FAILED, CRASHED, TIMEOUT = "failed", "crashed", "timeout"
AGAIN = (CRASHED, FAILED, TIMEOUT)  # may end otherwise when they run again
PRINTED_ROWS = 20  # of a list; half or twice: a shorter or longer text
Row: TypeAlias = dict[str, Any]  # values of a case by column
_WORDS = {"": None, "True": True, "False": False}


def flat_row(row: Record) -> Row:
    """Return a row as a CSV file has it, a column for each entry of a table or number of a list."""
    found: Row = {}
    for key, value in flat(row).items():
        value = plain(value)
        if isinstance(value, list) and value and all(map(_is_number, value)):
            found |= {f"{key}[{i}]": each for i, each in enumerate(value)}
        elif isinstance(value, str | list):
            found[key] = _value(value if isinstance(value, str) else json.dumps(value))
        else:
            found[key] = value if value == value else None
    return found


def _value(text: str) -> Any:
    """Return the value of a cell of a CSV file."""
    if text in _WORDS:
        return _WORDS[text]
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


class CaseTable:
    """The table of a sweep, sorted by case; ``table["error_share"]`` is a column.

    Attributes:
        names: of the columns.
    """

    def __init__(self, rows: Iterable[Record]) -> None:
        """Take rows, each with its ``case``; of several of one case the first counts."""
        by_case: dict[int, Row] = {}
        for row in rows:
            by_case.setdefault(row["case"], flat_row(row))
        ordered = [by_case[case] for case in sorted(by_case)]
        # columns in the order of their first value, which does not depend on what ended first
        filled = [name for row in ordered for name in row if row[name] is not None]
        found = dict.fromkeys([*filled, *(name for row in ordered for name in row)])
        self.names = sorted(found or ["case"], key=lambda name: name in LAST)
        self._rows = [{name: row.get(name) for name in self.names} for row in ordered]

    def __len__(self) -> int:
        """Number of cases."""
        return len(self._rows)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column (N).

        Numbers are floats with NaN where a case has none, ``case`` and ``seed`` whole numbers,
        words and truth values objects with None.

        Raises:
            InputError: there is none of this name; the nearest is suggested.
        """
        values = [row[word(name, self.names, "column")] for row in self._rows]
        if name in FIRST:
            return np.array(values, dtype=np.int64)
        there = [value for value in values if value is not None]
        numeric = there and all(map(_is_number, there))
        return np.array(values, dtype=float if numeric else object)  # None becomes NaN

    def rows(self) -> list[Row]:
        """Return the rows; None where a case has no value."""
        return [dict(row) for row in self._rows]

    @property
    def lost(self) -> np.ndarray:
        """Whether a case has no result (N): it diverged, was refused, failed, crashed or hung."""
        return self["status"] != DONE

    def same_as(self, other: CaseTable) -> bool:
        """Return whether two tables are equal to the bit, but for the time that cases took."""
        one, two = (
            repr([row | dict.fromkeys(LAST) for row in table.rows()]) for table in (self, other)
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
            return cls(dict(zip(names, map(_value, row), strict=True)) for row in rows)

    def save(self, path: Path) -> None:
        """Write a CSV file, completely or not at all."""
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, self.names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows)
        write_text(path, text.getvalue())

    def __str__(self) -> str:
        """Return the first rows as text, numbers with four digits."""
        shown = [list(row.values()) for row in self._rows[:PRINTED_ROWS]]
        if len(self) > PRINTED_ROWS:
            shown.append(["..."] * len(self.names))
        return str(Table(shown, self.names))


def read(folder: Path) -> CaseTable:
    """Return the table of a folder: the rows of ``table.csv`` and of the journal.

    Raises:
        InputError: a file is damaged.
    """
    with read_as_data(folder, InputError):
        path = folder / TABLE
        rows = CaseTable.load(path).rows() if path.is_file() else []
        with suppress(FileNotFoundError), (folder / JOURNAL).open("rb") as file:
            # the last line may not be whole
            rows += [json.loads(line) for line in file if line.endswith(b"\n")]
        return CaseTable(rows)


def append(folder: Path, row: Record) -> None:
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
    table = CaseTable(row for row in read(folder).rows() if row["status"] not in without)
    table.save(folder / TABLE)
    (folder / JOURNAL).unlink(missing_ok=True)
    return table
