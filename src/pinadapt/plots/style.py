"""Style of the figures, in matplotlib's own colours: curves with their legend, panels over time."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from io import BytesIO
from typing import Any, TypeAlias

import matplotlib
import numpy as np
from matplotlib.figure import Figure

RC: Any = {"axes.grid": True, "grid.linestyle": ":", "text.usetex": False}
GREY = "0.75"

Drawable: TypeAlias = Any
"""A ``pinadapt.Rollout``, or what has its properties; its class imports this package."""


class Picture(Figure):
    """A figure outside of pyplot: shown only on request, and freed with its last reference."""

    def png(self, dpi: int = 100) -> bytes:
        """Return the picture as a PNG file."""
        buffer = BytesIO()
        with matplotlib.rc_context({"text.usetex": False}), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph")  # not in the font: a box
            self.savefig(buffer, format="png", dpi=dpi)
        return buffer.getvalue()

    def _repr_png_(self) -> bytes:
        """Return the picture for Jupyter."""
        return self.png()


def panels(count: int) -> tuple[Picture, Any]:
    """Return a figure with panels one below the other that share the time axis, and these."""
    figure = Picture(figsize=(9, 1.0 + 2.2 * count), layout="constrained")
    return figure, np.atleast_1d(figure.subplots(count, 1, sharex=True))


def literal(text: str) -> str:
    """Return a text that matplotlib draws literally.

    Otherwise matplotlib reads text between two dollar signs as mathematics, leaves labels that
    begin with an underscore out of legends, and fails at unpaired surrogates.
    """
    shown = text.encode("utf-8", errors="replace").decode("utf-8").replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def curves(
    ax: Any,
    t: np.ndarray,
    values: np.ndarray,
    names: Sequence[str],
    label: str,
    *,
    truth: np.ndarray | None = None,
    grey: Collection[str] = (),
    notes: Sequence[str] = (),
) -> None:
    """Draw named curves (N, k) with their legend; of many, the ten that change most.

    Args:
        ax: the panel.
        t: (N) time [s].
        values: (N, k) the curves.
        names: (k) theirs.
        label: of the vertical axis.
        truth: (k) or (N, k) drawn dashed.
        grey: names of the curves that are drawn in grey.
        notes: lines above the legend.
    """
    most = len(matplotlib.rcParams["axes.prop_cycle"])  # as many as there are colours
    change = np.ptp(values, axis=0) if len(values) else np.zeros(len(names))
    shown = np.sort(np.argsort(-change, kind="stable")[:most])
    if len(shown) < len(names):
        notes = [*notes, f"the {most} of {len(names)} that change most"]
    for i in shown:
        own = {"color": GREY, "zorder": 1.5} if names[i] in grey else {}
        (line,) = ax.plot(t, values[:, i], ls="-", lw=1.0, label=literal(names[i]), **own)
        if truth is not None:
            true = np.broadcast_to(truth[..., i], t.shape)
            ax.plot(t, true, ls="--", lw=0.7, color=line.get_color(), drawstyle="steps-post")
    ax.set_ylabel(label)
    legend(ax, "\n".join(notes))


def legend(ax: Any, title: str = "") -> None:
    """Put a legend beside a panel, where it does not cover curves."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(
            title=title,
            title_fontsize="x-small",
            fontsize="x-small",
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
        )


def finish(figure: Any, axes: Any, run: Drawable) -> None:
    """Label the time axis, mark the events of the run, and add the title."""
    axes[-1].set_xlabel("time [s]")
    for at, what in run.marks:
        if (run.t >= at).any():
            for ax in axes:
                ax.axvline(at, color="black", ls=":", lw=0.9)
            axes[0].text(
                at,
                1.02,
                literal(what),
                transform=axes[0].get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize="x-small",
            )
    figure.suptitle(literal(f"{run.title} ({run.law}, {run.adaptation})"))
