"""Tables and figure of the comparison with alternatives to adaptation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .contenders import CONTENDERS, DEFAULT
from .shared import Row, grouped, markdown, two_digits

TITLES = {
    "perfect": "perfect sensors",
    "camera": "camera of 60 Hz, 20 ms late; encoders of 17 bits",
}
_COSTS = {"first": "{:.3g}", "peak": "{:.0%}", "peak_last": "{:.0%}", "chatter": "{:.2g}"}


def report(rows: Iterable[Row]) -> str:
    """Return all tables in Markdown."""
    groups = grouped(rows, "informed", "sensors")
    parts = []
    for sensors, title in TITLES.items():
        own = groups[False, sensors]
        found = errors(own, ("robot", "period"), "{} {:g} s", best="**{}**")
        parts.append(f"**Error, rms / largest [mm], {title}**\n\n{found}")
        parts.append(f"**Start and torque, medians, {title}**\n\n{costs(own)}")
    informed = [row for sensors in TITLES for row in groups[True, sensors]]
    found = errors(informed, ("robot", "sensors"), "{}, {}")
    parts.append(f"**Error, rms / largest [mm], with the true model**\n\n{found}")
    return "\n\n".join(parts)


def errors(rows: Sequence[Row], by: tuple[str, str], title: str, best: str = "{}") -> str:
    """Return one row per contender, one column per values of two keys; the least rms is marked."""
    columns = sorted(grouped(rows, *by).items())
    body = []
    for name in _names(rows):
        cells = [name]
        for _, column in columns:
            least = min(row["rms"] for row in column if row["rms"] is not None)
            cell = "-"  # a contender for the other sensors only
            for row in column:
                if row["contender"] == name:
                    cell = _error(row)
                    cell = best.format(cell) if row["rms"] == least else cell
            cells.append(cell)
        body.append(cells)
    return markdown(["", *(title.format(*key) for key, _ in columns)], body)


def _error(row: Row) -> str:
    """Return rms and largest error."""
    if row["rms"] is None:
        return "lost"
    return f"{two_digits(row['rms'])} / {two_digits(row['max'])}"


def costs(rows: Sequence[Row]) -> str:
    """Return one row per contender: medians over the runs that did not diverge."""
    head = ["first second [mm]", "peak torque", "peak at the end", "chatter [N m]", "lost"]
    body = []
    contenders = grouped(rows, "contender")
    for name in _names(rows):
        held = [row for row in contenders[name] if row["rms"] is not None]
        cells = [
            form.format(median(row[key] for row in held)) if held else "-"
            for key, form in _COSTS.items()
        ]
        body.append([name, *cells, len(contenders[name]) - len(held)])
    return markdown(["", *head], body)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the rms errors over the period: a panel for each robot and set of sensors."""
    wrong = [row for row in rows if not row["informed"]]
    robots = sorted(grouped(wrong, "robot"))
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplots(len(TITLES), len(robots), sharex=True, sharey=True)
    for (sensors, robot), own in grouped(wrong, "sensors", "robot").items():
        ax = axes[[*TITLES].index(sensors), robots.index(robot)]
        for name in CONTENDERS:
            runs = [row for row in own if row["contender"] == name]
            errors = [row["rms"] or np.nan for row in runs]
            width = 3.0 if name == DEFAULT else 1.0
            ax.semilogy([row["period"] for row in runs], errors, "o-", lw=width, label=name)
        ax.set_title(f"{robot}, {TITLES[sensors]}", fontsize="small")
        ax.grid(alpha=0.3)
    for ax in axes[-1]:
        ax.set_xlabel("period of the circle [s]")
    figure.supylabel("rms error at the end [mm]")
    handles, labels = axes.flat[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize="small")
    figure.savefig(path, dpi=110)


def _names(rows: Sequence[Row]) -> list[str]:
    """Return the contenders among the rows, in their order."""
    there = grouped(rows, "contender")
    return [name for name in CONTENDERS if name in there]
