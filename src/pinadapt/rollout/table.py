"""Plain text tables."""

from __future__ import annotations

from collections.abc import Sequence


def two_columns(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Return a title with one line a row, the second column aligned."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(
        [title, "-" * len(title), *(f"{name:<{width}}  {value}" for name, value in rows)]
    )


def columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table with the first and last column flush left, for words, and the others flush right."""
    table = [list(header), *[list(row) for row in rows]]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    ends = (0, len(header) - 1)
    lines = [
        "  ".join(
            cell.ljust(w) if i in ends else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    ]
    return "\n".join([lines[0], "-" * max(len(line) for line in lines), *lines[1:]])


def number(value: float | None, unit: str = "", *, scale: float = 1.0, digits: int = 3) -> str:
    """Return a scaled number with its unit, or a dash for none."""
    return "-" if value is None else f"{value * scale:.{digits}f} {unit}".rstrip()
