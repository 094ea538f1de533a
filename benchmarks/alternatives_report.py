"""Tables and figure of the comparison with alternatives to adaptation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .contenders import CONTENDERS, DEFAULT
from .timing import markdown, two_digits

Row = Mapping[str, Any]
TITLES = {
    "perfect": "perfect sensors",
    "camera": "camera of 60 Hz, 20 ms late; encoders of 17 bits",
}
_LOST, _NONE = "lost", "-"
_COSTS = {"first": "{:.3g}", "peak": "{:.0%}", "peak_last": "{:.0%}", "chatter": "{:.2g}"}


def report(rows: Iterable[Row]) -> str:
    """Return all tables in Markdown."""
    rows = list(rows)
    wrong = [row for row in rows if not row["informed"]]
    parts = []
    for sensors, title in TITLES.items():
        own = [row for row in wrong if row["sensors"] == sensors]
        parts.append(f"**Error, rms / largest [mm], {title}**\n\n{errors(own)}")
        parts.append(f"**Start and torque, medians, {title}**\n\n{costs(own)}")
    informed = [row for row in rows if row["informed"]]
    parts.append(f"**Error, rms / largest [mm], with the true model**\n\n{known(informed)}")
    return "\n\n".join(parts)


def errors(rows: Sequence[Row]) -> str:
    """Return one row per contender, one column per robot and period; the least rms is bold."""
    columns = _unique((row["robot"], row["period"]) for row in rows)
    found = {(row["contender"], row["robot"], row["period"]): row for row in rows}
    least = {
        column: min(row["rms"] for key, row in found.items() if key[1:] == column and row["rms"])
        for column in columns
    }
    head = [f"{robot} {period:g} s" for robot, period in columns]
    body = []
    for name in _names(rows):
        cells = [found.get((name, *column)) for column in columns]
        body.append([name, *map(_error, cells, least.values())])
    return markdown(["", *head], body)


def costs(rows: Sequence[Row]) -> str:
    """Return one row per contender: medians over the runs that did not diverge."""
    head = ["first second [mm]", "peak torque", "peak at the end", "chatter [N m]", "lost"]
    body = []
    for name in _names(rows):
        own = [row for row in rows if row["contender"] == name]
        held = [row for row in own if row["rms"] is not None]
        median = {key: float(np.median([row[key] for row in held])) for key in _COSTS if held}
        cells = [form.format(median[key]) if held else _NONE for key, form in _COSTS.items()]
        body.append([name, *cells, str(len(own) - len(held))])
    return markdown(["", *head], body)


def known(rows: Sequence[Row]) -> str:
    """Return one row per contender, one column per robot and sensors."""
    columns = _unique((row["robot"], row["sensors"]) for row in rows)
    found = {(row["contender"], row["robot"], row["sensors"]): row for row in rows}
    body = [
        [name, *(_error(found.get((name, *column)), 0.0) for column in columns)]
        for name in _names(rows)
    ]
    return markdown(["", *(f"{robot}, {sensors}" for robot, sensors in columns)], body)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the rms errors over the period: a panel for each robot and set of sensors."""
    robots = _unique(row["robot"] for row in rows)
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(TITLES), len(robots), sharex=True, sharey=True)
    for ax, (sensors, robot) in zip(axes.flat, product(TITLES, robots), strict=True):
        for name in CONTENDERS:
            case = name, robot, sensors, False
            keys = ("contender", "robot", "sensors", "informed")
            own = [row for row in rows if tuple(row[key] for key in keys) == case]
            errors = [row["rms"] or np.nan for row in own]
            width = 3.0 if name == DEFAULT else 1.0
            ax.semilogy([row["period"] for row in own], errors, "o-", lw=width, label=name)
        ax.set_title(f"{robot}, {TITLES[sensors]}", fontsize="small")
        ax.grid(alpha=0.3)
    for ax in axes[-1]:
        ax.set_xlabel("period of the circle [s]")
    figure.supylabel("rms error at the end [mm]")
    handles, labels = axes.flat[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize="small")
    figure.savefig(path, dpi=110)


def _error(row: Row | None, least: float) -> str:
    """Return rms and largest error, bold if it is the least."""
    if row is None:  # a contender for the other sensors only
        return _NONE
    if row["rms"] is None:
        return _LOST
    text = f"{two_digits(row['rms'])} / {two_digits(row['max'])}"
    return f"**{text}**" if row["rms"] == least else text


def _names(rows: Sequence[Row]) -> list[str]:
    """Return the contenders among the rows, in their order."""
    there = {row["contender"] for row in rows}
    return [name for name in CONTENDERS if name in there]


def _unique(items: Iterable[Any]) -> list[Any]:
    """Return the distinct items, sorted."""
    return sorted(set(items))
