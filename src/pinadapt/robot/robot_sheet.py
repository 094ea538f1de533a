"""A robot as its users read it: what is controlled, and the joints with their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._table import Sheet, Table
from .chain import is_slide
from .effort_limits import effort_limits
from .position_limits import position_limits
from .velocity_limits import velocity_limits

if TYPE_CHECKING:
    from .robot import Robot

_HEADER = ("joint", "home", "lower", "upper", "speed", "effort", "units")
_UNITS = ("rad, rad/s, N m", "m, m/s, N")
_SHOWN = 6  # names of other ends


def robot_sheet(robot: Robot) -> Sheet:
    """Return what a robot is, and its joints with home and limits; a dash where there is none."""
    words = [
        ("frame", robot.frame + (", its floating base welded" if robot.welded else "")),
        ("task", robot.task.name),
        ("moving mass", f"{robot.mass:.4g} kg"),
        ("reach", f"{robot.reach:.4g} m"),
    ]
    if robot.ends:
        words.append(("other ends", names_shown(robot.ends)))
    if robot.locked:
        words.append(("locked joints", names_shown(robot.locked)))
    joints = Table(_joint_rows(robot), _HEADER)
    return Sheet(f"{robot.name}, {robot.model.nv} joints", [Table(words), joints])


def names_shown(names: tuple[str, ...], shown: int = _SHOWN) -> str:
    """Return the first names, and how many more there are."""
    more = f" and {len(names) - shown} more" if len(names) > shown else ""
    return ", ".join(names[:shown]) + more


def _joint_rows(robot: Robot) -> list[tuple[str, ...]]:
    model = robot.model
    lower, upper = position_limits(model)
    columns = (robot.home_angles, lower, upper, velocity_limits(model), effort_limits(robot))
    numbers = np.column_stack(columns)
    return [
        (name, *map(_shown, row), _UNITS[is_slide(joint)])
        for name, row, joint in zip(robot.joint_names, numbers, model.joints[1:], strict=True)
    ]


def _shown(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"
