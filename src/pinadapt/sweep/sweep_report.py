"""The report of a sweep: success rate, percentiles, lost cases; one page.

A lost case has no number and counts as worse than any.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._output import Sheet, Table, html_page, percent, whole_file, write_text
from .._version import __version__
from ..exceptions import InputError
from ..plots.style import RC, Picture, legend, literal
from .cases import Plan, condition
from .table import DONE, LAST, CaseTable

PAGE, NUMBERS = "report.html", "report.json"
MAP, BANDS = FIGURES = ("map.png", "bands.png")
LEVEL = 0.95  # of all intervals
PERCENTILES = (0.05, 0.5, 0.95)
_MAIN = ("error_share", "max_error_last")
_OF_ROW = ("case", "seed", "status", "reason", *LAST)
_CLASSES = 12  # of a drawn number; half: a coarser curve; twice: a rougher one
_SHOWN, _WORST = 20, 10  # rows of a list; half or twice: a page to scroll more
_DPI = 110  # half: blurred; twice: a page of twice the size


class Rate(NamedTuple):
    """A share of cases with Wilson's interval.

    Attributes:
        good, total: cases.
        low, high: bounds of the share at 95 %.
    """

    good: int
    total: int
    low: float
    high: float

    def __str__(self) -> str:
        """Return the share in words."""
        share = self.good / self.total if self.total else 0.0
        return (
            f"{self.good} of {self.total} ({percent(share, 3)}; "
            f"{LEVEL:.0%} interval {percent(self.low, 3)} to {percent(self.high, 3)})"
        )


def rate(which: np.ndarray) -> Rate:
    """Return the share of true entries with Wilson's interval (Wilson 1927)."""
    count, total = int(np.sum(which)), len(which)
    if not total:
        return Rate(0, 0, 0.0, 1.0)
    from scipy.stats import binomtest

    found = binomtest(count, total).proportion_ci(LEVEL, method="wilson")
    return Rate(count, total, float(found.low), float(found.high))


class Percentile(NamedTuple):
    """A percentile with a confidence interval from order statistics.

    Attributes:
        p: share of the cases below.
        value, low, high: infinite where lost cases are reached, or too few cases for a bound.
    """

    p: float
    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return the number and its interval."""
        value, low, high = (f"{x:.3g}" if np.isfinite(x) else "lost" for x in self[1:])
        return f"{value} ({low} to {high})"


def percentile(values: np.ndarray, p: float) -> Percentile:
    """Return a percentile of values (N), the lost ones infinite.

    The interval is that of order statistics, which holds for every distribution (Conover 1999):
    the number of values below the percentile is binomial.
    """
    from scipy.stats import binom

    ordered = np.sort(values)
    n = len(ordered)
    k = min(max(int(np.ceil(p * n)), 1), n) - 1
    low = int(binom.ppf(0.5 * (1.0 - LEVEL), n, p)) - 1
    high = int(binom.ppf(0.5 * (1.0 + LEVEL), n, p))
    return Percentile(
        p,
        float(ordered[k]),
        float(ordered[low]) if low >= 0 else -np.inf,
        float(ordered[high]) if high < n else np.inf,
    )


@dataclass(frozen=True, eq=False)
class Report:
    """The report of a table.

    Attributes:
        table: of the sweep.
        plan: that was run.
        column: the result that is ranked and drawn; empty: the error, or the first number.
        folder: in which the table is, for the commands on the page; None: none.
    """

    table: CaseTable
    plan: Plan
    column: str = ""
    folder: Path | None = None

    def _is_varied(self, name: str) -> bool:
        """Return whether a column is one of what is varied."""
        keys = [key.removesuffix(".*") for key in self.plan.keys]
        return any(name == key or name.startswith((f"{key}[", f"{key}.")) for key in keys)

    @cached_property
    def parameters(self) -> list[str]:
        """The columns of what is varied, with more than one value."""
        return [
            name
            for name, column in self.table.columns.items()
            if name not in _OF_ROW and self._is_varied(name) and len(set(column.astype(str))) > 1
        ]

    @cached_property
    def results(self) -> list[str]:
        """The columns of numbers that came out."""
        return [
            name
            for name, column in self.table.columns.items()
            if name not in _OF_ROW
            and column.dtype == float
            and not self._is_varied(name)
            and np.isfinite(self.values(name)).any()
        ]

    @cached_property
    def main(self) -> str:
        """The result that is ranked and drawn.

        Raises:
            InputError: there is none of that name, or no number at all.
        """
        if self.column and self.table[self.column].dtype != float:
            raise InputError("is not a column of numbers.", where=self.column)
        for name in (self.column, *_MAIN, *self.results):
            if name and (name in self.results or name == self.column):
                return name
        raise InputError("no case has a number to report.", where="table")

    def values(self, name: str) -> np.ndarray:
        """Return a column of numbers (N), infinite where a case has none."""
        column = self.table[name]
        return np.where(np.isnan(column) | self.table.lost, np.inf, column)

    @cached_property
    def success(self) -> Rate | None:
        """The share of cases that succeeded; None where no column says so."""
        name, sign, bound = condition(self.plan.success)
        if not self.plan.success and name not in self.table.columns:
            return None
        column = self.table[name]
        if column.dtype == object:
            column = np.array([np.nan if each is None else float(each) for each in column])
        ops = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
        return rate(ops.get(sign, np.equal)(column, bound) & ~self.table.lost)

    def verdict(self) -> str:
        """Return the outcome in one line."""
        n, lost = len(self.table), int(self.table.lost.sum())
        parts = [f"{n} of {len(self.plan.cases)} cases"]
        if self.success is not None:
            parts.append(f"success ({self.plan.success or condition('')[0]}) {self.success}")
        kinds = Counter(each for each in self.table["status"].tolist() if each != DONE)
        words = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        parts.append(f"{lost} lost: {words}" if lost else "none lost")
        return "; ".join(parts) + "."

    def percentiles(self) -> Table:
        """Return percentiles of the results, with intervals, lost cases counted as worst."""
        rows = [
            [name, *(str(percentile(self.values(name), p)) for p in PERCENTILES), ""]
            for name in self.results
        ]
        return Table(
            rows, ["result", *(f"{p:.0%} ({LEVEL:.0%} interval)" for p in PERCENTILES), ""]
        )

    def worst(self) -> Table:
        """Return the cases with the largest result, without the lost ones."""
        values = np.where(self.table.lost, -np.inf, self.values(self.main))
        order = np.argsort(-values, kind="stable")[:_WORST].tolist()
        return self._listed([i for i in order if values[i] > -np.inf], [self.main])

    def lost(self) -> Table:
        """Return the lost cases with their reasons; of many the first."""
        rows: list[int] = np.flatnonzero(self.table.lost)[:_SHOWN].tolist()
        return self._listed(rows, ["status", "reason"])

    def _listed(self, rows: Sequence[int], names: Sequence[str]) -> Table:
        """Return cases with their parameters, and some results."""
        shown = ["case", *self.parameters, *names]
        return Table([[_cell(self.table[name][i]) for name in shown] for i in rows], shown)

    def _alone(self, listed: Table) -> str:
        """Return the command that runs the first of some cases alone; empty without a folder."""
        if self.folder is None or not listed.rows:
            return ""
        return f"pinadapt sweep {self.folder} --case {listed.rows[0][0]}"

    def sheet(self) -> Sheet:
        """Return verdict, percentiles and lost cases as text."""
        tables = [self.percentiles()] if self.results else []
        tables += [self.lost()] if self.table.lost.any() else []
        tables = tables or [Table([("cases", str(len(self.table)))])]
        alone = self._alone(self.lost())
        return Sheet(
            self.title, tables, f"{f'Run a case alone: {alone}' if alone else ''}\n{self.verdict()}"
        )

    @property
    def title(self) -> str:
        """The plan's title, or that of its scenario."""
        named = self.plan.title or (self.plan.scenario or {}).get("title", "")
        return str(named or self.plan.tables().get("function", "sweep"))

    @cached_property
    def _pictures(self) -> dict[str, bytes]:
        """The figures that fit the table, as PNG files by file name."""
        varied = [name for name in self.parameters if self.table[name].dtype == float]
        drawn = {}
        if self.results and len(varied) > 1:
            drawn[MAP] = self.map(*varied[:2]).png(dpi=_DPI)
        if self.results and varied:
            drawn[BANDS] = self.bands(varied[0]).png(dpi=_DPI)
        return drawn

    def map(self, x: str, y: str) -> Picture:
        """Return a map of the main result over two parameters, lost cases marked."""
        import matplotlib

        a, b, values = self.table[x], self.table[y], self.values(self.main)
        finite = np.isfinite(values)
        with matplotlib.rc_context(RC):
            figure = Picture(figsize=(7.0, 4.6), layout="constrained")
            ax = figure.add_subplot(xlabel=literal(x), ylabel=literal(y))
            drawn = ax.scatter(a[finite], b[finite], c=values[finite], s=18)
            ax.scatter(a[~finite], b[~finite], marker="x", color="C3", s=28, label="lost")
            if not finite.all():
                legend(ax)
            figure.colorbar(drawn, ax=ax, label=literal(self.main), format="%g")
        return figure

    def bands(self, x: str) -> Picture:
        """Return percentiles of the main result over one parameter; lost cases leave gaps."""
        import matplotlib

        values = self.values(self.main)
        places, groups = _classes(self.table[x])
        levels = np.array(
            [np.quantile(values[g], PERCENTILES, method="inverted_cdf") for g in groups]
        ).T
        low, median, high = np.where(np.isfinite(levels), levels, np.nan)
        with matplotlib.rc_context(RC):
            figure = Picture(figsize=(7.0, 4.6), layout="constrained")
            ax = figure.add_subplot(xlabel=literal(x), ylabel=literal(self.main))
            ax.fill_between(places, low, high, color="C0", alpha=0.2, lw=0.0, label="5 to 95 %")
            ax.plot(places, median, marker="o", label="median")
            legend(ax)
        return figure

    def page(self) -> str:
        """Return the report as one page without external resources."""
        good = self.success is None or self.success.low > 0.5
        parts = [
            f"<h1>{escape(self.title)}</h1>",
            f'<div class="{"note" if good else "warning"}">{escape(self.verdict())}</div>',
        ]
        lists = [("Results", self.percentiles())] if self.results else []
        lists += [("Worst cases", self.worst())] if self.results else []
        lists += [("Lost cases", self.lost())] if self.table.lost.any() else []
        for title, listed in lists:
            parts += [f"<h2>{title}</h2>", listed.html()]
            if title != "Results" and (alone := self._alone(listed)):
                parts.append(f"<p>Run a case alone: <code>{escape(alone)}</code></p>")
        for name, drawn in self._pictures.items():
            picture = b64encode(drawn).decode()
            parts.append(f'<p><img alt="{name}" src="data:image/png;base64,{picture}"></p>')
        return html_page(self.title, parts)

    def summary(self) -> dict[str, Any]:
        """Return the numbers of the report; None stands for what is not finite."""
        percentiles = {
            name: [
                {k: x if np.isfinite(x) else None for k, x in found._asdict().items()}
                for found in (percentile(self.values(name), p) for p in PERCENTILES)
            ]
            for name in self.results
        }
        return {
            "title": self.title,
            "verdict": self.verdict(),
            "cases": len(self.table),
            "planned": len(self.plan.cases),
            "lost": int(self.table.lost.sum()),
            "success": None if self.success is None else self.success._asdict(),
            "percentiles": percentiles,
            "version": __version__,
        }

    def save(self, folder: Path) -> None:
        """Write ``report.html``, ``report.json`` and the figures into a folder."""
        for name in FIGURES:
            (folder / name).unlink(missing_ok=True)
        for name, drawn in self._pictures.items():
            with whole_file(folder / name) as file:
                file.write(drawn)
        write_text(folder / NUMBERS, json.dumps(self.summary(), indent=2) + "\n")
        write_text(folder / PAGE, self.page())


def _classes(column: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return places (k) on an axis and the cases of each: single values, or classes of as many."""
    distinct = np.unique(column)
    if len(distinct) <= _CLASSES:
        return distinct, [np.flatnonzero(column == each) for each in distinct]
    groups = np.array_split(np.argsort(column, kind="stable"), _CLASSES)
    return np.array([float(np.median(column[g])) for g in groups]), groups


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "-" if np.isnan(value) else f"{value:.4g}"
    return "-" if value is None else str(value)
