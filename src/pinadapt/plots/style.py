"""How pictures look: told apart in print and by colour-blind readers, legends beside the curves."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import Any, Protocol

import numpy as np

from ..tasks.task import Task
from .backend import Figure, FigureCanvasAgg, Line2D, matplotlib


def literal(text: str) -> str:
    """Return a text that matplotlib draws as it is.

    It would take what stands between two dollars for mathematics, leave a label that begins with an
    underscore out of the legend, and fail at half surrogates.
    """
    shown = text.encode("utf-8", errors="replace").decode("utf-8").replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


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


class Picture(Figure):
    """A figure that pyplot does not know: it shows once, and goes with its last reference."""

    def png(self, dpi: int = 100) -> bytes:
        """Return the picture as a PNG file."""
        FigureCanvasAgg(self)
        buffer = BytesIO()
        with matplotlib.rc_context({"text.usetex": False}), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph")  # a sign the font has not is a box
            self.savefig(buffer, format="png", dpi=dpi)
        return buffer.getvalue()

    def _repr_png_(self) -> bytes:
        """Return the picture as Jupyter shows it."""
        return self.png()


class Drawable(Protocol):
    """A run of N samples, as ``Rollout`` has it; see there for shapes and units."""

    @property
    def title(self) -> str:
        """Of the figures."""

    @property
    def law(self) -> str:
        """Name of the law."""

    @property
    def adaptation(self) -> str:
        """Name of the adaptation."""

    @property
    def task(self) -> Task:
        """The controlled coordinates."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """One name a joint."""

    @property
    def effort_limits(self) -> np.ndarray:
        """The description's effort limits (nv), infinite where it has none."""

    @property
    def kinematic_names(self) -> tuple[str, ...]:
        """One name a kinematic parameter."""

    @property
    def dynamic_names(self) -> tuple[str, ...]:
        """One name a dynamic parameter."""

    @property
    def t(self) -> np.ndarray:
        """Time (N) [s]."""

    @property
    def error(self) -> np.ndarray:
        """Task error (N, m)."""

    @property
    def tau(self) -> np.ndarray:
        """Torques of the motors (N, nv)."""

    @property
    def a_k(self) -> np.ndarray:
        """Kinematic estimates (N, p_k)."""

    @property
    def a_d(self) -> np.ndarray:
        """Dynamic estimates (N, p_d)."""

    @property
    def a_k_true(self) -> np.ndarray | None:
        """Their truth (p_k), or that of each time (N, p_k)."""

    @property
    def a_d_true(self) -> np.ndarray | None:
        """Their truth (p_d), or that of each time (N, p_d)."""

    @property
    def lyapunov(self) -> np.ndarray | None:
        """V (N)."""

    @property
    def min_eig_M_hat(self) -> np.ndarray:
        """Smallest eigenvalue of the estimated mass matrix (N)."""

    @property
    def damping(self) -> np.ndarray:
        """The mu^2 of the estimated Jacobian's right inverse (N)."""

    @property
    def saturated(self) -> np.ndarray:
        """Whether a torque was at its limit (N)."""

    @property
    def marks(self) -> tuple[tuple[float, str], ...]:
        """Time [s] and words of what happened during the run."""

    @property
    def interrupted(self) -> float | None:
        """Time at which somebody stopped the run [s]."""

    @property
    def diverged(self) -> float | None:
        """Time of divergence [s]."""
