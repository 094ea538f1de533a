"""Tables as text and HTML; reading TOML, and writing files completely or not at all."""

from __future__ import annotations

import gc
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from inspect import getdoc
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias

from .exceptions import InputError, PinadaptError, ScenarioError

if sys.version_info >= (3, 11):
    import tomllib as toml
else:
    import tomli as toml

Record: TypeAlias = Mapping[str, Any]  # values by name

UNFINISHED = ".unfinished-"  # prefix of files and folders that are being written


def collect_seldom() -> None:
    """Search seldom for garbage, in a process of our own in which nearly all objects stay.

    As often as by default, the search takes a tenth of a run's time.
    """
    gc.set_threshold(100_000)


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises:
        ScenarioError: there is no such file, or it is not TOML; the message has line and column.
    """
    if not path.is_file():
        raise ScenarioError("no such file.", where=path)
    try:  # some editors write a byte order mark
        return toml.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:  # also no UTF-8, or a number that is too long
        raise ScenarioError(f"not valid TOML: {error}.", where=path) from error


@contextmanager
def read_as_data(path: Path, error: type[InputError]) -> Iterator[None]:
    """Turn whatever the parser of a file raises into an error about the file.

    Parsers of damaged files raise almost anything: KeyError, AssertionError, errors of their own,
    MemoryError where a header claims a thousand billion rows.

    Raises:
        error: the block inside raised an error that is not one of pinadapt's.
    """
    try:
        yield
    except (PinadaptError, Warning):
        raise
    except FileNotFoundError as reason:
        raise error("no such file.", where=reason.filename or path) from reason
    except Exception as reason:
        words = " ".join(f"{type(reason).__name__}: {reason}".split())
        raise error(
            f"cannot be read: {words[:200]}.",
            where=path,
            hint="It is damaged, too large, or of another kind than its name says.",
        ) from reason


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside ``path`` and rename it to ``path`` once it is complete.

    Missing folders are created. If writing fails, the temporary file is removed and an existing
    file at ``path`` stays unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{UNFINISHED}{os.getpid()}-{path.name}")
    try:
        with beside.open("wb") as file:
            yield file
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str | bytes) -> None:
    """Write a file in UTF-8, completely or not at all; lone surrogates become question marks."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8", errors="replace") if isinstance(text, str) else text)


def as_json(content: Any) -> Any:
    """Return what a JSON file holds of some content: lists, and None for what is not finite."""
    return json.loads(json.dumps(content), parse_constant=lambda _: None)


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file, completely or not at all."""
    write_text(path, json.dumps(as_json(content), indent=2) + "\n")


@contextmanager
def one_run(folder: Path, names: Sequence[str], *, partly: bool = True) -> Iterator[Path]:
    """Yield a temporary folder whose files finally replace the files ``names`` of ``folder``.

    All old files are removed before the first new one is moved in, so files of two runs are never
    mixed, even if the process is killed. The last name is removed first and moved last: if it
    exists, all of them do. The old files stay if there is no complete new one, or if writing fails
    and the new ones are not wanted ``partly``. Names may be those of files in folders.
    """
    folder.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=folder))
    try:
        yield beside
        partly = True
    finally:
        whole = [name for name in names if partly and (beside / name).is_file()]
        for name in reversed(names) if whole else ():
            (folder / name).unlink(missing_ok=True)
        for name in whole:
            (folder / name).parent.mkdir(exist_ok=True)
            (beside / name).replace(folder / name)
        shutil.rmtree(beside, ignore_errors=True)


def check_writable(folder: Path, names: Sequence[str] = ()) -> None:
    """Check that files can be written into a folder, which need not exist.

    Raises:
        InputError: they cannot be written, or one of ``names`` is a folder.
    """
    missing = not folder.is_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(4096))  # a full disk takes less
        if missing:
            folder.rmdir()
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror or error}.",
            where=folder,
            hint="Choose another folder by --out.",
        ) from error
    for name in names:
        if (folder / name).is_dir():
            raise InputError(
                "is a folder, but a file of this name has to be written.",
                where=folder / name,
            )


def cell(value: Any) -> str:
    """Return a value as the cell of a table: numbers with four digits, a dash for None."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


_ALIGNED = {"l": "left", "r": "right"}


class Table(NamedTuple):
    """A table; with a header, columns between the first and the last are right-aligned.

    Attributes:
        rows: the values of each row, written as ``cell`` does.
        header: a title for each column; empty: no header.
        title: above the table; empty: none.
    """

    rows: Sequence[Sequence[Any]]
    header: Sequence[str] = ()
    title: str = ""

    @property
    def sides(self) -> str:
        """Alignment of each column: l or r."""
        return f"l{'r' * (len(self.header) - 2)}l" if self.header else "ll"

    def __str__(self) -> str:
        """Return the table as text, without borders."""
        from texttable import Texttable  # here, because `import pinadapt` does not need it

        drawn = Texttable(max_width=0)
        drawn.set_deco(Texttable.HEADER).set_chars(["-", "|", "+", "-"])
        drawn.set_header_align(self.sides).set_cols_align(self.sides)
        drawn.set_cols_dtype([cell] * len(self.sides))
        if self.header:
            drawn.header(self.header)
        lines = (drawn.add_rows(self.rows, header=False).draw() or "").splitlines()
        title = f"{self.title}\n" if self.title else ""
        return title + "\n".join(line.rstrip() for line in lines)

    def html(self) -> str:
        """Return the table as HTML; every cell is escaped."""

        def row(kind: str, values: Sequence[Any]) -> str:
            """Return one row."""
            drawn = (
                f'<{kind} style="text-align:{_ALIGNED[side]}">{escape(cell(value))}</{kind}>'
                for value, side in zip(values, self.sides, strict=True)
            )
            return f"<tr>{''.join(drawn)}</tr>"

        title = f"<h2>{escape(self.title)}</h2>" if self.title else ""
        head = row("th", self.header) if self.header else ""
        return f"{title}<table>{head}{''.join(row('td', values) for values in self.rows)}</table>"


def records_table(
    records: Sequence[Record],
    texts: Sequence[str],
    numbers: Mapping[str, tuple[str, float, int]],
) -> Table:
    """Return a table with a row for each record, its verdict last.

    Numbers that no record has are left out.

    Args:
        records: its rows.
        texts: keys, and titles, of the first columns.
        numbers: title -> key, scale and digits of the columns after them.
    """
    there = {
        title: column
        for title, column in numbers.items()
        if any(record.get(column[0]) is not None for record in records)
    }
    rows = [
        [
            *(record.get(key) for key in texts),
            *(number(record.get(key), scale, digits) for key, scale, digits in there.values()),
            record["verdict"],
        ]
        for record in records
    ]
    return Table(rows, [*texts, *there, "verdict"])


class Report(NamedTuple):
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
        """Return the report as text."""
        text = "\n\n".join(filter(None, [*map(str, self.tables), self.note]))
        return f"{self.title}\n{'-' * len(self.title)}\n{text}"

    def html(self) -> str:
        """Return the report as HTML, without scripts, style sheets or external resources."""
        tables = "".join(table.html() for table in self.tables)
        note = f"<div>{escape(self.note)}</div>" if self.note else ""
        return f"<div><strong>{escape(self.title)}</strong>{tables}{note}</div>"


class Printed:
    """A result that ``print`` and Jupyter show as its tables."""

    def report(self) -> Report:
        """Return the tables."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the tables as text."""
        return str(self.report())

    def _repr_html_(self) -> str:
        return self.report().html()


_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; background: #fff; margin: 2em auto;
  max-width: 1100px; padding: 0 1em; }
h1 { font-size: 1.5em; margin-bottom: 0.2em; overflow-wrap: anywhere; }
h2 { font-size: 1.15em; margin-top: 2em; }
table { border-collapse: collapse; margin: 0.8em 0; font-size: 13px; display: block;
  overflow-x: auto; font-variant-numeric: tabular-nums; }
th, td { padding: 2px 10px; border-bottom: 1px solid #ddd; white-space: nowrap; }
th { border-bottom: 1px solid #777; }
tr:hover td { background: #f4f6f8; } img { max-width: 100%; }
.warning, .note { border-left: 4px solid #e08000; padding: 0.5em 1em; margin: 0.4em 0; }
.warning { background: #fff3e0; } .note { background: #eef3f8; border-color: #4878a8; }
code { background: #f2f2f2; padding: 0.1em 0.3em; }
"""


def html_page(title: str, parts: Sequence[str]) -> str:
    """Return a web page of parts in HTML, without scripts and external resources."""
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width, initial-scale=1"><title>{escape(title)}'
        f"</title><style>{_STYLE}</style></head><body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )


def number(value: float | None, scale: float, digits: int) -> str:
    """Return ``value * scale``, or a dash for None; "< 0.001" if it is less."""
    if value is None:
        return "-"
    least = 0.1**digits
    small = 0.0 < value * scale < least
    return f"{'< ' * small}{least if small else value * scale:.{digits}f}"


def short(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent up to a million."""
    if 0.0 < value < 1e-3:
        return "< 0.001"
    whole = 10.0**digits <= value < 1e6
    return f"{value:.0f}" if whole else f"{float(f'{value:.{digits}g}'):g}"


def percent(share: float, digits: int = 2) -> str:
    """Return a share as a percentage with some significant digits."""
    return f"{short(100.0 * share, digits)} %"


def meanings(make: Callable[..., Any]) -> dict[str, str]:
    """Return the first sentence about each argument in a docstring."""
    text = f"{getdoc(make)}\n{getdoc(getattr(make, '__init__', None)) or ''}"
    found = {}
    for name, words in re.findall(r"^    (\w+): (.+(?:\n {5,}.+)*)", text, re.M):
        sentence = re.split(r"(?<=\w)[.;] ", " ".join(words.split()))[0]
        found[name] = sentence.rstrip(".").replace("``", "") + "."
    return found
