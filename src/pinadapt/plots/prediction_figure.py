"""The picture of torques as measured and as predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .picture import Picture
from .style import RED, curve, legend, shade
from .words import literal

_ONE_COLUMN = 4  # joints


def prediction_figure(
    title: str,
    joint_names: Sequence[str],
    t: np.ndarray,
    tau: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    split: float,
) -> Picture:
    """Return one panel a joint: its torque, and as several parameters predict it.

    Args:
        title: of the figure.
        joint_names: n of them.
        t: (N) times [s].
        tau: (N, n) measured [N m or N].
        predicted: words -> (N, n) [N m or N].
        split: time from which on samples were held out [s].
    """
    n = len(joint_names)
    columns = 1 if n <= _ONE_COLUMN else 2
    rows = -(-n // columns)
    figure = Picture(figsize=(5.5 * columns + 1.5, 1.7 * rows + 0.8), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True)).ravel()
    for j, name in enumerate(joint_names):
        ax = axes[j]
        ax.plot(t, tau[:, j], color="0.7", lw=3.0, label="measured")
        for k, (words, values) in enumerate(predicted.items()):
            curve(ax, t, values[:, j], len(predicted) - 1 - k, k, words)
        shade(ax, t, t >= split, RED, "held out")
        ax.set_title(literal(name), fontsize=8)
        ax.set_ylabel("N m or N")
    for ax in axes[max(n - columns, 0) : n]:
        ax.set_xlabel("time [s]")
        ax.tick_params(labelbottom=True)
    for ax in axes[n:]:
        ax.set_visible(False)
    legend(axes[columns - 1])
    figure.suptitle(literal(f"{title}: torques, low-passed"), fontsize=10)
    return figure
