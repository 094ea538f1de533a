"""By how much a motion exceeds the limits of the robot's description."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import ROUNDING
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..robot.robot import Robot
from ..tasks.task import DISPLAYS

KINDS = ("position", "velocity", "effort")


@dataclass(frozen=True, eq=False)
class LimitExcess:
    """By how much joints exceed the limits of the description; ``print`` says it in a line.

    Attributes:
        slides: name of each joint -> whether it is prismatic.
        stated: whether the description states any limit.
        excess: (nv, 3) largest excess of each joint of the true robot: position [rad or m],
            velocity [rad/s or m/s], effort [N m or N]; zero within the limit or without one.
    """

    slides: dict[str, bool]
    stated: bool
    excess: np.ndarray

    @classmethod
    def of(cls, robot: Robot, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> LimitExcess:
        """Compare a motion with the limits of a robot's description.

        Args:
            robot: read only.
            q: (N, nv) positions of the joints [rad or m].
            v: (N, nv) velocities [rad/s or m/s].
            tau: (N, nv) torques [N m or N].
        """
        model = robot.model
        lower, upper = position_limits(model)
        speed = velocity_limits(model)
        effort = effort_limits(model)
        with np.errstate(invalid="ignore"):  # inf - inf is no excess
            outside = np.maximum(q - upper, lower - q)
            beyond = np.array([outside, np.abs(v) - speed, np.abs(tau) - effort])
        counts = np.isfinite(beyond) & (beyond > ROUNDING)
        excess = np.where(counts, beyond, 0.0).max(axis=1, initial=0.0).T
        return cls(robot.slides, bool(np.isfinite([upper, speed, effort]).any()), excess)

    @property
    def exceeded(self) -> bool:
        """Whether any joint exceeds a limit."""
        return bool(self.excess.any())

    def summary(self) -> dict[str, Any]:
        """Return the largest excess, by joint and kind of limit."""
        return {
            joint: dict(zip(KINDS, row, strict=True))
            for joint, row in zip(self.slides, self.excess.tolist(), strict=True)
        }

    def __str__(self) -> str:
        """Return in one line which joints exceed which limit by how much, the first three."""
        if not self.exceeded:
            return "joint limits kept" if self.stated else ""
        found = []
        for (joint, slide), row in zip(self.slides.items(), self.excess, strict=True):
            unit, scale = DISPLAYS["m" if slide else "rad"]
            units = (unit, f"{unit}/s", "N" if slide else "N m")
            for kind, value, unit in zip(KINDS, row * [scale, scale, 1.0], units, strict=True):
                if value:
                    found.append(f"{joint} {kind} by {value:.4g} {unit}")
        more = f" and {len(found) - 3} more" if len(found) > 3 else ""
        return f"beyond limits: {', '.join(found[:3])}{more}"
