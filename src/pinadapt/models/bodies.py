"""Unknown inertial parameters of whole bodies: ten a body, for all or some of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._checks import name_list
from ..robot.changes import joint_id
from ..robot.robot import Robot
from .inertial import InertialDynamics
from .pseudo_inertia import with_bodies
from .regressor import LABELS, PER_BODY, inertial_parameters

ALL, PAYLOAD, NONE = "all", "payload", "none"


def chosen_bodies(robot: Robot, unknown: str | Sequence[str]) -> list[int]:
    """Turn "all", "payload" (last body), "none" or joint names into indices of bodies, from 0.

    Raises:
        RobotError: unknown joint.
    """
    n = robot.model.nv
    known = {ALL: list(range(n)), PAYLOAD: [n - 1], NONE: []}
    if isinstance(unknown, str) and unknown in known:
        return known[unknown]
    names = name_list(unknown, "unknown.dynamic")
    return sorted(
        {joint_id(robot.model, name, "unknown.dynamic", (ALL, PAYLOAD, NONE)) - 1 for name in names}
    )


class BodyDynamics(InertialDynamics):
    """The ten inertial parameters [m, mc, I about the joint] of chosen bodies.

    Attributes:
        bodies: indices of the adapted bodies, from 0, in order.
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[str] = ALL) -> None:
        """Choose bodies: "all", "payload", "none" or the names of the joints that move them.

        Raises:
            RobotError: unknown joint.
        """
        super().__init__(robot)
        self.bodies = chosen_bodies(robot, unknown)
        self.names = tuple(
            f"{robot.joint_names[body]}.{label}" for body in self.bodies for label in LABELS
        )
        self.size = len(self.names)
        self._columns = np.concatenate(
            [[PER_BODY * b + i for i in range(PER_BODY)] for b in self.bodies] or [[]]
        ).astype(int)
        self._last = robot.model.nv - 1
        self._complete = self.size == PER_BODY * robot.model.nv
        self._placements = [placement.copy() for placement in robot.model.jointPlacements]
        self.initial = self._pi[self._columns].copy()

    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return pi (10 n): a_d for the adapted bodies, the believed parameters for the others."""
        if self._complete:
            return a_d
        pi = self._pi.copy()
        pi[self._columns] = a_d
        return pi

    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the columns of the adapted bodies (n, p)."""
        return Y if self._complete else Y[:, self._columns]

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the ten parameters of each adapted body; None when anything else differs."""
        pi, known = inertial_parameters(robot.model), np.ones(len(self._pi), dtype=bool)
        known[self._columns] = False
        same = np.allclose(pi[known], self._pi[known], rtol=1e-9, atol=1e-12)
        same = same and self.shares_the_rest(robot)
        pairs = list(zip(self._placements, robot.model.jointPlacements, strict=True))
        base, true_base = pairs[1]  # where it stands no torque tells, only how it is turned
        same = same and np.allclose(base.rotation, true_base.rotation, atol=1e-9)
        same = same and all(ours.isApprox(theirs, 1e-9) for ours, theirs in pairs[2:])
        return pi[self._columns] if same else None

    def robot(self, a_d: np.ndarray, believed: Robot) -> Robot:
        """Return the believed robot with the bodies that a_d (p) states.

        Raises:
            ParameterError: some are not physical.
        """
        return with_bodies(believed, dict(zip(self.bodies, a_d.reshape(-1, PER_BODY), strict=True)))

    def moved(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) with the described last body and its load in its last body.

        What was learned there may hold the load until now, announced or not, and goes with it.
        """
        described = self.value(after)
        if described is None or self._last not in self.bodies:
            return None if described is None else a_d.copy()
        return np.concatenate([a_d[:-PER_BODY], described[-PER_BODY:]])
