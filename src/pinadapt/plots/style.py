"""Style of the figures: colours and markers for print and colour-blind readers, and legends."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import Any, TypeAlias

import numpy as np

try:  # image files need no backend, so an unknown one is tolerated
    import matplotlib
except ValueError:  # MPLBACKEND names an unknown backend
    _named = os.environ.pop("MPLBACKEND", "")
    for _half in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        del sys.modules[_half]
    import matplotlib

    os.environ["MPLBACKEND"] = _named

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D


def literal(text: str) -> str:
    """Return a text that matplotlib draws literally.

    Otherwise matplotlib reads text between two dollar signs as mathematics, leaves labels that
    begin with an underscore out of legends, and fails at unpaired surrogates.
    """
    shown = text.encode("utf-8", errors="replace").decode("utf-8").replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


# The colours of Okabe and Ito that are dark enough on white, and two of Tol's muted palette.
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
GREY = "#BBBBBB"
RED, BLUE, GREEN, PURPLE = COLOURS[1], COLOURS[5], COLOURS[2], COLOURS[7]
RC: Any = {
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.axisbelow": True,
    "text.usetex": False,
}
_MARKS = 9  # markers on a curve


# a ``pinadapt.Rollout``, or what has its properties; its class imports this package
Drawable: TypeAlias = Any


def colour(index: int) -> str:
    """Return the colour of curve ``index``, counted from 0."""
    return COLOURS[index % len(COLOURS)]


def curve(
    ax: Any,
    t: np.ndarray,
    values: np.ndarray,
    hue: int,
    marker: int,
    label: str | None = None,
    *,
    grey: bool = False,
) -> None:
    """Draw a curve (N) with a colour and a few markers, which together identify it; or in grey."""
    step = max(1, len(t) // _MARKS)
    ax.plot(
        t,
        values,
        color=GREY if grey else colour(hue),
        ls="-",  # also where a user has set a cycle of line styles
        lw=1.0,
        zorder=1.5 if grey else 2.0,
        marker=MARKERS[marker % len(MARKERS)],
        markevery=((marker + 1) * step // 10, step),
        markersize=3.5,
        label=label,
    )


def marker_key(marker: int, label: str) -> Line2D:
    """Return the legend entry of a marker."""
    shape = MARKERS[marker % len(MARKERS)]
    return Line2D([], [], color="gray", ls="", marker=shape, markersize=4.0, label=label)


def legend(ax: Any, *, title: str | None = None, more: Sequence[Line2D] = ()) -> None:
    """Put a legend beside a panel, where it does not cover curves."""
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
    """Shade the times t (N) at which ``where`` (N) is true."""
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
    """Label the time axis, mark the events of the run, and add the title."""
    axes[-1].set_xlabel("time [s]")
    for at, what in run.marks:
        if len(run.t) and at <= run.t[-1]:
            _mark(axes, at, what)
    end = "" if run.diverged is None else f" - diverged at {run.diverged:.3f} s"
    end = end if run.interrupted is None else f" - interrupted at {run.interrupted:.3f} s"
    title = f"{run.title} ({run.law}, {run.adaptation}){end}"
    figure.suptitle(literal(title), fontsize=10)


def _mark(axes: Any, at: float, what: str) -> None:
    """Draw a vertical line through all panels, with a text above the first."""
    for ax in axes:
        ax.axvline(at, color="black", ls=":", lw=0.9)
    above = axes[0].get_xaxis_transform()
    axes[0].text(at, 1.02, literal(what), transform=above, fontsize=7, ha="center", va="bottom")


class Picture(Figure):
    """A figure outside of pyplot: shown only on request, and freed with its last reference."""

    def png(self, dpi: int = 100) -> bytes:
        """Return the picture as a PNG file.

        The canvas draws it once; ``savefig`` would draw it twice, first to find its layout.
        """
        canvas, buffer, shown = FigureCanvasAgg(self), BytesIO(), self.dpi
        with matplotlib.rc_context({"text.usetex": False}), warnings.catch_warnings():
            warnings.filterwarnings(
                "ignore", message="Glyph"
            )  # characters that are not in the font are drawn as boxes
            try:
                self.dpi = dpi
                canvas.print_png(buffer)
            finally:
                self.dpi = shown
        return buffer.getvalue()

    def _repr_png_(self) -> bytes:
        """Return the picture for Jupyter."""
        return self.png()
