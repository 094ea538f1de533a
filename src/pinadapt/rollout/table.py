"""Plain text tables."""

from __future__ import annotations

from collections.abc import Sequence


def two_columns(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Return a title with one line a row, the second column aligned."""
    return "\n".join([title, "-" * len(title), _drawn(rows, "ll", header=False)])


def columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table: first and last column flush left, for words, the others flush right."""
    return _drawn([header, *rows], f"l{'r' * (len(header) - 2)}l", header=True)


def _drawn(rows: Sequence[Sequence[str]], sides: str, *, header: bool) -> str:
    """Return rows without borders; ``sides`` has an l or r a column."""
    from texttable import Texttable  # here, because the library is imported without it

    table = Texttable(max_width=0)
    table.set_deco(Texttable.HEADER).set_chars(["-", "|", "+", "-"])
    table.set_header_align(sides).set_cols_align(sides).set_cols_dtype(["t"] * len(sides))
    lines = table.add_rows(rows, header=header).draw().splitlines()
    return "\n".join(line.rstrip() for line in lines)


def number(value: float | None, unit: str = "", *, scale: float = 1.0, digits: int = 3) -> str:
    """Return a scaled number with its unit, or a dash for none."""
    return "-" if value is None else f"{value * scale:.{digits}f} {unit}".rstrip()
