"""Text files with a header: one row a sample, one column a number."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..exceptions import LogError
from .columns import Wanted, log_of_columns
from .log import Log

SUFFIXES = (".csv", ".txt", ".dat", ".tsv")
_MISSING = {"", "nan", "null", "none", "na"}


def accepts(path: Path) -> bool:
    """Tell whether a path looks like such a file."""
    return path.is_file() and path.suffix.lower() in SUFFIXES


def read(path: Path, wanted: Wanted) -> Log:
    """Return the log in a CSV file; empty cells are not measured.

    Commas, semicolons, tabs or spaces stand between cells. Lines that begin with ``#`` are
    comments, but for the last one before the numbers where there is no other header.

    Raises:
        LogError: no header, rows of other lengths, or cells that are no numbers.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise LogError(f"is no text: {error.reason}.", where=str(path)) from error
    header, rows = _split([line for line in lines if line.strip()], str(path))
    values = np.array(
        [_numbers(cells, header, line, str(path)) for line, cells in rows], dtype=float
    ).reshape(len(rows), len(header))
    return log_of_columns(dict(zip(header, values.T, strict=True)), wanted, str(path))


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
        "has no header: its first row are numbers.",
        where=where,
        hint="Begin with a line of column names such as t,q0,q1,v0,v1,tau0,tau1.",
    )


def _cells(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    return next(csv.reader([line], delimiter=mark, skipinitialspace=True))


def _is_row(cells: Sequence[str]) -> bool:
    """Tell whether cells are numbers, or missing ones."""
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
            f"'{cells[bad]}' in column '{header[bad]}' is no number.",
            where=f"{where}, line {line}",
            hint="Decimals need a point; empty cells are taken for not measured.",
        ) from None


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True
