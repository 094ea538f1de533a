"""The picture of the estimates."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .drawable import Drawable
from .picture import Picture
from .style import colour, curve, finish, legend, marker_key
from .words import literal

_MOST_NAMED = 9  # more curves than this share colours: one a body, and a marker a component

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
    """Return the estimates over time, the truth dashed; many dynamic parameters by kind.

    ``dashed`` says what else the dashed lines are.
    """
    panels = [_Panel("kinematic [m]", run.a_k, run.a_k_true, run.kinematic_names)]
    if run.a_d.shape[1] <= _MOST_NAMED:
        panels.append(_Panel("dynamic", run.a_d, run.a_d_true, run.dynamic_names))
    else:
        panels += _by_kind(run)
    panels = [panel for panel in panels if panel.values.shape[1]]
    count = max(len(panels), 1)
    figure = Picture(figsize=(9, 2.2 * count + 0.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(count, 1, sharex=True))
    for ax, panel in zip(axes, panels, strict=False):
        _draw(ax, run.t, panel, dashed)
    if not panels:
        axes[0].text(0.5, 0.5, "no parameter is unknown", ha="center", transform=axes[0].transAxes)
    finish(figure, axes, run)
    return figure


def _by_kind(run: Drawable) -> list[_Panel]:
    """Split the parameters of bodies and joints by what they are; what is left in one panel."""
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


def _draw(ax: Any, t: np.ndarray, panel: _Panel, dashed: str) -> None:
    """Draw the estimates of a panel, the truth dashed."""
    many = len(panel.names) > _MOST_NAMED
    owners = [name.rpartition(".")[0] or name for name in panel.names]
    parts = [name.rpartition(".")[2].lstrip("mcI") for name in panel.names]
    bodies, components = list(dict.fromkeys(owners)), list(dict.fromkeys(parts))
    for i, name in enumerate(panel.names):
        hue = bodies.index(owners[i]) if many else i
        marker = components.index(parts[i]) if many else i
        label = owners[i] if owners.index(owners[i]) == i else None
        label = label if many else name.removesuffix(".m")
        curve(ax, t, panel.values[:, i], hue, marker, label and literal(label))
        if panel.truth is not None:
            true = np.broadcast_to(panel.truth[..., i], t.shape)
            ax.plot(t, true, color=colour(hue), ls="--", lw=0.7, alpha=0.7, drawstyle="steps-post")
    keys = [marker_key(k, part) for k, part in enumerate(components)] if many else []
    legend(ax, title=None if panel.truth is None else dashed, more=keys)
    ax.set_ylabel(panel.label)
