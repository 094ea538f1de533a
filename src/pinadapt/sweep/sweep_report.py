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
from .cases import Plan, condition, flat
from .table import DONE, LAST, CaseTable

PAGE, NUMBERS = "report.html", "report.json"
FIGURES = ("map.png", "bands.png")
LEVEL = 0.95  # of all intervals
PERCENTILES = (0.05, 0.5, 0.95)
_MAIN = ("error_share", "max_error_last")
_OF_ROW = ("case", "seed", "status", "reason", *LAST)
_SHARES = ("error_share", "saturated", "torque_use")  # shown in per cent
_LENGTHS = (
    "max_error_first",
    "max_error_last",
    "rms_error_last",
    "worst_after_change",
    "max_tool_error_last",
)
_CLASSES = 12  # of a drawn number; half: a coarser curve; twice: a rougher one
_BANDS = (0.05, 0.5, 0.95)
# Ratio of the quartiles above which an axis is logarithmic, 3 if uniform from 0. Half: uniform
# axes are logarithmic too; twice: as well.
_WIDE = 5.0
_SHOWN, _COLUMNS = 20, 6  # rows of a list, and its parameters; half or twice: a page to scroll more
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
        keys = [key.removesuffix(".*") for key in self.plan.cases.keys]
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
        if self.column:
            if self.table[self.column].dtype != float:
                raise InputError("is not a column of numbers.", where=self.column)
            return self.column
        for name in (*_MAIN, *self.results):
            if name in self.results:
                return name
        raise InputError("no case has a number to report.", where="table")

    def values(self, name: str) -> np.ndarray:
        """Return a column of numbers (N), infinite where a case has none."""
        column = self.table[name]
        return np.where(np.isnan(column) | self.table.lost, np.inf, column)

    @cached_property
    def succeeded(self) -> np.ndarray | None:
        """Whether each case succeeded (N); None where no column says so."""
        name, sign, bound = condition(self.plan.success)
        if not self.plan.success and name not in self.table.columns:
            return None
        column = self.table[name]
        if column.dtype == object:
            column = np.array([np.nan if each is None else float(each) for each in column])
        ops = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
        held = ops.get(sign, np.equal)(column, bound)
        return np.asarray(held & ~self.table.lost)

    @property
    def success(self) -> Rate | None:
        """The share of cases that succeeded."""
        return None if self.succeeded is None else rate(self.succeeded)

    def verdict(self) -> str:
        """Return the outcome in one line."""
        n, lost = len(self.table), int(self.table.lost.sum())
        parts = [f"{n} of {len(self.plan.cases)} cases"]
        if self.success is not None:
            name, sign, bound = condition(self.plan.success)
            words = name if sign == "==" and bound == 1.0 else f"{name} {sign} {bound:g}"
            parts.append(f"success ({words}) {self.success}")
        kinds = Counter(each for each in self.table["status"].tolist() if each != DONE)
        words = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        parts.append(f"{lost} lost: {words}" if lost else "none lost")
        return "; ".join(parts) + "."

    def percentiles(self) -> Table:
        """Return percentiles of the results, with intervals, lost cases counted as worst."""
        rows = []
        for name in self.results:
            found = [percentile(self.values(name), p) for p in PERCENTILES]
            cells = [f"{_amount(name, each.value)} ({_interval(name, each)})" for each in found]
            rows.append([name, *cells, _amount(name, self.values(name).max()), ""])
        header = ["result", *(f"{p:.0%} ({LEVEL:.0%} interval)" for p in PERCENTILES)]
        return Table(rows, [*header, "largest", ""])

    def worst(self) -> Table:
        """Return the cases with the largest result, without the lost ones."""
        return self._listed(self._worst, [self.main])

    @cached_property
    def _worst(self) -> list[int]:
        """The places of the worst cases that are not lost, the worst first."""
        values = np.where(self.table.lost, -np.inf, self.values(self.main))
        order = np.argsort(-values, kind="stable")[:10].tolist()
        return [i for i in order if values[i] > -np.inf]

    def lost(self) -> Table:
        """Return the lost cases with their reasons; of many the first."""
        return self._listed(self._lost, ["status", "reason"])

    @cached_property
    def _lost(self) -> list[int]:
        """The places of the lost cases; of many the first."""
        found: list[int] = np.flatnonzero(self.table.lost)[:_SHOWN].tolist()
        return found

    def _listed(self, rows: Sequence[int], names: Sequence[str]) -> Table:
        """Return cases with their parameters, and some results."""
        shown = self.parameters[:_COLUMNS]
        cells = [
            [
                str(self.table["case"][i]),
                *(_cell(name, self.table[name][i]) for name in (*shown, *names)),
            ]
            for i in rows
        ]
        return Table(cells, ["case", *shown, *names])

    def _alone(self, rows: Sequence[int]) -> str:
        """Return the command that runs the first of some cases alone; empty without a folder."""
        if self.folder is None or not rows:
            return ""
        return f"pinadapt sweep {self.folder} --case {self.table['case'][rows[0]]}"

    def sheet(self) -> Sheet:
        """Return verdict, percentiles and lost cases as text."""
        tables = [self.percentiles()] if self.results else []
        tables += [self.lost()] if self.table.lost.any() else []
        tables = tables or [Table([("cases", str(len(self.table)))])]
        alone = (
            f"Run a case alone: {self._alone(self._lost)}\n\n" if self._alone(self._lost) else ""
        )
        return Sheet(self.title, tables, f"{alone}{self.verdict()}")

    @property
    def title(self) -> str:
        """The plan's title, or that of its scenario."""
        named = self.plan.title or (self.plan.scenario or {}).get("title", "")
        return str(named or self.plan.tables().get("function", "sweep"))

    def figures(self) -> dict[str, Picture]:
        """Return the figures that fit the table, by file name."""
        varied = [name for name in self.parameters if self.table[name].dtype == float]
        if not (varied and self.results):
            return {}
        pairs = {FIGURES[0]: self.map(*varied[:2])} if len(varied) > 1 else {}
        return pairs | {FIGURES[1]: self.bands(varied[0])}

    @cached_property
    def _pictures(self) -> dict[str, bytes]:
        """The figures as PNG files, by file name."""
        return {name: figure.png(dpi=_DPI) for name, figure in self.figures().items()}

    def map(self, x: str, y: str) -> Picture:
        """Return a map of the main result over two parameters, lost cases marked."""
        import matplotlib

        a, b, values = self.table[x], self.table[y], self.values(self.main)
        finite, (scale, _) = np.isfinite(values), _unit(self.main)
        with matplotlib.rc_context(RC):
            figure = Picture(figsize=(7.0, 4.6), layout="constrained")
            ax, norm = figure.add_subplot(), _norm(scale * values[finite])
            drawn = ax.scatter(a[finite], b[finite], c=scale * values[finite], norm=norm, s=18)
            ax.scatter(a[~finite], b[~finite], marker="x", color="C3", s=28, label="lost")
            _label_axes(ax, (x, a), (y, b))
            if not finite.all():
                legend(ax)
            figure.colorbar(drawn, ax=ax, label=literal(_label(self.main)), format="%g")
        return figure

    def bands(self, x: str) -> Picture:
        """Return percentiles of the main result over one parameter; lost cases leave gaps."""
        import matplotlib

        a, values = self.table[x], self.values(self.main)
        scale = _unit(self.main)[0]
        with matplotlib.rc_context(RC):
            figure = Picture(figsize=(7.0, 4.6), layout="constrained")
            ax = figure.add_subplot()
            places, groups = _classes(a)
            levels = np.array(
                [np.quantile(values[g], _BANDS, method="inverted_cdf") for g in groups]
            ).T
            low, median, high = scale * np.where(np.isfinite(levels), levels, np.nan)
            ax.fill_between(places, low, high, color="C0", alpha=0.2, lw=0.0, label="5 to 95 %")
            ax.plot(places, median, marker="o", label="median")
            _label_axes(ax, (x, a), (_label(self.main), values[np.isfinite(values)]))
            legend(ax)
        return figure

    def page(self) -> str:
        """Return the report as one page without external resources."""
        lost = self.table.lost
        parts = [f"<h1>{escape(self.title)}</h1>"]
        good = self.success is None or self.success.low > 0.5
        parts.append(f'<div class="{"note" if good else "warning"}">{escape(self.verdict())}</div>')
        if self.results:
            parts += [
                "<h2>Results</h2>",
                self.percentiles().html(),
                "<p>Lost cases count as worse than any. Intervals of percentiles are those of "
                "order statistics, of the success rate Wilson's.</p>",
            ]
        captions = {
            FIGURES[0]: "Two parameters" + (": crosses are lost cases" if lost.any() else ""),
            FIGURES[1]: "Percentiles over one parameter",
        }
        for name, drawn in self._pictures.items():
            picture = b64encode(drawn).decode()
            parts.append(f"<h2>{captions[name]}</h2>")
            parts.append(f'<img alt="{captions[name]}" src="data:image/png;base64,{picture}">')
        lists = [("Worst cases", self._worst, self.worst)] if self.results else []
        lists += [(f"Lost cases, {int(lost.sum())}", self._lost, self.lost)] if lost.any() else []
        for title, rows, listed in lists:
            parts += [f"<h2>{title}</h2>", listed().html()]
            if alone := self._alone(rows):
                parts.append(f"<p>Run a case alone: <code>{escape(alone)}</code></p>")
        parts += ["<h2>What was varied</h2>", self._varied().html()]
        return html_page(self.title, parts)

    def _varied(self) -> Table:
        given = {key: each for key, each in self.plan.tables().items() if key != "scenario"}
        rows = [(key, str(value), "") for key, value in flat(given).items()]
        return Table(rows, ("key", "values", ""))

    def summary(self) -> dict[str, Any]:
        """Return the numbers of the report; None stands for what is not finite."""
        percentiles = {
            name: [percentile(self.values(name), p)._asdict() for p in PERCENTILES]
            for name in self.results
        }
        return without_infinities(
            {
                "title": self.title,
                "verdict": self.verdict(),
                "cases": len(self.table),
                "planned": len(self.plan.cases),
                "lost": int(self.table.lost.sum()),
                "success": None if self.success is None else self.success._asdict(),
                "percentiles": percentiles,
                "version": __version__,
            }
        )

    def save(self, folder: Path) -> None:
        """Write ``report.html``, ``report.json`` and the figures into a folder."""
        for name in FIGURES:
            if name in self._pictures:
                with whole_file(folder / name) as file:
                    file.write(self._pictures[name])
            else:
                (folder / name).unlink(missing_ok=True)
        write_text(folder / NUMBERS, json.dumps(self.summary(), indent=2) + "\n")
        write_text(folder / PAGE, self.page())


def without_infinities(value: Any) -> Any:
    """Return nested tables and lists with None in place of numbers that are not finite."""
    if isinstance(value, dict):
        return {key: without_infinities(each) for key, each in value.items()}
    if isinstance(value, list):
        return [without_infinities(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _classes(column: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return places (k) on an axis and the cases of each: single values, or classes of as many."""
    distinct = np.unique(column)
    if len(distinct) <= _CLASSES:
        return distinct, [np.flatnonzero(column == each) for each in distinct]
    groups = np.array_split(np.argsort(column, kind="stable"), _CLASSES)
    return np.array([float(np.median(column[g])) for g in groups]), groups


def _label_axes(ax: Any, x: tuple[str, np.ndarray], y: tuple[str, np.ndarray]) -> None:
    """Name both axes, and make them logarithmic where their values are."""
    ax.set_xlabel(literal(x[0]))
    ax.set_ylabel(literal(y[0]))
    ax.set_xscale("log" if _logarithmic(x[1]) else "linear")
    ax.set_yscale("log" if _logarithmic(y[1]) else "linear")


def _norm(values: np.ndarray) -> Any:
    """Return the scale of the colours of a map."""
    from matplotlib.colors import LogNorm, Normalize

    if not values.size:
        return Normalize(0.0, 1.0)
    return (LogNorm if _logarithmic(values) else Normalize)(values.min(), values.max())


def _logarithmic(values: np.ndarray) -> bool:
    """Return whether an axis is better logarithmic."""
    if not values.size or not values.min() > 0.0:
        return False
    low, high = np.quantile(values, (0.25, 0.75))
    return bool(high > _WIDE * low)


def _unit(name: str) -> tuple[float, str]:
    """Return factor and unit in which a result is shown."""
    if name in _SHARES:
        return 100.0, "%"
    return (1e3, "mm") if name in _LENGTHS else (1.0, "px" if "_pixels_" in name else "")


def _label(name: str) -> str:
    unit = _unit(name)[1]
    return f"{name} [{unit}]" if unit else name


def _amount(name: str, value: float) -> str:
    scale, unit = _unit(name)
    return f"{scale * value:.3g} {unit}".rstrip() if np.isfinite(value) else "lost"


def _interval(name: str, found: Percentile) -> str:
    low, high = (
        _amount(name, bound) if np.isfinite(bound) else "?" for bound in (found.low, found.high)
    )
    return f"{low} to {high}"


def _cell(name: str, value: Any) -> str:
    if isinstance(value, float):
        return "-" if np.isnan(value) else _amount(name, value)
    return "-" if value is None else str(value)
