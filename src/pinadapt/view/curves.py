"""What a page draws over time beside the scene: the error, and how far the estimates are off."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..controller.controller import Controller
from ..robot.succession import Succession
from ..tasks.task import RowGroup
from ..tasks.units import DISPLAYS


class Moment(NamedTuple):
    """What the curves are read from.

    Attributes:
        t: time [s].
        x, x_d: true and desired task coordinates.
        a_k, a_d: (p_k), (p_d) estimates.
    """

    t: float
    x: np.ndarray
    x_d: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray


@dataclass(frozen=True, eq=False)
class Curve:
    """One number over time.

    Attributes:
        label, unit: of the number.
        read: returns it at a moment.
    """

    label: str
    unit: str
    read: Callable[[Moment], float | None]

    def settings(self) -> dict[str, str]:
        """Return what the page needs to know."""
        return {"label": self.label, "unit": self.unit}


def curves_of(robots: Succession, controller: Controller) -> list[Curve]:
    """Return the curves of a loop: errors, and estimates where their truth is known."""
    task = robots.robots[0].task
    curves = [_error(task, group) for group in task.groups]
    truths = [controller.kinematics.value(robot) for robot in robots.robots]
    if controller.kinematics.size and all(truth is not None for truth in truths):
        curves.append(_translations(robots, truths))
    truths = [controller.dynamics.value(robot) for robot in robots.robots]
    if controller.dynamics.size and all(truth is not None for truth in truths):
        curves.append(_parameters(robots, truths, controller))
    return curves


def reading_of(curves: Sequence[Curve], moment: Moment) -> dict[str, Any]:
    """Return the numbers of a moment for the page; None for what is not finite."""
    values = [curve.read(moment) for curve in curves]
    finite = [v if v is not None and np.isfinite(v) else None for v in map(_rounded, values)]
    return {"t": round(float(moment.t), 4), "values": finite}


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _error(task: Any, group: RowGroup) -> Curve:
    shown = DISPLAYS[group.unit]

    def read(moment: Moment) -> float:
        return shown.scale * float(np.linalg.norm(task.error(moment.x, moment.x_d)[group.rows]))

    return Curve(f"{group.name} error", shown.unit, read)


def _translations(robots: Succession, truths: list[Any]) -> Curve:
    def read(moment: Moment) -> float:
        return 1e3 * float(np.linalg.norm(moment.a_k - truths[int(robots.index(moment.t))]))

    return Curve("tool and length estimates off by", "mm", read)


def _parameters(robots: Succession, truths: list[Any], controller: Controller) -> Curve:
    """Return the curve of the dynamic parameters' part of V, as a share of the first one read."""
    first: list[float] = []

    def read(moment: Moment) -> float | None:
        truth = truths[int(robots.index(moment.t))]
        left = controller.adaptation_d.divergence(moment.a_d, truth)
        if left is None:
            return None
        first.append(left)
        del first[1:]
        return 100.0 * left / first[0] if first[0] > 0.0 else None

    return Curve("dynamic estimates off by", "% of the start", read)
