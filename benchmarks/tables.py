"""The tables of the documentation: measured by sweeps, written into the pages by this script.

``python -m benchmarks.tables [--check]`` writes every table of the pages anew, between the lines
``<!-- table: NAME -->`` and ``<!-- end of table -->``; with ``--check`` it only says which pages
are not as their tables.

``python -m benchmarks.tables NAME... [--again [KEY=VALUE ...]]`` first runs the sweeps
``NAME.toml`` and writes their rows into ``NAME.csv``. Cases that have a row there are not run,
unless ``--again`` is given: all, or those with some values. What was interrupted goes on without
``--again``. ``make NAME.table`` measures a whole table again.
"""

from __future__ import annotations

import argparse
import math
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from pinadapt.exceptions import InputError, did_you_mean
from pinadapt.scenario.tables import setting
from pinadapt.sweep.cases import Plan
from pinadapt.sweep.execution import run_plan
from pinadapt.sweep.table import AGAIN, FIRST, LAST, CaseTable, flat_row, read

from . import (
    alternatives,
    alternatives_report,
    calibration,
    estimators,
    identification,
    image,
    lying_sensors,
    real_calibration,
    real_logs,
    realities,
    scenarios,
    standing,
    strangers,
    tracker,
    unknowns,
    whole_robots,
)
from .timing import HERE, table_rows

ROOT = HERE.parent
RUNNING = ROOT / "out" / "tables"  # rows of tables that are being measured
SWEPT = sorted(path.stem for path in HERE.glob("*.csv"))
_MARKED = re.compile(r"(<!-- table: (\S+) -->\n\n)(.*?)(\n*<!-- end of table -->)", re.S)


# --- tables of what commands of the library write ---


def zoo(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return the results of the zoo as a table in Markdown, by task."""
    lines = [
        "| task | chains | converged | not adapted, median | error, median | largest "
        "| of the orientation | largest |",
        "|---|---|---|---|---|---|---|---|",
    ]
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(row["task"], []).append(row)
    for task, own in groups.items():
        ran = [row for row in own if row["adapted"] is not None]
        before, shares = (
            [
                (100.0 * row[key] / row["radius"], row["robot"])
                for row in ran
                if row[key] is not None
            ]
            for key in ("unadapted", "adapted")
        )
        angles = [
            (math.degrees(row["adapted_angle"]), row["robot"])
            for row in ran
            if row["adapted_angle"] is not None
        ]
        cells = [
            task,
            str(len(own)),
            str(sum(row["verdict"] == "converged" for row in own)),
            _middle_and_worst(before, " %")[0],
            *_middle_and_worst(shares, " %"),
            *_middle_and_worst(angles, "°"),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _middle_and_worst(found: Sequence[tuple[float, str]], unit: str) -> tuple[str, str]:
    """Return the median, and the largest value with its robot."""
    if not found:
        return "", ""
    largest, robot = max(found)
    return f"{median(value for value, _ in found):.2g}{unit}", f"{largest:.2g}{unit} (`{robot}`)"


# --- the pages ---


def of(name: str, report: Callable[[list[dict[str, Any]]], str], **which: str) -> Callable[[], str]:
    """Return a function that returns the report of the rows of a table, or of some of them."""
    return lambda: report(
        [row for row in table_rows(name) if all(row[key] == which[key] for key in which)]
    )


TABLES: dict[str, Callable[[], str]] = {
    "alternatives": of(
        "alternatives", lambda rows: alternatives_report.report(list(alternatives.runs_of(rows)))
    ),
    "calibration": of("calibration", calibration.report),
    "estimators": of("estimators", estimators.report),
    "identification": of("identification", identification.report),
    "image": of("image", image.report),
    "lying_sensors": of("lying_sensors", lying_sensors.report, law="separation"),
    "readme": of("readme", strangers.report),
    "real_calibration": of("real_calibration", real_calibration.report),
    "real_logs": of("real_logs", real_logs.report),
    "realities_contenders": of("realities", realities.contenders),
    "standing": of("standing", standing.report),
    "standing_rough": of("standing", standing.rough),
    "strangers": lambda: strangers.counts(
        [row for row in table_rows("strangers") if "natural" not in row["run"]]
    ),
    "tracker": of("tracker", tracker.report),
    "unknowns": of("unknowns", unknowns.report),
    "whole_robots": of("whole_robots", whole_robots.report),
    "zoo": lambda: zoo([row for row in table_rows("zoo") if not row["adaptation"]]),
    **{name: of("scenarios", make, table=name) for name, make in scenarios.TABLES.items()},
}


def written(text: str) -> str:
    """Return the text of a page with its tables as they were measured.

    Raises:
        InputError: it names a table that does not exist.
    """

    def table(found: re.Match[str]) -> str:
        name = found[2]
        if name not in TABLES:
            raise InputError(
                f"there is no table '{name}'.{did_you_mean(name, TABLES)}", where="<!--"
            )
        return f"{found[1]}{TABLES[name]()}\n\n<!-- end of table -->"

    return _MARKED.sub(table, text)


def pages() -> list[Path]:
    """Return the pages that have tables."""
    found = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("robots/*/README.md")]
    return [path for path in sorted(found) if _MARKED.search(path.read_text())]


# --- the sweeps ---


def measure(name: str, again: Sequence[str] | None, processes: int | None) -> None:
    """Run the cases of a table that have no row, and write it.

    Args:
        name: of the sweep file and of the table.
        again: "key=value" of cases that run again; empty: all; None: none.
        processes: number of them; None: one a core.

    Raises:
        InputError: there is no such sweep, or a case failed.
    """
    path = HERE / f"{name}.toml"
    if not path.is_file():
        guess = did_you_mean(name, SWEPT)
        raise InputError(f"there is no {path.name}.{guess}", where=name)
    plan, folder, table = Plan.read(path), RUNNING / name, HERE / f"{name}.csv"
    if again is not None or not plan.is_in(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        rows = [] if not table.is_file() else table_rows(name)
        CaseTable(kept(plan, rows, again)).save(folder / "table.csv")
        plan.save(folder)
    found = run_plan(plan, processes, folder, retry=True)
    bad = [row for row in found.rows() if row["status"] in AGAIN]
    if bad:
        words = "\n".join(f"case {row['case']}: {row['reason']}" for row in bad)
        raise InputError(f"failed; the other rows are in {folder}.\n{words}", where=name)
    rows = [{key: row[key] for key in row if key not in LAST} for row in read(folder).rows()]
    CaseTable(rows).save(table)
    shutil.rmtree(folder)


def kept(
    plan: Plan, rows: Iterable[Mapping[str, Any]], again: Sequence[str] | None
) -> list[dict[str, Any]]:
    """Return the rows of cases that do not run, with their numbers and seeds in this sweep."""
    wanted = {} if again is None else dict(setting(text, "--again") for text in again)
    keys = list(dict.fromkeys(key for case in plan.cases for key in case.values))
    for key in wanted:
        if key not in keys:
            guess = did_you_mean(key, keys)
            raise InputError(f"'{key}' is not varied.{guess}", where="--again")
    by_values = {_values(row, keys): row for row in rows}
    found = []
    for case in plan.cases:
        flat = flat_row(case.values)
        row = by_values.get(_values(flat, keys))
        stale = again is not None and all(str(flat[key]) == str(wanted[key]) for key in wanted)
        if row is not None and not stale:
            found.append({**row, **dict(zip(FIRST, (case.number, case.seed), strict=True))})
    return found


def _values(row: Mapping[str, Any], keys: Sequence[str]) -> tuple[Any, ...]:
    return tuple("" if row.get(key) is None else row[key] for key in keys)


def main() -> int:
    """Measure what is asked for, and write the pages."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SWEPT))
    parser.add_argument("--again", nargs="*", metavar="KEY=VALUE", help="also what has a row")
    parser.add_argument("--processes", type=int, metavar="N", help="default: one per core")
    parser.add_argument("--check", action="store_true", help="write no page")
    options = parser.parse_args()
    try:
        for name in options.names:
            measure(name, options.again, options.processes)
        changed = [path for path in pages() if written(path.read_text()) != path.read_text()]
    except InputError as error:
        print(f"benchmarks.tables: {error}", file=sys.stderr)
        return 2
    for path in changed:
        print(f"{path.relative_to(ROOT)} {'is not as its tables' * options.check}")
        if not options.check:
            path.write_text(written(path.read_text()))
    return int(options.check and bool(changed))


if __name__ == "__main__":
    sys.exit(main())
