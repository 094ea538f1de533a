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
from collections.abc import Callable, Iterable, Sequence
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
    third_party_robots,
    tracker,
    unknowns,
    whole_robots,
)
from .shared import HERE, Row, grouped, markdown, table_rows

ROOT = HERE.parent
RUNNING = ROOT / "out" / "tables"  # rows of tables that are being measured
SWEPT = sorted(path.stem for path in HERE.glob("*.csv"))
_MARKED = re.compile(r"(<!-- table: (\S+) -->\n\n)(.*?)(\n*<!-- end of table -->)", re.S)


# --- tables of what commands of the library write ---


def zoo(rows: Iterable[Row]) -> str:
    """Return the results of the zoo as a table in Markdown, by task."""
    lines = []
    for task, own in grouped([row for row in rows if not row["adaptation"]], "task").items():
        converged = sum(row["verdict"] == "converged" for row in own)
        before, _ = _middle_and_worst(own, "unadapted")
        both = [*_middle_and_worst(own, "adapted"), *_middle_and_worst(own, "adapted_angle")]
        lines.append([task, len(own), converged, before, *both])
    head = ["task", "chains", "converged", "not adapted, median", "error, median", "largest"]
    return markdown([*head, "of the orientation", "largest"], lines)


def _middle_and_worst(rows: Iterable[Row], key: str) -> tuple[str, str]:
    """Return the median of an error in % of the radius or in degrees, the largest and its robot."""
    angle = key.endswith("angle")
    found = [
        (math.degrees(row[key]) if angle else 100.0 * row[key] / row["radius"], row["robot"])
        for row in rows
        if row[key] is not None
    ]
    if not found:
        return "", ""
    (largest, robot), unit = max(found), "°" if angle else " %"
    return f"{median(value for value, _ in found):.2g}{unit}", f"{largest:.2g}{unit} (`{robot}`)"


# --- the pages ---

Report = Callable[[list[dict[str, Any]]], str]
TABLES: dict[str, tuple[str, Report]] = {  # the sweep, and what is shown of its rows
    "alternatives": ("alternatives", alternatives.report),
    "calibration": ("calibration", calibration.report),
    "estimators": ("estimators", estimators.report),
    "identification": ("identification", identification.report),
    "image": ("image", image.report),
    "lying_sensors": ("lying_sensors", lying_sensors.report),
    "readme": ("readme", third_party_robots.report),
    "real_calibration": ("real_calibration", real_calibration.report),
    "real_logs": ("real_logs", real_logs.report),
    "realities_contenders": ("realities", realities.contenders),
    "standing": ("standing", standing.report),
    "standing_rough": ("standing", standing.rough),
    "third_party_robots": ("third_party_robots", third_party_robots.counts),
    "tracker": ("tracker", tracker.report),
    "unknowns": ("unknowns", unknowns.report),
    "whole_robots": ("whole_robots", whole_robots.report),
    "zoo": ("zoo", zoo),
    **{name: ("scenarios", report) for name, report in scenarios.TABLES.items()},
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
        sweep, report = TABLES[name]
        return f"{found[1]}{report(table_rows(sweep))}\n\n<!-- end of table -->"

    return _MARKED.sub(table, text)


def pages() -> list[Path]:
    """Return the pages that have tables."""
    found = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("robots/*/README.md")]
    return [path for path in sorted(found) if _MARKED.search(path.read_text())]


# --- the sweeps ---


def measure(name: str, again: Sequence[str] | None) -> None:
    """Run the cases of a table that have no row, and write it.

    Args:
        name: of the sweep file and of the table.
        again: "key=value" of cases that run again; empty: all; None: none.

    Raises:
        InputError: there is no such sweep, or a case failed.
    """
    path = HERE / f"{name}.toml"
    if not path.is_file():
        guess = did_you_mean(name, SWEPT)
        raise InputError(f"there is no {path.name}.{guess}", where=name)
    plan = Plan.read(path)
    folder = RUNNING / name
    table = HERE / f"{name}.csv"
    if again is not None or not plan.is_in(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        rows = [] if not table.is_file() else table_rows(name)
        CaseTable(kept(plan, rows, again)).save(folder / "table.csv")
        plan.save(folder)
    found = run_plan(plan, None, folder, retry=True)
    bad = [row for row in found.rows() if row["status"] in AGAIN]
    if bad:
        words = "\n".join(f"case {row['case']}: {row['reason']}" for row in bad)
        raise InputError(f"failed; the other rows are in {folder}.\n{words}", where=name)
    rows = [{key: row[key] for key in row if key not in LAST} for row in read(folder).rows()]
    CaseTable(rows).save(table)
    shutil.rmtree(folder)


def kept(plan: Plan, rows: Iterable[Row], again: Sequence[str] | None) -> list[dict[str, Any]]:
    """Return the rows of cases that do not run, with their numbers and seeds in this sweep."""
    wanted = {} if again is None else dict(setting(text, "--again") for text in again)
    keys = list(dict.fromkeys(key for case in plan.cases for key in case.values))
    for key in wanted:
        if key not in keys:
            guess = did_you_mean(key, keys)
            raise InputError(f"'{key}' is not varied.{guess}", where="--again")

    def values(row: Row) -> tuple[Any, ...]:
        return tuple("" if row.get(key) is None else row[key] for key in keys)

    by_values = {values(row): row for row in rows}
    found = []
    for case in plan.cases:
        flat = flat_row(case.values)
        stale = again is not None and all(str(flat[key]) == str(wanted[key]) for key in wanted)
        if not stale and values(flat) in by_values:
            row = by_values[values(flat)]
            found.append({**row, **dict(zip(FIRST, (case.number, case.seed), strict=True))})
    return found


def main() -> int:
    """Measure what is asked for, and write the pages."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SWEPT))
    parser.add_argument("--again", nargs="*", metavar="KEY=VALUE", help="also what has a row")
    parser.add_argument("--check", action="store_true", help="write no page")
    options = parser.parse_args()
    try:
        for name in options.names:
            measure(name, options.again)
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
