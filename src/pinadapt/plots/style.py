"""How pictures look: told apart in print and by colour-blind readers, legends beside the curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .backend import Line2D
from .drawable import Drawable
from .words import literal

# Okabe and Ito's palette, dark enough on white, and two of Tol's muted ones.
COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#000000",
    "#882255",
    "#999933",
)
MARKERS = "os^vD>X<P"
RED, BLUE, GREEN, PURPLE = COLOURS[1], COLOURS[5], COLOURS[2], COLOURS[7]
RC: Any = {
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.axisbelow": True,
    "text.usetex": False,
}
_MARKS = 9  # markers on a curve


def colour(index: int) -> str:
    """Return the colour of the curve of an index, from 0."""
    return COLOURS[index % len(COLOURS)]


def curve(
    ax: Any, t: np.ndarray, values: np.ndarray, hue: int, marker: int, label: str | None = None
) -> None:
    """Draw one curve (N) in a colour, with a few of a marker, so that two are never alike."""
    step = max(1, len(t) // _MARKS)
    ax.plot(
        t,
        values,
        color=colour(hue),
        ls="-",  # whatever cycle a user has set
        lw=1.0,
        marker=MARKERS[marker % len(MARKERS)],
        markevery=((marker + 1) * step // 10, step),
        markersize=3.5,
        label=label,
    )


def marker_key(marker: int, label: str) -> Line2D:
    """Return what explains a marker in a legend."""
    shape = MARKERS[marker % len(MARKERS)]
    return Line2D([], [], color="gray", ls="", marker=shape, markersize=4.0, label=label)


def legend(ax: Any, *, title: str | None = None, more: Sequence[Line2D] = ()) -> None:
    """Put a legend beside a panel, where it covers no curve."""
    handles = [*ax.get_legend_handles_labels()[0], *more]
    if handles:
        ax.legend(
            handles=handles,
            title=title,
            title_fontsize=7,
            fontsize=7,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.3,
            ncols=1 + (len(handles) > 12),
        )


def shade(ax: Any, t: np.ndarray, where: np.ndarray, hue: str, label: str | None = None) -> None:
    """Shade the samples (N) where something holds."""
    if where.any():
        ax.fill_between(
            t,
            0.0,
            1.0,
            where=where,
            transform=ax.get_xaxis_transform(),
            color=hue,
            alpha=0.2,
            lw=0.0,
            label=label,
        )


def finish(figure: Any, axes: Any, run: Drawable) -> None:
    """Label time, mark what happened during the run, and head the figure."""
    axes[-1].set_xlabel("time [s]")
    for at, what in run.marks:
        if len(run.t) and at <= run.t[-1]:
            _mark(axes, at, what)
    end = "" if run.diverged is None else f" - diverged at {run.diverged:.3f} s"
    end = end if run.interrupted is None else f" - interrupted at {run.interrupted:.3f} s"
    title = f"{run.title} ({run.law}, {run.adaptation}){end}"
    figure.suptitle(literal(title), fontsize=10)


def _mark(axes: Any, at: float, what: str) -> None:
    """Draw a vertical line through all panels, its words above the first."""
    for ax in axes:
        ax.axvline(at, color="black", ls=":", lw=0.9)
    above = axes[0].get_xaxis_transform()
    axes[0].text(at, 1.02, literal(what), transform=above, fontsize=7, ha="center", va="bottom")
