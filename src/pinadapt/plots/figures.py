"""The figures of a run: error, parameters, torque; and the predicted torques of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._output import write_text
from ..tasks.task import RowGroup
from .style import (
    RC,
    Drawable,
    Picture,
    curves,
    finish,
    legend,
    literal,
    matplotlib,
    panels,
)


def error_figure(run: Drawable) -> Picture:
    """Return the figure of the task error, by coordinate and as norm, and of V(t) where known."""
    groups = run.task.groups
    figure, axes = panels(2 * len(groups) + (run.lyapunov is not None))
    for k, group in enumerate(groups):
        unit, scale = group.shown
        error = scale * run.error[:, group.rows]
        curves(
            axes[2 * k],
            run.t,
            error,
            np.array(run.task.labels)[group.rows],
            f"{group.name} error [{unit}]",
        )
        _norm(axes[2 * k + 1], run, group, "norm")
    if run.lyapunov is not None:
        curves(axes[-1], run.t, run.lyapunov[:, None], ["Lyapunov function"], "V")
    finish(figure, axes, run)
    return figure


def _norm(ax: Any, run: Drawable, group: RowGroup, label: str) -> np.ndarray:
    """Draw the norm of the error (N) on a logarithmic axis that leaves out its zeros; return it."""
    norm = group.shown.scale * np.linalg.norm(run.error[:, group.rows], axis=1)
    norm = np.maximum(norm, np.finfo(float).eps)
    ax.semilogy(run.t, norm, lw=1.0, label=label)
    ax.set_ylabel(f"{group.name} error [{group.shown.unit}]")
    if len(norm):
        ax.set_ylim(bottom=0.5 * np.quantile(norm, 0.01))
    legend(ax)
    return norm


_KINDS = {
    "m": "mass [kg]",
    "mc": "first moment [kg m]",
    "I": "inertia [kg m$^2$]",
    "armature": "rotor inertia [kg m$^2$ or kg]",
    "viscous": "viscous [N m s or N s/m]",
    "coulomb": "Coulomb [N m or N]",
}


def parameter_figure(run: Drawable) -> Picture:
    """Return the figure of the estimates, with a panel for each kind of parameter.

    Those that the motion does not tell from others are grey. Of a kind with many parameters, those
    that change most are drawn.

    Args:
        run: the run.
    """
    lumped = any("(" in name for name in run.kinematic_names)  # of a tracker or a camera
    label = "kinematic" if lumped else "kinematic [m]"
    drawn = [(label, run.a_k, run.a_k_true, run.kinematic_names)] if run.kinematic_names else []
    kinds = [
        _KINDS.get(name.rpartition(".")[2].partition("#")[0].rstrip("xyz"), "dynamic")
        for name in run.dynamic_names
    ]
    for kind in dict.fromkeys(kinds):
        own = [i for i, each in enumerate(kinds) if each == kind]
        truth = None if run.a_d_true is None else run.a_d_true[..., own]
        drawn.append((kind, run.a_d[:, own], truth, [run.dynamic_names[i] for i in own]))
    figure, axes = panels(max(len(drawn), 1))
    for ax, (label, values, truth, names) in zip(axes, drawn, strict=False):
        grey = set(names) & set(run.not_identified)
        notes = ["dashed: truth"] * (truth is not None) + ["grey: not identified"] * bool(grey)
        curves(ax, run.t, values, names, label, truth=truth, grey=grey, notes=notes)
    finish(figure, axes, run)
    return figure


def torque_figure(run: Drawable) -> Picture:
    """Return the figure of motor torques, shares of the limits, disturbance, and an eigenvalue.

    The limits are those of the description. The disturbance is drawn where the law observes it. The
    eigenvalue is the smallest of the estimated mass matrix.
    """
    names = run.joint_names
    limited = np.flatnonzero(np.isfinite(run.effort_limits))
    bounds = run.effort_limits[limited]
    figure, axes = panels(2 + (limited.size > 0) + (run.disturbance is not None))
    curves(axes[0], run.t, run.tau, names, "torque [N m] or force [N]")
    if limited.size:
        share = 100.0 * run.tau[:, limited] / bounds
        words = [f"{names[i]}: {bound:g}" for i, bound in zip(limited, bounds, strict=True)]
        curves(axes[1], run.t, share, words, "share of limit [%]", notes=["limit [N m or N]"])
        for sign in (1.0, -1.0):
            axes[1].axhline(100.0 * sign, color="black", ls="-.")
    if run.disturbance is not None:
        curves(axes[-2], run.t, run.disturbance, names, "disturbance [N m or N]")
    curves(
        axes[-1], run.t, run.min_eig_M_hat[:, None], ["of the estimated M"], "smallest eigenvalue"
    )
    finish(figure, axes, run)
    return figure


def prediction_figure(
    title: str,
    slides: Mapping[str, bool],
    t: np.ndarray,
    tau: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    split: float,
) -> Picture:
    """Return a figure with a panel per joint: measured torque, and predictions of it.

    Args:
        title: of the figure.
        slides: name of a joint -> whether it is prismatic, in order.
        t: (N) times [s].
        tau: (N, n) measured [N m or N].
        predicted: label -> (N, n) [N m or N].
        split: time from which on the samples were held out [s].
    """
    rows = -(-len(slides) // 2)
    figure = Picture(figsize=(12.0, 0.8 + 1.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    for j, (ax, (name, slide)) in enumerate(zip(axes, slides.items(), strict=False)):
        ax.set_title(literal(name), fontsize="small")
        ax.set_ylabel("N" if slide else "N m")
        ax.plot(t, tau[:, j], color="0.7", lw=3.0, label="measured")
        for words, values in predicted.items():
            ax.plot(t, values[:, j], lw=1.0, label=words)
        ax.axvspan(split, t[-1], color="C3", alpha=0.2, lw=0.0, label="held out")
    for ax in axes[len(slides) :]:
        ax.remove()
    figure.supxlabel("time [s]")
    legend(axes[min(1, len(slides) - 1)])
    figure.suptitle(literal(f"{title}: torques, low-passed"))
    return figure


def overlay_figure(runs: Sequence[Drawable]) -> Picture:
    """Return one figure with the error norms of several runs of one task, named by their laws.

    A panel for each group of rows. A run that diverged does not stretch the axis.
    """
    groups = runs[0].task.groups
    with matplotlib.rc_context(RC):
        figure, axes = panels(len(groups))
        for ax, group in zip(axes, groups, strict=True):
            ended = [np.zeros(0)]
            for run in runs:
                norm = _norm(ax, run, group, literal(f"{run.law}, {run.adaptation}"))
                if run.diverged is None:
                    ended.append(norm)
            kept = np.concatenate(ended)
            if kept.size:
                ax.set_ylim(0.5 * np.quantile(kept, 0.01), 2.0 * kept.max())
        axes[-1].set_xlabel("time [s]")
        figure.suptitle(literal(f"{runs[0].title}: errors"))
    return figure


class Figures(NamedTuple):
    """The figures of a run; Jupyter displays each once.

    Attributes:
        error: task error, by coordinate and as norm, and V(t) where it is known.
        parameters: estimates, and true values where they are known.
        torque: motor torques, and the smallest eigenvalue of the estimated mass matrix.
    """

    error: Picture
    parameters: Picture
    torque: Picture

    @classmethod
    def of(cls, run: Drawable) -> Figures:
        """Draw the figures of a run."""
        with matplotlib.rc_context(RC):
            return cls(error_figure(run), parameter_figure(run), torque_figure(run))

    def _ipython_display_(self) -> None:
        """Display the figures one below the other."""
        from IPython.display import display  # installed where a notebook runs

        for figure in self:
            display({"image/png": figure.png()}, raw=True)


def draw_all(run: Drawable, folder: Path) -> list[Path]:
    """Write the figures of a run into a folder as ``.png`` files, none incomplete; return paths."""
    paths = []
    for name, figure in Figures.of(run)._asdict().items():
        paths.append(folder / f"{name}.png")
        write_text(paths[-1], figure.png(dpi=130))
    return paths
