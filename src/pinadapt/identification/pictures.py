"""The two pictures of an identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .._files import whole_file
from ..plots.backend import matplotlib
from ..plots.figures import parameter_figure
from ..plots.style import RC, RED, Picture, curve, legend, literal, shade

if TYPE_CHECKING:
    from .identification import Identification

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


class Pictures(NamedTuple):
    """What an identification shows; in Jupyter each picture shows itself.

    Attributes:
        torque: of each joint as measured, and as predicted by the description and by what was
            learned before the part that is held out.
        parameters: the online estimates in time, those of the whole log dashed.
    """

    torque: Picture
    parameters: Picture


def pictures_of(found: Identification) -> Pictures:
    """Draw what was identified."""
    windows, title = found.windows, f"{found.described.name}, {Path(found.log.source).name}"
    before, after = (windows.residual(a) for a in (found.described_parameters, found.before_split))
    online = SimpleNamespace(
        title=title,
        law="identified online",
        adaptation=found.estimator.controller.adaptation_d.name,
        t=found.online.t,
        a_k=found.online.a_k,
        a_d=found.online.a_d,
        a_k_true=found.kinematic.estimate,
        a_d_true=found.dynamic.estimate,
        kinematic_names=found.kinematic.names,
        dynamic_names=found.dynamic.names,
        marks=(),
        diverged=None,
        interrupted=None,
    )
    with matplotlib.rc_context(RC):
        torque = prediction_figure(
            title,
            found.described.joint_names,
            windows.t,
            windows.tau,
            {"described": windows.tau - before, "learned until then": windows.tau - after},
            found.split,
        )
        return Pictures(torque, parameter_figure(online, "dashed: whole log"))


def draw(found: Identification, folder: Path) -> list[Path]:
    """Write ``torque.png`` and ``parameters.png``, each whole; return their paths."""
    paths = []
    for name, picture in pictures_of(found)._asdict().items():
        paths.append(folder / f"{name}.png")
        with whole_file(paths[-1]) as file:
            file.write(picture.png(dpi=130))
    return paths
