"""What a sweep says: success rate, percentiles, what matters, which cases were lost; one page.

A lost case has no number and counts as worse than any, in percentiles and in ranks.
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
from ..plots.style import (
    COLOURS,
    GREY,
    RC,
    RED,
    Line2D,
    Picture,
    colour,
    curve,
    legend,
    literal,
)
from .cases import Plan, condition, flat
from .table import DONE, LAST, CaseTable

PAGE, NUMBERS = "report.html", "report.json"
FIGURES = ("map.png", "bands.png", "influence.png")
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
_CLASSES, _FEW = 12, 24  # classes of a drawn number; distinct values that are not classed
_FEWEST = 5  # cases of a class
_BANDS = (0.05, 0.25, 0.5, 0.75, 0.95)
_PANELS, _CELLS = 4, 200  # words that are drawn apart, and cells of a map along an axis
_WIDE = 5.0  # ratio of the quartiles of an axis above which it is logarithmic; 3 if uniform from 0
_SHOWN, _COLUMNS = 20, 6  # rows of a list, and its parameters
_DPI = 110


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


class Influence(NamedTuple):
    """How much of a result's ranking one parameter explains.

    Attributes:
        name: of the column.
        value: Spearman's rank correlation of numbers; of words the root of the share of the
            variance of ranks between the words (Kruskal and Wallis), without sign.
        low, high: bounds at 95 %; equal to the value for words.
        p: probability of such a value where the parameter does not matter.
        words: whether the parameter is words.
    """

    name: str
    value: float
    low: float
    high: float
    p: float
    words: bool


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

    @cached_property
    def parameters(self) -> list[str]:
        """The columns of what is varied, with more than one value."""
        keys = [*self.plan.cases.keys]
        stars = [key.removesuffix(".*") for key in keys]
        return [
            name
            for name, column in self.table.columns.items()
            if name not in _OF_ROW
            and any(name == key or name.startswith((f"{key}[", f"{key}.")) for key in stars)
            and len({str(each) for each in column.tolist()}) > 1
        ]

    @cached_property
    def results(self) -> list[str]:
        """The columns of numbers that came out."""
        keys = {name.removesuffix(".*") for name in self.plan.cases.keys}
        return [
            name
            for name, column in self.table.columns.items()
            if name not in _OF_ROW
            and column.dtype == float
            and not any(name == key or name.startswith((f"{key}[", f"{key}.")) for key in keys)
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
            if name in self.results and np.isfinite(self.table[name]).any():
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
            values = self.values(name)
            if not np.isfinite(values).any():
                continue
            found = [percentile(values, p) for p in PERCENTILES]
            worst = values.max()
            cells = [f"{_amount(name, each.value)} ({_interval(name, each)})" for each in found]
            rows.append([name, *cells, _amount(name, worst), ""])
        header = ["result", *(f"{p:.0%} ({LEVEL:.0%} interval)" for p in PERCENTILES)]
        return Table(rows, [*header, "largest", ""])

    def influences(self) -> list[Influence]:
        """Return how much each parameter explains of the main result, the largest first.

        Spearman's correlation sees what rises or falls throughout; an optimum in the middle of a
        range has none. The interval is Fisher's, with the variance of Fieller (1957).
        """
        found = [
            _influence(name, self.table[name], self.values(self.main)) for name in self.parameters
        ]
        return sorted((each for each in found if each), key=lambda each: -abs(each.value))

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
        """Return cases with the parameters that matter most, and some results."""
        try:
            ranked = [each.name for each in self.influences()]
        except InputError:
            ranked = []
        shown = [*ranked, *(each for each in self.parameters if each not in ranked)][:_COLUMNS]
        cells = [
            [
                str(self.table["case"][i]),
                *(_cell(name, self.table[name][i]) for name in (*shown, *names)),
            ]
            for i in rows
        ]
        return Table(cells, ["case", *_short(shown), *names])

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
        named = self.plan.title or (self.plan.raw or {}).get("title", "")
        return str(named or self.plan.tables().get("function", "sweep"))

    def figures(self) -> dict[str, Picture]:
        """Return the figures that fit the table, by file name."""
        try:
            influences = self.influences()
        except InputError:
            return {}
        numbers_ = [each.name for each in influences if not each.words]
        found = {}
        if len(numbers_) > 1:
            found[FIGURES[0]] = self.map(*self._pair(numbers_))
        if numbers_:
            found[FIGURES[1]] = self.bands(numbers_[0])
        if len(influences) > 1:
            found[FIGURES[2]] = self.tornado()
        return found

    @cached_property
    def _pictures(self) -> dict[str, bytes]:
        """The figures as PNG files, by file name."""
        return {name: figure.png(dpi=_DPI) for name, figure in self.figures().items()}

    @cached_property
    def _split(self) -> dict[str, np.ndarray]:
        """The cases of each word of the most influential parameter of few words; else all."""
        words = [each.name for each in self.influences() if each.words]
        if words:
            column = np.array([str(each) for each in self.table[words[0]]])
            distinct = dict.fromkeys(column.tolist())
            if len(distinct) <= _PANELS:
                return {word: column == word for word in distinct}
        return {"": np.ones(len(self.table), bool)}

    def _pair(self, names: Sequence[str]) -> tuple[str, str]:
        """Return the parameters of a map: the grid's if there are two, else the first two."""
        grid = [each.key for each in self.plan.cases.values if each.axis and len(each.axis) > 1]
        grid = [name for name in grid if name in names]
        x, y = (grid if len(grid) == 2 else names)[:2]
        return x, y

    def map(self, x: str, y: str) -> Picture:
        """Return a map of the main result over two parameters, lost cases marked."""
        import matplotlib
        from matplotlib.colors import LogNorm, Normalize

        a, b, values = self.table[x], self.table[y], self.values(self.main)
        finite = np.isfinite(values)
        shown = values[finite]
        log = shown.size > 0 and shown.min() > 0.0 and shown.max() > 10.0 * shown.min()
        scale = _unit(self.main)[0]
        bounds = (
            (scale * float(shown.min()), scale * float(shown.max())) if shown.size else (0.1, 1.0)
        )
        norm = LogNorm(*bounds) if log else Normalize(*bounds)
        xs, ys = np.unique(a), np.unique(b)
        gridded = len(xs) * len(ys) <= len(values) and max(len(xs), len(ys)) <= _CELLS
        with matplotlib.rc_context(RC):
            width = 7.0 if len(self._split) == 1 else 3.6 * len(self._split) + 1.0
            figure = Picture(figsize=(width, 4.6), layout="constrained")
            panels = figure.subplots(1, len(self._split), sharex=True, sharey=True, squeeze=False)[
                0
            ]
            for ax, (word, own) in zip(panels, self._split.items(), strict=True):
                if gridded:
                    drawn = self._cells(ax, (xs, ys), (a[own], b[own]), scale * values[own], norm)
                else:
                    there, gone = own & finite, own & ~finite
                    drawn = ax.scatter(
                        a[there], b[there], c=scale * values[there], norm=norm, s=18, lw=0.0
                    )
                    _lost_marks(ax, a[gone], b[gone])
                for axis, each in (("x", xs), ("y", ys)):
                    if _logarithmic(each):
                        getattr(ax, f"set_{axis}scale")("log")
                ax.set_title(literal(word), fontsize=9)
                ax.set_xlabel(literal(x))
                ax.grid(False)
            panels[0].set_ylabel(literal(y))
            bar = figure.colorbar(drawn, ax=panels, label=literal(_label(self.main)))
            if log:
                _plain_ticks(bar.ax.yaxis)
            if (~finite).any():
                mark = Line2D([], [], color=RED, ls="", marker="x", label="lost")
                figure.legend(handles=[mark], loc="outside upper right", fontsize=8, frameon=False)
        return figure

    def _cells(
        self,
        ax: Any,
        grid: tuple[np.ndarray, np.ndarray],
        places: tuple[np.ndarray, np.ndarray],
        values: np.ndarray,
        norm: Any,
    ) -> Any:
        """Draw the median of each cell of a grid; a cross where a case of it was lost."""
        xs, ys = grid
        median = np.full((len(ys), len(xs)), np.nan)
        lost = []
        for j, y in enumerate(ys):
            for i, x in enumerate(xs):
                inside = values[(places[0] == x) & (places[1] == y)]
                if inside.size and np.isfinite(inside).any():
                    middle = np.quantile(inside, 0.5, method="inverted_cdf")
                    median[j, i] = middle if np.isfinite(middle) else np.nan
                if not np.isfinite(inside).all():
                    lost.append((x, y))
        drawn = ax.pcolormesh(_edges(xs), _edges(ys), median, norm=norm, cmap="viridis")
        ax.set_facecolor("#eeeeee")
        if lost:
            _lost_marks(ax, *np.array(lost).T)
        return drawn

    def bands(self, x: str) -> Picture:
        """Return percentiles of the main result over one parameter, and the share lost, if any."""
        import matplotlib

        a, values = self.table[x], self.values(self.main)
        shown = values[np.isfinite(values)]
        scale = _unit(self.main)[0]
        top = scale * float(shown.max()) if shown.size else 1.0
        with matplotlib.rc_context(RC):
            figure = Picture(figsize=(7.0, 4.6), layout="constrained")
            gone = ~np.isfinite(values)
            parts = 1 + int(gone.any())
            ax, below = figure.subplots(
                parts, 1, sharex=True, height_ratios=(4, 1)[:parts], squeeze=False
            )[[0, -1], 0]
            for k, (word, own) in enumerate(self._split.items()):
                places, groups = _classes(a[own])
                levels = scale * np.array(
                    [np.quantile(values[own][g], _BANDS, method="inverted_cdf") for g in groups]
                )
                self._band(ax, places, levels, top, k, word)
                if gone.any():
                    lost = np.array([np.mean(gone[own][g]) for g in groups])
                    below.step(places, 100.0 * lost, where="mid", color=colour(k))
            ax.set_ylabel(literal(_label(self.main)))
            if shown.size and shown.min() > 0.0 and shown.max() > 10.0 * shown.min():
                ax.set_yscale("log")
                _plain_ticks(ax.yaxis)
            legend(ax)
            if gone.any():
                below.set_ylabel("lost [%]")
                below.set_ylim(0.0, max(1.0, 1.1 * below.get_ylim()[1]))
            below.set_xlabel(literal(x))
            if _logarithmic(a):
                below.set_xscale("log")
        return figure

    def _band(
        self, ax: Any, places: np.ndarray, levels: np.ndarray, top: float, k: int, word: str
    ) -> None:
        """Draw median and bands, of (k, 5) levels; where these are of lost cases, up to the top."""
        drawn = np.where(np.isfinite(levels), levels, top).T
        for low, high, alpha, name in ((0, 4, 0.15, "5 to 95 %"), (1, 3, 0.3, "25 to 75 %")):
            label = None if word else name
            ax.fill_between(
                places, drawn[low], drawn[high], color=colour(k), alpha=alpha, lw=0.0, label=label
            )
        median = np.where(np.isfinite(levels[:, 2]), levels[:, 2], np.nan)
        curve(ax, places, median, k, k, literal(word or "median"))

    def tornado(self) -> Picture:
        """Return a bar for each parameter: its rank correlation with the main result."""
        import matplotlib

        found = self.influences()[:_SHOWN][::-1]
        with matplotlib.rc_context(RC):
            figure = Picture(figsize=(7.0, 1.2 + 0.28 * len(found)), layout="constrained")
            ax = figure.add_subplot()
            for row, each in enumerate(found):
                clear = each.p < 1.0 - LEVEL
                hue = GREY if not clear else COLOURS[2] if each.words else COLOURS[each.value > 0.0]
                ax.barh(row, each.value, color=hue, height=0.7)
                if not each.words:
                    ax.plot([each.low, each.high], [row, row], color="black", lw=1.0)
            ax.axvline(0.0, color="black", lw=0.8)
            ax.set_yticks(range(len(found)), [literal(each.name) for each in found], fontsize=8)
            ax.set_xlim(-1.0, 1.0)
            ax.set_xlabel(
                literal(
                    f"rank correlation with {self.main}; grey: may be chance, lines: {LEVEL:.0%}"
                )
            )
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
            FIGURES[2]: "What matters",
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
        given = self.plan.given
        rows = [(key, str(value), "") for key, value in flat(given.get("vary", {})).items()]
        rows += [
            (f"case {i}", str(each), "") for i, each in enumerate(given.get("case", [])[:_SHOWN])
        ]
        rows += [(key, str(given[key]), "") for key in given if key not in ("vary", "case")]
        return Table(rows, ("key", "values", ""))

    def summary(self) -> dict[str, Any]:
        """Return the numbers of the report; None stands for what is not finite."""
        finite = [name for name in self.results if np.isfinite(self.values(name)).any()]
        percentiles = {
            name: [percentile(self.values(name), p)._asdict() for p in PERCENTILES]
            for name in finite
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
                "influences": [each._asdict() for each in self.influences()] if finite else [],
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


def _influence(name: str, column: np.ndarray, values: np.ndarray) -> Influence | None:
    from scipy.stats import kruskal, rankdata, spearmanr

    n = len(values)
    if n < 5 or np.ptp(rankdata(values)) == 0.0:
        return None
    if column.dtype == object:
        words = np.array([str(each) for each in column])
        groups = [values[words == each] for each in dict.fromkeys(words.tolist())]
        ranks = rankdata(values)
        found = kruskal(*(ranks[words == each] for each in dict.fromkeys(words.tolist())))
        size = float(np.sqrt(min(1.0, found.statistic / (n - 1)))) if len(groups) > 1 else 0.0
        return Influence(name, size, size, size, float(found.pvalue), True)
    known = np.isfinite(column)
    if known.sum() < 5 or np.ptp(column[known]) == 0.0:
        return None
    correlated = spearmanr(column[known], rankdata(values[known]))
    rho = float(correlated.statistic)
    half = 1.96 * np.sqrt(1.06 / max(known.sum() - 3, 1))
    z = np.arctanh(np.clip(rho, -1.0 + 1e-12, 1.0 - 1e-12))
    return Influence(
        name,
        rho,
        float(np.tanh(z - half)),
        float(np.tanh(z + half)),
        float(correlated.pvalue),
        False,
    )


def _classes(column: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return places (k) on an axis and the cases of each: single values, or classes of as many."""
    distinct = np.unique(column)
    if len(distinct) <= _FEW and len(column) >= _FEWEST * len(distinct):
        return distinct, [np.flatnonzero(column == each) for each in distinct]
    count = max(2, min(_CLASSES, len(column) // 8))
    groups = np.array_split(np.argsort(column, kind="stable"), count)
    return np.array([float(np.median(column[g])) for g in groups]), groups


def _edges(places: np.ndarray) -> np.ndarray:
    """Return the edges (k + 1) of cells around places (k), in their logarithm if that is even."""
    if len(places) == 1:
        return places[0] + np.array([-0.5, 0.5])
    log = _logarithmic(places)
    p = np.log(places) if log else places
    middle = 0.5 * (p[1:] + p[:-1])
    edges = np.concatenate([[2.0 * p[0] - middle[0]], middle, [2.0 * p[-1] - middle[-1]]])
    return np.exp(edges) if log else edges


def _logarithmic(values: np.ndarray) -> bool:
    """Return whether an axis is better logarithmic."""
    low, high = np.quantile(values, (0.25, 0.75))
    return bool(values.min() > 0.0 and high > _WIDE * low)


def _plain_ticks(axis: Any) -> None:
    """Label a logarithmic axis at 1, 2 and 5, without powers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _lost_marks(ax: Any, x: np.ndarray, y: np.ndarray) -> None:
    if len(x):
        ax.scatter(x, y, marker="x", color=RED, s=28, lw=1.3, zorder=3)


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
    low = (
        "?"
        if found.low == -np.inf
        else _amount(name, found.low).rpartition(" ")[0] or _amount(name, found.low)
    )
    return f"{low} to {_amount(name, found.high) if np.isfinite(found.high) else '?'}"


def _short(names: Sequence[str]) -> list[str]:
    """Return dotted names without their first part where the rest is unique."""
    ends = [name.partition(".")[2] or name for name in names]
    return [end if ends.count(end) == 1 else name for end, name in zip(ends, names, strict=True)]


def _cell(name: str, value: Any) -> str:
    if isinstance(value, float):
        return "-" if np.isnan(value) else _amount(name, value)
    return "-" if value is None else str(value)
