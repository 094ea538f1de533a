"""The rows of a sweep: a table of columns, and the files that hold it while it grows.

A finished case is one line of ``journal.jsonl``, appended by one write, so that neither a killed
process nor a full disk costs more than the last line. Ten thousand lines become a file of their own
in ``parts``, written beside and moved into place; at the end all of them become one file,
``table.parquet``, or ``table.csv`` without pyarrow. Whatever is there is read, each case once.
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
from types import TracebackType
from typing import IO, Any

import numpy as np

from .._output import columns, read_as_data, whole_file
from ..exceptions import InputError, did_you_mean

JOURNAL, PARTS, TABLE = "journal.jsonl", "parts", "table"
FIRST, LAST = ("case", "seed"), ("seconds",)
DONE, DIVERGED, REFUSED, FAILED, CRASHED, TIMEOUT = (
    "done",
    "diverged",
    "refused",
    "failed",
    "crashed",
    "timeout",
)
AGAIN = (CRASHED, FAILED, TIMEOUT)  # may end otherwise when they run again
_ROWS = 10_000  # of a part
_OBJECTS = ("string", "bool", "null")  # types of a Parquet file that are no numbers
_SHOWN = 20  # of a printed table


def plain(value: Any) -> Any:
    """Return a value as JSON has it; numbers that are not finite stay floats."""
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, bool | int | float | str) or value is None:
        return value
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return str(value)


def flat_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with a column for each number of a list and each entry of a table."""
    found: dict[str, Any] = {}
    for key, value in row.items():
        value = plain(value)
        if isinstance(value, dict):
            found |= flat_row({f"{key}.{name}": each for name, each in value.items()})
        elif isinstance(value, list) and value and all(_is_number(each) for each in value):
            found |= {f"{key}[{i}]": each for i, each in enumerate(value)}
        elif isinstance(value, list):
            found[key] = json.dumps(value)
        else:
            found[key] = value
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
        return cls.joined([_columns_of([flat_row(row) for row in rows])])

    @classmethod
    def joined(cls, parts: Sequence[Mapping[str, np.ndarray]]) -> CaseTable:
        """Return one table of several tables' columns."""
        parts = [part for part in parts if part and len(part["case"])]
        if not parts:
            return cls({"case": np.zeros(0, np.int64)})
        number = np.concatenate([part["case"] for part in parts])
        _, chosen = np.unique(number, return_index=True)
        names = dict.fromkeys(name for part in parts for name in part)
        found = {name: _column(parts, name)[chosen] for name in names}
        # the order of the columns depends on the rows alone, not on which of them came first
        first = {name: (name in LAST, _first_value(column)) for name, column in found.items()}
        return cls({name: found[name] for name in sorted(found, key=lambda name: first[name])})

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
        names = list(self.columns)
        for values in zip(*(self.columns[name].tolist() for name in names), strict=True):
            yield {
                name: None if isinstance(value, float) and math.isnan(value) else value
                for name, value in zip(names, values, strict=True)
            }

    @property
    def lost(self) -> np.ndarray:
        """Whether a case has no result (N): it diverged, was refused, failed, crashed or hung."""
        return np.asarray(self["status"] != DONE)

    def same_as(self, other: CaseTable) -> bool:
        """Return whether two tables are equal to the bit, but for the time that cases took."""
        names = [name for name in self.columns if name not in LAST]
        if names != [name for name in other.columns if name not in LAST]:
            return False
        return all(_same(self.columns[name], other.columns[name]) for name in names)

    @classmethod
    def load(cls, path: Path) -> CaseTable:
        """Return the table of one file, ``.parquet`` or ``.csv``.

        Raises:
            InputError: the file is damaged, or it is Parquet and pyarrow is not installed.
        """
        with read_as_data(path, InputError):
            return cls.joined([_read_file(path)])

    def save(self, path: Path) -> None:
        """Write one file, ``.parquet`` or ``.csv``, completely or not at all."""
        with whole_file(path) as file:
            if path.suffix == ".parquet":
                _write_parquet(self.columns, file)
            else:
                _write_csv(self, file)

    def __str__(self) -> str:
        """Return the first rows as text, numbers with four digits."""
        shown = [list(map(_cell, row.values())) for row in islice(self.rows(), _SHOWN)]
        more = len(self) - len(shown)
        text = columns(list(self.columns), shown) if shown else "no case has run"
        return f"{text}\n... and {more} more" if more else text


def _cell(value: Any) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    if a.dtype != b.dtype or a.shape != b.shape:
        return False
    return a.tobytes() == b.tobytes() if a.dtype != object else bool(a.tolist() == b.tolist())


def _columns_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Return the columns of flat rows."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: _array(name, [row.get(name) for row in rows]) for name in names}


def _array(name: str, values: Sequence[Any]) -> np.ndarray:
    """Return a column: whole numbers for case and seed, floats for numbers, else objects."""
    if name in FIRST:
        return np.array(values, dtype=np.int64)
    if any(_is_number(each) for each in values) and all(
        each is None or _is_number(each) for each in values
    ):
        return np.array([np.nan if each is None else each for each in values], dtype=float)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _column(parts: Sequence[Mapping[str, np.ndarray]], name: str) -> np.ndarray:
    """Return a column of all parts; where a part has none, or no value at all, there is None."""
    found = []
    kinds = {part[name].dtype for part in parts if name in part and not _empty(part[name])}
    (kind,) = kinds if len(kinds) == 1 else (np.dtype(object),)
    for part in parts:
        size = len(part["case"])
        if name in part and not (_empty(part[name]) and kind.kind == "f"):
            found.append(part[name].astype(kind, copy=False))
        else:
            found.append(np.full(size, np.nan if kind.kind == "f" else None, dtype=kind))
    return np.concatenate(found)


def _first_value(column: np.ndarray) -> int:
    """Return the index of the first value of a column, its length if there is none."""
    there = (
        np.array([each is not None for each in column])
        if column.dtype == object
        else (~np.isnan(column) if column.dtype == float else np.ones(len(column), bool))
    )
    return int(np.argmax(there)) if there.any() else len(column)


def _empty(column: np.ndarray) -> bool:
    """Return whether a column has no value at all."""
    return column.dtype == object and all(each is None for each in column)


def has_parquet() -> bool:
    """Return whether pyarrow is installed."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        return False
    return True


def _write_parquet(table: Mapping[str, np.ndarray], file: IO[bytes]) -> None:
    import pyarrow
    from pyarrow import parquet

    made = {
        name: pyarrow.array(
            [None if each is None else str(each) for each in column]
            if column.dtype == object and not _truths(column)
            else column,
            from_pandas=True,
        )
        for name, column in table.items()
    }
    parquet.write_table(pyarrow.table(made), file)


def _truths(column: np.ndarray) -> bool:
    return all(each is None or isinstance(each, bool) for each in column)


def _read_parquet(path: Path) -> dict[str, np.ndarray]:
    from pyarrow import parquet

    read = parquet.read_table(path)
    return {
        name: _array(name, column.to_pylist())
        if str(column.type) in _OBJECTS
        else column.to_numpy().astype(np.int64 if name in FIRST else float)
        for name, column in zip(read.column_names, read.columns, strict=True)
    }


def _write_csv(table: CaseTable, file: IO[bytes]) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", errors="replace", newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    for row in table.rows():
        writer.writerow(["" if each is None else each for each in row.values()])
    text.flush()
    text.detach()


_WORDS = {"": None, "True": True, "False": False}


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        names = next(reader, [])
        cells = list(zip(*reader, strict=False)) or [()] * len(names)
    return {name: _read_column(name, list(each)) for name, each in zip(names, cells, strict=True)}


def _read_column(name: str, cells: list[str]) -> np.ndarray:
    if name in FIRST:
        return np.array([int(each) for each in cells], dtype=np.int64)
    with suppress(ValueError):
        if any(cells):
            return np.array([float(each) if each else np.nan for each in cells])
    return _array(name, [_WORDS.get(each, each) for each in cells])


def read(folder: Path) -> CaseTable:
    """Return the table of a folder: what was joined, parts and journal.

    Raises:
        InputError: a file is damaged, or it is Parquet and pyarrow is not installed.
    """
    with read_as_data(folder, InputError):
        parts = [_read_file(path) for path in _files(folder)]
        rows = [flat_row(row) for row in _journal(folder)]
        return CaseTable.joined([*parts, _columns_of(rows)] if rows else parts)


def _files(folder: Path) -> list[Path]:
    """Return the files of a folder that hold rows, but for the journal, in order."""
    whole = [folder / f"{TABLE}{suffix}" for suffix in (".parquet", ".csv")]
    parts = sorted(path for path in (folder / PARTS).glob("part-*") if not path.is_dir())
    return [path for path in whole if path.is_file()] + parts


def _read_file(path: Path) -> dict[str, np.ndarray]:
    if path.suffix != ".parquet":
        return _read_csv(path)
    if not has_parquet():
        raise InputError(
            "pyarrow, which reads it, is not installed.",
            where=str(path),
            hint="Install it: pip install 'pinadapt[sweep]'.",
        )
    return _read_parquet(path)


def _journal(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the whole lines of a journal."""
    with suppress(FileNotFoundError), (folder / JOURNAL).open("rb") as file:
        for line in file:
            if not line.endswith(b"\n"):
                return
            with suppress(ValueError, RecursionError):
                row = json.loads(line)
                if isinstance(row, dict):
                    yield row


class Store:
    """The files of a sweep that runs, open for one process at a time.

    Attributes:
        folder: that holds them.
        kind: of the files of rows, "parquet" or "csv".
    """

    def __init__(self, folder: Path, *, as_csv: bool = False) -> None:
        """Open the journal of a folder, which exists.

        Raises:
            InputError: another process writes to it.
        """
        self.folder = folder
        self.kind = "csv" if as_csv or not has_parquet() else "parquet"
        self._file = (folder / JOURNAL).open("ab", buffering=0)
        try:
            import fcntl

            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:  # no such locks on this system
            pass
        except OSError as error:
            self._file.close()
            raise InputError("another process runs this sweep now.", where=str(folder)) from error
        self._cut()
        self._waiting = list(_journal(folder))

    def _cut(self) -> None:
        """Remove the end of a line that was not written whole."""
        path = self.folder / JOURNAL
        text = path.read_bytes()
        if text and not text.endswith(b"\n"):
            self._file.truncate(text.rfind(b"\n") + 1)

    def done(self) -> set[int]:
        """Return the numbers of the cases that have a row."""
        found = {row["case"] for row in self._waiting}
        for path in _files(self.folder):
            found.update(_read_file(path)["case"].tolist())
        return found

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a row.

        Raises:
            OSError: it could not be written; all rows before it are kept.
        """
        found = flat_row(row)
        line = json.dumps(found).encode() + b"\n"
        if self._file.write(line) != len(line):
            raise OSError(f"{self.folder / JOURNAL}: the disk is full.")
        self._waiting.append(found)
        if len(self._waiting) >= _ROWS:
            self._part()

    def _part(self) -> None:
        """Write the rows of the journal as a part, and begin the journal anew."""
        if not self._waiting:
            return
        folder = self.folder / PARTS
        taken = [int(path.stem.partition("-")[2]) for path in folder.glob("part-*")]
        name = f"part-{max(taken, default=-1) + 1:05d}.{self.kind}"
        CaseTable.of(self._waiting).save(folder / name)
        self._file.truncate(0)
        self._waiting = []

    def join(self, without: Sequence[str] = ()) -> CaseTable:
        """Write one file of all rows in place of the others and return the table.

        Args:
            without: rows of these statuses are left out.
        """
        table = read(self.folder)
        if without and len(table):
            keep = ~np.isin(table["status"].astype(str), without)
            table = CaseTable({name: column[keep] for name, column in table.columns.items()})
        path = self.folder / f"{TABLE}.{self.kind}"
        table.save(path)
        for other in _files(self.folder):
            if other != path:
                other.unlink()
        with suppress(OSError):
            (self.folder / PARTS).rmdir()
        self._file.truncate(0)
        self._waiting = []
        return table

    def close(self) -> None:
        """Close the journal; an empty one is removed."""
        path = self.folder / JOURNAL
        with suppress(OSError):
            if path.stat().st_size == 0:
                path.unlink()
        self._file.close()

    def __enter__(self) -> Store:
        """Return the store itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the journal."""
        self.close()


def remove(folder: Path) -> None:
    """Remove all rows of a folder."""
    for path in [*_files(folder), folder / JOURNAL]:
        path.unlink(missing_ok=True)
