"""The figures of a run: error, parameters, torque; and the predicted torques of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._output import whole_file
from ..tasks.frame import ImageTask
from ..tasks.task import RowGroup
from .style import (
    BLUE,
    GREEN,
    GREY,
    PURPLE,
    RC,
    RED,
    Drawable,
    Picture,
    colour,
    curve,
    finish,
    legend,
    literal,
    marker_key,
    matplotlib,
    shade,
)

_ONE_COLUMN = 4  # joints
_SEEN = 4.0  # height of a picture [inches]
_NORMS = {
    "position": "|x - x_d|",
    "rotation": r"$|\phi|$",
    "joints": "|q - q_d|",
    "picture": "|y - y_d|",
}


def error_figure(run: Drawable) -> Picture:
    """Return the figure of the task error, by coordinate and as norm, and of V(t) where known."""
    figure, axes = draw_errors(run)
    finish(figure, axes, run)
    return figure


def draw_errors(run: Drawable) -> tuple[Picture, Any]:
    """Return the error figure and its axes over time.

    There are two panels per group of rows, and V(t) where known; of a picture the desired and the
    true one are below.
    """
    groups = run.task.groups
    panels = 2 * len(groups) + (run.lyapunov_curve is not None)
    height, seen = 1.0 + 2.0 * panels, _SEEN * isinstance(run.task, ImageTask)
    figure = Picture(figsize=(9, height + seen), layout="constrained")
    over_time: Any = figure
    if seen:
        parts: Any = figure.subfigures(2, 1, height_ratios=(height, seen))
        over_time, below = parts
        _draw_picture(below.subplots(), run)
    axes = np.atleast_1d(over_time.subplots(panels, 1, sharex=True))
    for k, group in enumerate(groups):
        _draw_group(axes[2 * k : 2 * k + 2], run, group)
    slowed = np.zeros(len(run.t), dtype=bool)
    for start, end, *_ in run.slowed:
        slowed |= (run.t >= start) & (run.t <= end)
    for ax in axes[: 2 * len(groups)]:
        shade(ax, run.t, slowed, BLUE, "path slowed")
        if run.slowed:
            legend(ax)
    if run.lyapunov_curve is not None:
        axes[-1].plot(*run.lyapunov_curve, color=PURPLE, lw=1.0, label="Lyapunov function")
        axes[-1].set_ylabel("V")
        legend(axes[-1])
    return figure, axes


def _draw_picture(ax: Any, run: Drawable) -> None:
    """Draw the desired and the true picture as a camera has them, v downwards."""
    unit, scale = run.task.groups[0].shown
    drawn = (run.x, BLUE, "-", "true"), (run.x_d, "black", "--", "desired")
    for values, tone, style, words in drawn:
        ax.plot(*(scale * values[:, :2]).T, color=tone, ls=style, lw=1.0, label=words)
    ax.set_aspect("equal", adjustable="datalim")
    ax.invert_yaxis()
    ax.set_xlabel(f"u [{unit}]")
    ax.set_ylabel(f"v [{unit}]")
    legend(ax)


def _draw_group(axes: Any, run: Drawable, group: RowGroup) -> None:
    unit, scale = group.shown
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
    """Return the label of an error row; rotation rows get their Greek letter."""
    letter, _, axis = name.partition("_")
    return rf"$\phi_{axis}$" if letter == "phi" else literal(name)


def _norm(ax: Any, t: np.ndarray, values: np.ndarray, label: str) -> None:
    values = np.maximum(values, 1e-12)
    ax.semilogy(t, values, color="black", lw=0.8, label="norm")
    if len(values):
        ax.set_ylim(bottom=0.5 * np.quantile(values, 0.01))
    ax.set_ylabel(label)
    legend(ax)


_MOST_NAMED = 9  # with more curves, each body has one colour and each component one marker

_KINDS = {
    "mass [kg]": "m",
    "first moment [kg m]": "mc",
    "inertia [kg m$^2$]": "I",
    "rotor inertia [kg m$^2$ or kg]": "armature",
    "viscous [N m s or N s/m]": "viscous",
    "Coulomb [N m or N]": "coulomb",
}


class _Panel(NamedTuple):
    label: str
    values: np.ndarray
    truth: np.ndarray | None
    names: tuple[str, ...]


def parameter_figure(run: Drawable, dashed: str = "dashed: truth") -> Picture:
    """Return the figure of the estimates; more than nine dynamic ones get a panel for each kind.

    Those that the motion does not excite are grey.

    Args:
        run: the run.
        dashed: legend of the dashed lines, drawn at ``a_k_true`` and ``a_d_true``.
    """
    lumped = any("(" in name for name in run.kinematic_names)  # of a tracker or a camera
    kinematic = "kinematic" if lumped else "kinematic [m]"
    panels = [_Panel(kinematic, run.a_k, run.a_k_true, run.kinematic_names)]
    if run.a_d.shape[1] <= _MOST_NAMED:
        panels.append(_Panel("dynamic", run.a_d, run.a_d_true, run.dynamic_names))
    else:
        panels += _by_kind(run)
    panels = [panel for panel in panels if panel.values.shape[1]]
    count = max(len(panels), 1)
    figure = Picture(figsize=(9, 2.2 * count + 0.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(count, 1, sharex=True))
    for ax, panel in zip(axes, panels, strict=False):
        _draw(ax, run.t, panel, dashed, frozenset(run.not_excited))
    if not panels:
        axes[0].text(0.5, 0.5, "no parameter is unknown", ha="center", transform=axes[0].transAxes)
    finish(figure, axes, run)
    return figure


def _by_kind(run: Drawable) -> list[_Panel]:
    """Return a panel for each kind of parameter, and one for parameters of no known kind."""
    kinds = [_kind(name) for name in run.dynamic_names]
    panels = []
    for label in dict.fromkeys(kinds):
        columns = [i for i, kind in enumerate(kinds) if kind == label]
        truth = None if run.a_d_true is None else run.a_d_true[..., columns]
        names = tuple(run.dynamic_names[i] for i in columns)
        panels.append(_Panel(label, run.a_d[:, columns], truth, names))
    return panels


def _kind(name: str) -> str:
    part = name.rpartition(".")[2].partition("#")[0]
    for label, prefix in _KINDS.items():
        if part == prefix or part[:-1] == prefix or part[:-2] == prefix == "I":
            return label
    return "dynamic"


def _owner_and_part(name: str) -> tuple[str, str]:
    """Return to which body, joint or row of a lumped matrix a parameter belongs, and its part."""
    row, lumped, column = name.removesuffix(")").partition("(")
    if lumped:
        return row, column.rpartition("_")[0] or column
    owner, _, part = name.rpartition(".")
    return owner or name, part.lstrip("mcI")


def _draw(ax: Any, t: np.ndarray, panel: _Panel, dashed: str, still: frozenset[str]) -> None:
    """Draw the estimates of a panel, those that are not excited in grey, and true values dashed."""
    many = len(panel.names) > _MOST_NAMED
    owners, parts = (
        zip(*map(_owner_and_part, panel.names), strict=True) if panel.names else ((), ())
    )
    bodies, components = list(dict.fromkeys(owners)), list(dict.fromkeys(parts))
    greys = [name in still for name in panel.names]
    first = {owners[i]: i for i in sorted(range(len(owners)), key=lambda i: (not greys[i], -i))}
    for i, name in enumerate(panel.names):
        hue = bodies.index(owners[i]) if many else i
        marker = components.index(parts[i]) if many else i
        label = owners[i] if first[owners[i]] == i else None
        label = label if many else name.removesuffix(".m")
        shown = label and literal(label)
        curve(ax, t, panel.values[:, i], hue, marker, shown, grey=greys[i])
        if panel.truth is not None:
            true = np.broadcast_to(panel.truth[..., i], t.shape)
            tone = GREY if greys[i] else colour(hue)
            ax.plot(t, true, color=tone, ls="--", lw=0.7, alpha=0.7, drawstyle="steps-post")
    keys = [marker_key(k, part) for k, part in enumerate(components)] if many else []
    titles = [dashed] if panel.truth is not None else []
    titles += ["grey: not excited"] if any(greys) else []
    legend(ax, title="\n".join(titles) or None, more=keys)
    ax.set_ylabel(panel.label)


def torque_figure(run: Drawable) -> Picture:
    """Return the figure of motor torques, shares of the limits, disturbance, and an eigenvalue.

    The limits are those of the description. The disturbance is drawn where the law observes it,
    with what noise of the sensors explains, one standard deviation, as a band. The eigenvalue is
    the smallest of the estimated mass matrix. Shading marks a torque at its limit, and a damped
    inverse of the Jacobian.
    """
    bounds = run.effort_limits
    limited = np.flatnonzero(np.isfinite(bounds))
    count = 2 + (limited.size > 0) + (run.disturbance is not None)
    figure = Picture(figsize=(9, 1.0 + 2.3 * count), layout="constrained")
    axes = figure.subplots(count, 1, sharex=True)
    for i, name in enumerate(run.joint_names):
        curve(axes[0], run.t, run.tau[:, i], i, i, literal(name))
    axes[0].set_ylabel("torque [N m] or force [N]")
    shade(axes[0], run.t, run.saturated, RED, "at its limit")
    legend(axes[0], title="joint")
    if limited.size:
        for i in limited.tolist():
            share = 100.0 * run.tau[:, i] / bounds[i]
            curve(axes[1], run.t, share, i, i, literal(f"{run.joint_names[i]}: {bounds[i]:g}"))
        for limit in (-100.0, 100.0):
            axes[1].axhline(limit, color="black", ls="-.", lw=0.9)
        axes[1].set_ylabel("share of limit [%]")
        legend(axes[1], title="limit [N m or N]")
    if run.disturbance is not None:
        _disturbance(axes[-2], run, run.disturbance)
    _eigenvalue(axes[-1], run)
    finish(figure, axes, run)
    return figure


def _disturbance(ax: Any, run: Drawable, values: np.ndarray) -> None:
    """Draw the disturbance (N, nv), and what noise explains of it as a band around zero."""
    noise = run.disturbance_noise
    for i, name in enumerate(run.joint_names):
        curve(ax, run.t, values[:, i], i, i, literal(name))
        if noise is not None:
            band = noise[:, i]
            ax.fill_between(run.t, -band, band, color=colour(i), alpha=0.4, lw=0.0, zorder=3)
    ax.set_ylabel("disturbance [N m or N]")
    legend(ax, title=None if noise is None else "band: by noise")


def _eigenvalue(ax: Any, run: Drawable) -> None:
    ax.plot(run.t, run.min_eig_M_hat, color=GREEN, lw=0.9, label=r"of $\hat M$")
    ax.axhline(0.0, color="black", lw=0.6)
    ax.set_ylabel("smallest eigenvalue")
    shade(ax, run.t, run.damping > 0.0, BLUE, r"$\hat J$ damped")
    legend(ax)


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
    n = len(slides)
    columns = 1 if n <= _ONE_COLUMN else 2
    rows = -(-n // columns)
    figure = Picture(figsize=(5.5 * columns + 1.5, 1.7 * rows + 0.8), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True)).ravel()
    for j, (name, slide) in enumerate(slides.items()):
        ax = axes[j]
        ax.plot(t, tau[:, j], color="0.7", lw=3.0, label="measured")
        for k, (words, values) in enumerate(predicted.items()):
            curve(ax, t, values[:, j], len(predicted) - 1 - k, k, words)
        shade(ax, t, t >= split, RED, "held out")
        ax.set_title(literal(name), fontsize=8)
        ax.set_ylabel("N" if slide else "N m")
    for ax in axes[max(n - columns, 0) : n]:
        ax.set_xlabel("time [s]")
        ax.tick_params(labelbottom=True)
    for ax in axes[n:]:
        ax.set_visible(False)
    legend(axes[columns - 1])
    figure.suptitle(literal(f"{title}: torques, low-passed"), fontsize=10)
    return figure


def overlay_figure(runs: Sequence[Drawable]) -> Picture:
    """Return one figure with the error norms of several runs of one task, named by their laws.

    A panel for each group of rows. A run that diverged ends with a cross; it does not stretch the
    axis.
    """
    groups = runs[0].task.groups
    with matplotlib.rc_context(RC):
        figure = Picture(figsize=(9, 1.4 + 2.6 * len(groups)), layout="constrained")
        axes = np.atleast_1d(figure.subplots(len(groups), 1, sharex=True))
        for ax, group in zip(axes, groups, strict=True):
            _overlay(ax, runs, group)
        axes[-1].set_xlabel("time [s]")
        figure.suptitle(literal(f"{runs[0].title}: errors"), fontsize=10)
    return figure


def _overlay(ax: Any, runs: Sequence[Drawable], group: RowGroup) -> None:
    """Draw the error norm of each run in one panel."""
    unit, scale = group.shown
    norms = [
        np.maximum(scale * np.linalg.norm(run.error[:, group.rows], axis=1), 1e-12) for run in runs
    ]
    for i, (run, norm) in enumerate(zip(runs, norms, strict=True)):
        curve(ax, run.t, norm, i, i, literal(f"{run.law}, {run.adaptation}"))
        if run.diverged is not None and len(norm):
            ax.plot(run.t[-1], norm[-1], color=colour(i), marker="x", markersize=9, ls="")
    ax.set_yscale("log")
    ended = [n for run, n in zip(runs, norms, strict=True) if run.diverged is None and len(n)]
    if ended:
        low = min(float(np.quantile(norm, 0.01)) for norm in ended)
        ax.set_ylim(0.5 * low, 2.0 * max(float(norm.max()) for norm in ended))
    ax.set_ylabel(f"{_NORMS[group.name]} [{unit}]")
    legend(ax)


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

    def save(self, folder: Path) -> list[Path]:
        """Write ``error.png``, ``parameters.png``, ``torque.png`` into a folder; return paths.

        No file is left incomplete.
        """
        paths = []
        for name, figure in self._asdict().items():
            paths.append(folder / f"{name}.png")
            with whole_file(paths[-1]) as file:
                file.write(figure.png(dpi=130))
        return paths

    def _ipython_display_(self) -> None:
        """Display the figures one below the other."""
        from IPython.display import display  # installed where a notebook runs

        for figure in self:
            display({"image/png": figure.png()}, raw=True)


def draw_all(run: Drawable, folder: Path) -> list[Path]:
    """Write the figures of a run into a folder; return their paths."""
    return Figures.of(run).save(folder)
