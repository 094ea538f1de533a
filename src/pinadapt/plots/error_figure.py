"""The picture of the task error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..rollout.rollout import Rollout
from ..tasks.registry import task_named


def draw_errors(rollout: Rollout) -> tuple[Figure, Any]:
    """Return the figure and its axes: position error in mm, for a pose rotation error in degrees, V(t) where it is known."""
    task = task_named(rollout.task)
    p = task.positions
    panels = 2 + 2 * (rollout.angle is not None) + (rollout.lyapunov is not None)
    figure = Figure(figsize=(8, 1.0 + 2.0 * panels), layout="constrained")
    axes = np.atleast_1d(figure.subplots(panels, 1, sharex=True))
    _components(axes[0], rollout.t, 1e3 * rollout.error[:, :p], task.labels[:p], "task error [mm]")
    _norm(axes[1], rollout.t, 1e3 * rollout.distance, "|x - x_d| [mm]")
    if rollout.angle is not None:
        words = [rf"$\phi_{label[-1]}$" for label in task.labels[p:]]
        _components(
            axes[2], rollout.t, np.degrees(rollout.error[:, p:]), words, "rotation error [deg]"
        )
        _norm(axes[3], rollout.t, np.degrees(rollout.angle), r"$|\phi|$ [deg]")
    if rollout.lyapunov is not None:
        axes[-1].plot(rollout.t, rollout.lyapunov, color="tab:purple", lw=1.0)
        axes[-1].set_ylabel("V")
    return figure, axes


def _components(
    ax: Any, t: np.ndarray, values: np.ndarray, names: Sequence[str], label: str
) -> None:
    for i, name in enumerate(names):
        ax.plot(t, values[:, i], label=name, lw=1.0)
    ax.set_ylabel(label)
    ax.legend(loc="upper right", ncols=3)


def _norm(ax: Any, t: np.ndarray, values: np.ndarray, label: str) -> None:
    values = np.maximum(values, 1e-12)
    ax.semilogy(t, values, color="black", lw=0.8)
    if len(values):
        ax.set_ylim(bottom=0.5 * np.quantile(values, 0.01))
    ax.set_ylabel(label)
