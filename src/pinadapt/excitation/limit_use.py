"""How close a planned motion comes to each limit of a description."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._table import Table
from ..robot.effort_limits import effort_limits
from ..robot.position_limits import position_limits
from ..robot.velocity_limits import velocity_limits
from .allowance import Allowance


@dataclass(frozen=True, eq=False)
class LimitUse:
    """Shares of the limits that a motion uses, 1 at a limit; zero where there is none.

    Attributes:
        joints: names (n).
        position: (n) of the way from the middle of a joint's range to its ends.
        velocity: (n).
        effort: (n) with and without the heaviest load.
        load: that one [kg], in the origin of the frame.
        clearance: least distance of a joint or the frame from the plane that the robot is mounted
            on [m], infinite where it moves along that plane.
    """

    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    load: float
    clearance: float

    @classmethod
    def of(
        cls, allowed: Allowance, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> LimitUse:
        """Return what N states of a motion use."""
        robot = allowed.robot
        lower, upper = position_limits(robot.model)
        limited = np.isfinite(lower)
        lower, upper = np.where(limited, lower, 0.0), np.where(limited, upper, 0.0)
        middle, half = 0.5 * (lower + upper), np.where(limited, 0.5 * (upper - lower), np.inf)
        efforts = np.abs(allowed.torques(q, v, a)).max(axis=(0, 1))
        return cls(
            tuple(robot.joint_names),
            np.abs(angles - middle).max(axis=0) / half,
            np.abs(v).max(axis=0) / velocity_limits(robot.model),
            efforts / effort_limits(robot),
            allowed.load,
            allowed.clearance(q),
        )

    def table(self) -> Table:
        """Return a row a joint, in per cent of each limit."""
        parts = zip(self.joints, self.position, self.velocity, self.effort, strict=True)
        rows = [
            (name, *(f"{share:.0%}" if share else "no limit" for share in use))
            for name, *use in parts
        ]
        return Table(rows, ("joint", "of position", "of velocity", "of effort limit"))
