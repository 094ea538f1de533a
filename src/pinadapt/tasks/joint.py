"""The joints themselves as the task."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .task import RowGroup, Task


@dataclass(frozen=True)
class JointTask(Task):
    """x = q, one number per joint [rad or m]; the Jacobian is I, no kinematic parameter is unknown.

    The error is that of ``pin.difference``. A continuous joint, which Pinocchio configures by (cos,
    sin), has its angle as coordinate, with any number of whole turns; its error is within half a
    turn. The task velocity is the joint velocity, so x and xd need no sensors of their own.

    Attributes:
        continuous: for each joint, whether it turns without limits.
    """

    continuous: tuple[bool, ...]

    @classmethod
    def of_chain(cls, model: pin.Model) -> JointTask:
        """Return the task of a chain whose joints have one degree of freedom each."""
        joints = model.joints[1:]
        return cls(
            "joint",
            tuple(str(name) for name in model.names[1:]),
            tuple(joint.nq == 2 for joint in joints),
        )

    @property
    def positions(self) -> int:
        """Zero: no row is a position of the frame."""
        return 0

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """One group: the joints."""
        return (RowGroup("joints", "rad", slice(0, self.size)),)

    def of(self, q: np.ndarray) -> np.ndarray:
        """Return the coordinates (m) of a configuration q (nq)."""
        if len(q) == self.size:
            return np.array(q, dtype=float)
        x, i = np.empty(self.size), 0
        for j, endless in enumerate(self.continuous):
            x[j] = math.atan2(q[i + 1], q[i]) if endless else q[i]
            i += 2 if endless else 1
        return x

    def at(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
        """Return the coordinates x (m) at configuration q (nq)."""
        return self.of(q)

    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x (m) and v (m) itself."""
        return self.of(q), np.array(v, dtype=float)

    def measured(self, x: np.ndarray | None, q: np.ndarray) -> np.ndarray:
        """Return the coordinates (m) of the measured q (nq); x is not used."""
        return self.of(q)

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx (m), within half a turn for continuous joints."""
        dx = x - x_d
        if any(self.continuous):
            for j, endless in enumerate(self.continuous):
                if endless and math.isfinite(dx[j]):
                    dx[j] = math.remainder(dx[j], 2.0 * math.pi)
        return np.asarray(dx)

    def errors(
        self,
        x: np.ndarray,
        x_d: np.ndarray,
        xd: np.ndarray | None,
        xd_hat: np.ndarray,
        xd_d: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, None]:
        """Return dx, xd_hat, which is the measured joint velocity, and None."""
        return self.error(x, x_d), xd_hat, None
