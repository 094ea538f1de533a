"""The picture of the motor torques."""

from __future__ import annotations

from typing import Any

import numpy as np

from .drawable import Drawable
from .picture import Picture
from .style import BLUE, GREEN, RED, curve, finish, legend, shade
from .words import literal


def torque_figure(run: Drawable) -> Picture:
    """Return the motor torques, their shares of the limits, and an eigenvalue.

    Limits are the description's, the eigenvalue is the smallest of the estimated mass matrix.
    Shaded where a torque is at its limit, and where the inverse Jacobian is damped.
    """
    bounds = run.effort_limits
    limited = np.flatnonzero(np.isfinite(bounds))
    count = 2 + (limited.size > 0)
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
    _eigenvalue(axes[-1], run)
    finish(figure, axes, run)
    return figure


def _eigenvalue(ax: Any, run: Drawable) -> None:
    ax.plot(run.t, run.min_eig_M_hat, color=GREEN, lw=0.9, label=r"of $\hat M$")
    ax.axhline(0.0, color="black", lw=0.6)
    ax.set_ylabel("smallest eigenvalue")
    shade(ax, run.t, run.damping > 0.0, BLUE, r"$\hat J$ damped")
    legend(ax)
