"""Tables as plain text, and as HTML for a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import NamedTuple


class Table(NamedTuple):
    """A table of texts; with a header, columns between the first and the last are right-aligned.

    Attributes:
        rows: the cells of each row.
        header: a title for each column; empty: no header.
    """

    rows: Sequence[Sequence[str]]
    header: Sequence[str] = ()

    def __str__(self) -> str:
        """Return the table as text."""
        if not self.header:
            return _drawn(self.rows, "ll", header=False)
        return columns(self.header, self.rows)

    def html(self) -> str:
        """Return the table as HTML; every cell is escaped."""
        kinds = _sides(self.header or ("", ""))
        head = [_html_row("th", self.header, kinds)] if self.header else []
        rows = [_html_row("td", row, kinds) for row in self.rows]
        return f"<table>{''.join([*head, *rows])}</table>"


class Sheet(NamedTuple):
    """Tables below a common title.

    Attributes:
        title: one line.
        tables: from top to bottom.
        note: a line below the tables; empty: no note.
    """

    title: str
    tables: Sequence[Table]
    note: str = ""

    def __str__(self) -> str:
        """Return the sheet as text."""
        first, *others = map(str, self.tables)
        head = f"{self.title}\n{'-' * len(self.title)}\n{first}"
        return "\n\n".join([head, *others, *filter(None, [self.note])])

    def html(self) -> str:
        """Return the sheet as HTML, without scripts, style sheets or external resources."""
        tables = "".join(table.html() for table in self.tables)
        note = f"<div>{escape(self.note)}</div>" if self.note else ""
        return f"<div><strong>{escape(self.title)}</strong>{tables}{note}</div>"


def columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as text: first and last column left-aligned, the others right-aligned."""
    return _drawn([header, *rows], _sides(header), header=True)


def _sides(header: Sequence[str]) -> str:
    """Return the alignment of each column: l or r."""
    return f"l{'r' * (len(header) - 2)}l"


def _html_row(kind: str, cells: Sequence[str], sides: str) -> str:
    align = {"l": "left", "r": "right"}
    drawn = [
        f'<{kind} style="text-align:{align[side]}">{escape(cell)}</{kind}>'
        for cell, side in zip(cells, sides, strict=True)
    ]
    return f"<tr>{''.join(drawn)}</tr>"


def _drawn(rows: Sequence[Sequence[str]], sides: str, *, header: bool) -> str:
    """Return rows as text without borders; ``sides`` has an l or r for each column."""
    from texttable import Texttable  # here, because `import pinadapt` does not need it

    table = Texttable(max_width=0)
    table.set_deco(Texttable.HEADER).set_chars(["-", "|", "+", "-"])
    table.set_header_align(sides).set_cols_align(sides).set_cols_dtype(["t"] * len(sides))
    lines = table.add_rows(rows, header=header).draw().splitlines()
    return "\n".join(line.rstrip() for line in lines)


def number(value: float | None, unit: str = "", *, scale: float = 1.0, digits: int = 3) -> str:
    """Return ``value * scale`` with its unit, or a dash for None."""
    return "-" if value is None else f"{value * scale:.{digits}f} {unit}".rstrip()


def percent(share: float, digits: int = 2) -> str:
    """Return a share as a percentage with some significant digits, without an exponent."""
    value = 100.0 * share
    return f"{value:.0f} %" if value >= 10.0**digits else f"{float(f'{value:.{digits}g}'):g} %"
