"""The picture of the task error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..tasks.task import RowGroup
from ..tasks.units import DISPLAYS
from .drawable import Drawable
from .picture import Picture
from .style import PURPLE, curve, finish, legend
from .words import literal

_NORMS = {"position": "|x - x_d|", "rotation": r"$|\phi|$", "joints": "|q - q_d|"}


def error_figure(run: Drawable) -> Picture:
    """Return the task error, each coordinate and its norm, and V(t) where it is known."""
    figure, axes = draw_errors(run)
    finish(figure, axes, run)
    return figure


def draw_errors(run: Drawable) -> tuple[Picture, Any]:
    """Return figure and axes: each group of rows by component and norm, and V(t) where known."""
    groups = run.task.groups
    panels = 2 * len(groups) + (run.lyapunov is not None)
    figure = Picture(figsize=(9, 1.0 + 2.0 * panels), layout="constrained")
    axes = np.atleast_1d(figure.subplots(panels, 1, sharex=True))
    for k, group in enumerate(groups):
        _draw_group(axes[2 * k : 2 * k + 2], run, group)
    if run.lyapunov is not None:
        axes[-1].plot(run.t, run.lyapunov, color=PURPLE, lw=1.0, label="Lyapunov function")
        axes[-1].set_ylabel("V")
        legend(axes[-1])
    return figure, axes


def _draw_group(axes: Any, run: Drawable, group: RowGroup) -> None:
    unit, scale = DISPLAYS[group.unit]
    error = scale * run.error[:, group.rows]
    _components(axes[0], run.t, error, run.task.labels[group.rows], f"{group.name} error [{unit}]")
    _norm(axes[1], run.t, np.linalg.norm(error, axis=1), f"{_NORMS[group.name]} [{unit}]")


def _components(
    ax: Any, t: np.ndarray, values: np.ndarray, names: Sequence[str], label: str
) -> None:
    for i, name in enumerate(names):
        curve(ax, t, values[:, i], i, i, _symbol(name))
    ax.set_ylabel(label)
    legend(ax)


def _symbol(name: str) -> str:
    """Return the label of a row, rotation vectors with their Greek letter."""
    letter, _, axis = name.partition("_")
    return rf"$\phi_{axis}$" if letter == "phi" else literal(name)


def _norm(ax: Any, t: np.ndarray, values: np.ndarray, label: str) -> None:
    values = np.maximum(values, 1e-12)
    ax.semilogy(t, values, color="black", lw=0.8, label="norm")
    if len(values):
        ax.set_ylim(bottom=0.5 * np.quantile(values, 0.01))
    ax.set_ylabel(label)
    legend(ax)
