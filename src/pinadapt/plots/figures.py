"""The three pictures of a run: error, parameters, torque."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from .._files import whole_file
from .backend import Figure, FigureCanvasAgg, matplotlib
from .drawable import Drawable
from .error_figure import draw_errors
from .words import literal

_MOST_LABELLED = 12  # more lines than this share one colour map and carry no legend


def draw_all(run: Drawable, folder: Path) -> list[Path]:
    """Draw ``error.png``, ``parameters.png``, ``torque.png`` into a folder; return their paths.

    Each is whole or not there.
    """
    drawings = {"error": error_figure, "parameters": parameter_figure, "torque": torque_figure}
    paths = []
    with (
        matplotlib.rc_context(
            {
                "font.size": 9,
                "axes.grid": True,
                "grid.alpha": 0.3,
                "axes.axisbelow": True,
                "text.usetex": False,
            }
        ),
        warnings.catch_warnings(),
    ):
        warnings.filterwarnings("ignore", message="Glyph")  # a sign the font has not is a box
        for name, draw in drawings.items():
            paths.append(folder / f"{name}.png")
            figure = draw(run)
            FigureCanvasAgg(figure)
            with whole_file(paths[-1]) as file:
                figure.savefig(file, dpi=130, format="png")
    return paths


def error_figure(run: Drawable) -> Figure:
    """Return the task error, each coordinate and its norm, and V(t) where it is known."""
    figure, axes = draw_errors(run)
    _finish(figure, axes, run)
    return figure


def parameter_figure(run: Drawable) -> Figure:
    """Return the estimates over time, the truth dashed; many dynamic parameters by kind."""
    few = run.a_d.shape[1] <= _MOST_LABELLED
    panels = [("kinematic [m]", run.a_k, run.a_k_true, run.kinematic_names)]
    panels += [("dynamic", run.a_d, run.a_d_true, run.dynamic_names)] if few else _by_kind(run)
    panels = [panel for panel in panels if panel[1].shape[1]]
    figure = Figure(figsize=(8, 2.4 * max(len(panels), 1) + 0.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(max(len(panels), 1), 1, sharex=True))
    for ax, (label, values, truth, names) in zip(axes, panels, strict=False):
        _estimates(ax, run.t, values, truth, names)
        ax.set_ylabel(label)
    if not panels:
        axes[0].text(0.5, 0.5, "no parameter is unknown", ha="center", transform=axes[0].transAxes)
    _finish(figure, axes, run)
    return figure


def torque_figure(run: Drawable) -> Figure:
    """Return the motor torques and the smallest eigenvalue of the estimated mass matrix.

    Shaded red where a torque is at its limit, blue where the inverse Jacobian is damped.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for joint, torque in zip(run.joint_names, run.tau.T, strict=True):
        axes[0].plot(run.t, torque, lw=0.9, label=literal(joint))
    axes[0].set_ylabel("torque [N m] or force [N]")
    axes[0].legend(title="joint", loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    for ax in axes:
        _shade(ax, run.t, run.saturated, "tab:red")  # a torque at its limit
        _shade(ax, run.t, run.damping > 0.0, "tab:blue")  # damped near a singularity
    axes[1].plot(run.t, run.min_eig_M_hat, color="tab:green", lw=0.9)
    axes[1].axhline(0.0, color="black", lw=0.6)
    axes[1].set_ylabel("smallest eigenvalue\nof $\\hat M$")
    _finish(figure, axes, run)
    return figure


def _shade(ax: Any, t: np.ndarray, where: np.ndarray, colour: str) -> None:
    if where.any():
        ax.fill_between(
            t,
            0.0,
            1.0,
            where=where,
            transform=ax.get_xaxis_transform(),
            color=colour,
            alpha=0.15,
            lw=0.0,
        )


def _by_kind(run: Drawable) -> list[tuple[str, np.ndarray, np.ndarray | None, tuple[str, ...]]]:
    """Split ten parameters a body into masses, first moments and inertias."""
    kinds = {"mass [kg]": "m", "first moment [kg m]": "mc", "inertia [kg m$^2$]": "I"}
    panels = []
    for label, prefix in kinds.items():
        parts = [name.rpartition(".")[2] for name in run.dynamic_names]
        columns = [
            i
            for i, part in enumerate(parts)
            if (part == "m" if prefix == "m" else part.startswith(prefix))
        ]
        truth = None if run.a_d_true is None else run.a_d_true[..., columns]
        panels.append(
            (
                label,
                run.a_d[:, columns],
                truth,
                tuple(run.dynamic_names[i] for i in columns),
            )
        )
    return panels


def _estimates(
    ax: Any, t: np.ndarray, values: np.ndarray, truth: np.ndarray | None, names: tuple[str, ...]
) -> None:
    colours = matplotlib.colormaps["tab10" if len(names) <= 10 else "viridis"]
    for i, name in enumerate(names):
        colour = colours(i if len(names) <= 10 else i / max(len(names) - 1, 1))
        ax.plot(t, values[:, i], color=colour, lw=1.0, label=literal(name.removesuffix(".m")))
        if truth is not None:
            true = np.broadcast_to(truth[..., i], t.shape)
            ax.plot(t, true, color=colour, ls="--", lw=0.7, alpha=0.7, drawstyle="steps-post")
    if len(names) <= _MOST_LABELLED:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)


def _mark(axes: Any, at: float, what: str) -> None:
    """Draw a vertical line through all panels, its words above the first."""
    for ax in axes:
        ax.axvline(at, color="black", ls=":", lw=0.9)
    above = axes[0].get_xaxis_transform()
    axes[0].text(at, 1.02, literal(what), transform=above, fontsize=7, ha="center", va="bottom")


def _finish(figure: Figure, axes: Any, run: Drawable) -> None:
    axes[-1].set_xlabel("time [s]")
    for at, what in run.marks:
        if len(run.t) and at <= run.t[-1]:
            _mark(axes, at, what)
    end = "" if run.diverged is None else f" - diverged at {run.diverged:.3f} s"
    end = end if run.interrupted is None else f" - interrupted at {run.interrupted:.3f} s"
    title = f"{run.title} ({run.law}, {run.adaptation}){end}"
    figure.suptitle(literal(title), fontsize=10)
