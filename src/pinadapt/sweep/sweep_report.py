"""The report of a sweep: success rate, percentiles, lost cases; text, page and JSON of one record.

A lost case has no number and counts as worse than any.
"""

from __future__ import annotations

from base64 import b64encode
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._checks import word
from .._output import Printed, Report, Table, html_page, percent, write_json, write_text
from .._version import __version__
from ..exceptions import InputError
from ..plots.style import RC, Picture, legend, literal, matplotlib
from .cases import SUCCESS, Plan, condition
from .table import DONE, FIRST, LAST, PRINTED_ROWS, CaseTable, flat_row

PAGE, NUMBERS = "report.html", "report.json"
MAP, BANDS = "map.png", "bands.png"
# of the results that are stated: the middle, and the ends of nine tenths of them
PERCENTILES = (0.05, 0.5, 0.95)
_MAIN = ("error_share", "max_error_last")
_CLASSES = 12  # of a drawn number; half: a coarser curve; twice: a rougher one


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
        return (
            f"{self.good} of {self.total} ({percent(self.good / self.total, 3)}; "
            f"95% interval {percent(self.low, 3)} to {percent(self.high, 3)})"
        )


def rate(which: np.ndarray) -> Rate:
    """Return the share of true entries, one at least, with Wilson's interval (Wilson 1927)."""
    from scipy.stats import binomtest

    count = int(np.sum(which))
    total = len(which)
    bounds = binomtest(count, total).proportion_ci(method="wilson")  # of 95 %
    return Rate(count, total, *map(float, bounds))


def succeeded(table: CaseTable, text: str = "") -> np.ndarray:
    """Return which cases (N) fulfil a condition, see ``Plan``; without one they follow, or end."""
    column, sign, bound = condition(text)
    if not text and column not in table.names:
        return ~table.lost
    values = np.array(table[column], dtype=float)  # None becomes NaN
    return (values < bound if sign == "<" else values > bound) & ~table.lost


class Percentile(NamedTuple):
    """A percentile with a confidence interval from order statistics.

    Attributes:
        p: share of the cases below.
        value, low, high: infinite where lost cases are reached, NaN: too few cases for a bound.
    """

    p: float
    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return the number and its interval."""
        value, low, high = (
            "?" if np.isnan(x) else f"{x:.3g}" if np.isfinite(x) else "lost" for x in self[1:]
        )
        return f"{value} ({low} to {high})"


def percentile(values: np.ndarray, p: float) -> Percentile:
    """Return a percentile of values (N), the lost ones infinite.

    The interval is that of order statistics, which holds for every distribution (Conover 1999).
    """
    from scipy.stats import quantile_test

    value = float(np.quantile(values, p, method="inverted_cdf"))
    bounds = quantile_test(values, p=p).confidence_interval()
    return Percentile(p, value, *map(float, bounds))


@dataclass(frozen=True, eq=False, repr=False)
class SweepReport(Printed):
    """The report of a table.

    Attributes:
        table: of the sweep.
        plan: that was run.
        column: the result that is ranked and drawn; empty: the error, or the first number.
        folder: in which the table is, for the command on the page; None: none.
    """

    table: CaseTable
    plan: Plan
    column: str = ""
    folder: Path | None = None

    @property
    def title(self) -> str:
        """The plan's title, or that of its scenario."""
        plan = self.plan
        named = plan.title or (plan.scenario or {}).get("title")
        return str(named or getattr(plan.function, "__name__", plan.function))

    @cached_property
    def _varied(self) -> dict[str, None]:
        """The columns of what is varied, in order."""
        return dict.fromkeys(name for case in self.plan.cases for name in flat_row(case.values))

    @cached_property
    def parameters(self) -> list[str]:
        """The columns of what is varied, with more than one value."""
        return [
            name
            for name in self._varied
            if name in self.table.names and len(set(map(str, self.table[name]))) > 1
        ]

    @cached_property
    def results(self) -> list[str]:
        """The columns of numbers that came out."""
        return [
            name
            for name in self.table.names
            if name not in (*FIRST, *LAST, *self._varied)
            and self.table[name].dtype == float
            and np.isfinite(self.values(name)).any()
        ]

    @cached_property
    def main(self) -> str:
        """The result that is ranked and drawn.

        Raises:
            InputError: there is none of that name, or no number at all.
        """
        results = sorted(self.results, key=lambda name: name not in _MAIN)
        if not results:
            raise InputError("no case has a number to report.", where="table")
        return word(self.column or results[0], results, "column")

    def values(self, name: str) -> np.ndarray:
        """Return a column of numbers (N), infinite where a case has none."""
        column = self.table[name].astype(float)
        return np.where(np.isnan(column) | self.table.lost, np.inf, column)

    @cached_property
    def success(self) -> Rate:
        """The share of cases that succeeded."""
        return rate(succeeded(self.table, self.plan.success))

    def verdict(self) -> str:
        """Return the outcome in one line."""
        usual = SUCCESS if SUCCESS in self.table.names else DONE
        kinds = Counter(self.table["status"][self.table.lost])
        words = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        return (
            f"{len(self.table)} of {len(self.plan.cases)} cases; "
            f"success ({self.plan.success or usual}) {self.success}; "
            f"{f'{kinds.total()} lost: {words}' if kinds else 'none lost'}."
        )

    @cached_property
    def percentiles(self) -> dict[str, list[Percentile]]:
        """The percentiles of each result, lost cases counted as worst."""
        return {
            name: [percentile(self.values(name), p) for p in PERCENTILES] for name in self.results
        }

    @property
    def worst(self) -> list[int]:
        """Rows of the cases with the largest result, without the lost ones."""
        order = np.argsort(-self.values(self.main), kind="stable")
        return order[~self.table.lost[order]][: PRINTED_ROWS // 2].tolist()

    @property
    def lost(self) -> list[int]:
        """Rows of the lost cases, of many the first."""
        return np.flatnonzero(self.table.lost)[:PRINTED_ROWS].tolist()

    def _listed(self, title: str, rows: Sequence[int], names: Sequence[str]) -> Table:
        """Return cases with their parameters, and some results."""
        columns = ["case", *self.parameters, *names]
        table = self.table.rows()
        return Table([[table[i][name] for name in columns] for i in rows], columns, title)

    def report(self) -> Report:
        """Return percentiles, worst and lost cases, the verdict and how to run a case alone."""
        tables = []
        chosen = self.lost
        if self.results:
            rows = [[name, *each, ""] for name, each in self.percentiles.items()]
            header = ["result", *(f"{p:.0%} (95% interval)" for p in PERCENTILES), ""]
            tables = [
                Table(rows, header, "Results"),
                self._listed("Worst cases", self.worst, [self.main]),
            ]
            chosen = chosen or self.worst
        if self.lost:
            tables.append(self._listed("Lost cases", self.lost, ["status", "reason"]))
        note = self.verdict()
        if self.folder is not None and chosen:
            number = self.table["case"][chosen[0]]
            note += f" Run a case alone: pinadapt sweep {self.folder} --case {number}"
        return Report(self.title, tables, note)

    def page(self) -> str:
        """Return the report as one page without external resources."""
        pictures = (
            f'<p><img alt="{name}" src="data:image/png;base64,{b64encode(drawn).decode()}"></p>'
            for name, drawn in self._pictures.items()
        )
        return html_page(self.title, [self._repr_html_(), *pictures])

    def save(self, folder: Path) -> None:
        """Write ``report.html``, ``report.json`` and the figures into a folder."""
        for name, drawn in self._pictures.items():
            write_text(folder / name, drawn)
        write_json(
            folder / NUMBERS,
            {
                "title": self.title,
                "verdict": self.verdict(),
                "cases": len(self.table),
                "planned": len(self.plan.cases),
                "lost": int(self.table.lost.sum()),
                "success": self.success._asdict(),
                "percentiles": {
                    name: [each._asdict() for each in found]
                    for name, found in self.percentiles.items()
                },
                "version": __version__,
            },
        )
        write_text(folder / PAGE, self.page())

    @cached_property
    def _pictures(self) -> dict[str, bytes]:
        """The figures that fit the table, as PNG files by file name."""
        varied = [name for name in self.parameters if self.table[name].dtype == float]
        drawn = {}
        if self.results and len(varied) > 1:
            drawn[MAP] = self.map(*varied[:2]).png()
        if self.results and varied:
            drawn[BANDS] = self.bands(varied[0]).png()
        return drawn

    def map(self, x: str, y: str) -> Picture:
        """Return a map of the main result over two parameters, lost cases marked."""
        places = np.array([self.table[x], self.table[y]])
        values = self.values(self.main)
        lost = np.isinf(values)
        figure, ax = _axes(x, y)
        drawn = ax.scatter(*places[:, ~lost], c=values[~lost], s=18)
        ax.scatter(*places[:, lost], marker="x", color="C3", s=28, label="lost")
        if lost.any():
            legend(ax)
        figure.colorbar(drawn, ax=ax, label=literal(self.main), format="%g")
        return figure

    def bands(self, x: str) -> Picture:
        """Return percentiles of the main result over one parameter; lost cases leave gaps."""
        values = self.values(self.main)
        column = self.table[x]
        distinct = np.unique(column)
        parts = np.array_split(distinct, min(len(distinct), _CLASSES))
        groups = [np.isin(column, part) for part in parts]
        places = [np.median(column[g]) for g in groups]
        levels = [np.quantile(values[g], PERCENTILES, method="inverted_cdf") for g in groups]
        low, median, high = np.where(np.isfinite(levels), levels, np.nan).T
        figure, ax = _axes(x, self.main)
        ax.fill_between(places, low, high, color="C0", alpha=0.2, lw=0.0, label="5 to 95 %")
        ax.plot(places, median, marker="o", label="median")
        legend(ax)
        return figure


def _axes(x: str, y: str) -> tuple[Picture, Any]:
    """Return a figure with labelled axes."""
    with matplotlib.rc_context(RC):
        figure = Picture(figsize=(7.0, 4.6), layout="constrained")
        return figure, figure.add_subplot(xlabel=literal(x), ylabel=literal(y))
