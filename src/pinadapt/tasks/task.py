"""Which coordinates of a robot are controlled, and how far they are from the desired ones."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from ..description.chain import is_slide
from ..exceptions import InputError

Moving: TypeAlias = tuple[np.ndarray, np.ndarray]
"""A vector or matrix, and its rate."""


class Display(NamedTuple):
    """How a quantity is shown.

    Attributes:
        unit: written behind the number.
        scale: factor of the SI value.
    """

    unit: str
    scale: float


DISPLAYS = {"m": Display("mm", 1e3), "rad": Display("deg", 180.0 / math.pi)}
"""The units in which results are shown, by SI unit."""


class RowGroup(NamedTuple):
    """Rows of the error that share a unit.

    Attributes:
        name: what they are together: "position", "rotation", "slides", "joints" or "picture".
        unit: "m" or "rad".
        rows: which rows.
        display: how they are shown; None: as their unit.
    """

    name: str
    unit: str
    rows: Any
    display: Display | None = None

    @property
    def shown(self) -> Display:
        """How the rows are shown."""
        return self.display or DISPLAYS[self.unit]


@dataclass(frozen=True)
class Task(ABC):
    """The m coordinates x that are controlled, with errors, velocities and accelerations of m rows.

    Attributes:
        name: as written in scenarios.
        labels: a name for each row of the error.
        frames: names of several frames, each with its index in the model; empty: a single one.
    """

    name: str
    labels: tuple[str, ...]
    frames: dict[str, int] = field(default_factory=dict, kw_only=True)

    @property
    def size(self) -> int:
        """Number of rows m of errors, velocities and Jacobians."""
        return len(self.labels)

    @property
    def coordinates(self) -> int:
        """Number of coordinates x: m, but 7 for each pose."""
        return self.size

    @cached_property
    def levels(self) -> np.ndarray:
        """The place of each row (m) in the order of priority, from 0, as floats; all alike here."""
        return np.zeros(self.size)

    @property
    @abstractmethod
    def positions(self) -> int:
        """Number m_p of position rows, which come first; unknown translations affect these only."""

    @property
    def lengths(self) -> int:
        """Number of rows in metres, which come first: the positions, or a centre of mass."""
        return self.positions

    def per_row(self, length: float, angle: float) -> np.ndarray:
        """Return one number for each row (m): of rows in metres, and of all others."""
        return np.repeat([length, angle], [self.lengths, self.size - self.lengths])

    @property
    @abstractmethod
    def groups(self) -> tuple[RowGroup, ...]:
        """The rows by unit; the verdict on a run is about the first group."""

    def at(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
        """Return the coordinates x of a chain with this task frame at configuration q (nq)."""
        return self.motion(model, data, frame, q, np.zeros(model.nv))[0]

    @abstractmethod
    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> Moving:
        """Return the coordinates x and the task velocity (m) at q (nq) and v (nv)."""

    def measured(self, x: np.ndarray | None, q: np.ndarray) -> np.ndarray:
        """Return the coordinates x: the measured ones, or those that follow from q (nq) alone."""
        if x is None:
            raise InputError(
                "is missing; only the tasks 'joint' and 'com' do without it.", where="x"
            )
        return x

    def position(self, x: np.ndarray) -> np.ndarray:
        """Return the position rows (m_p) of coordinates x or of a velocity."""
        return x[: self.positions]

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return the error dx (m) of x from x_d."""
        return x - x_d

    def errors(
        self,
        x: np.ndarray,
        x_d: np.ndarray,
        xd: np.ndarray | None,
        xd_hat: np.ndarray,
        xd_d: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return the error dx, the task velocity xd, and delta = d(dx)/dt - (xd - xd_d), all (m).

        Args:
            x: coordinates.
            x_d: desired coordinates.
            xd: (m) measured velocity, of which the position rows are used, or None.
            xd_hat: (m) estimated velocity, taken where nothing is measured.
            xd_d: (m) desired velocity.

        Returns:
            dx, xd, and delta, which is None where it is always zero.
        """
        m = self.positions
        if xd is None:
            xd = xd_hat
        elif m < len(xd):
            xd = np.concatenate([xd[:m], xd_hat[m:]])
        dx = self.error(x, x_d)
        return dx, xd, self.drift(dx, xd_hat, xd_d)

    def drift(self, dx: np.ndarray, xd_hat: np.ndarray, xd_d: np.ndarray) -> np.ndarray | None:
        """Return delta (m) of ``errors`` at an error dx (m); None where it is always zero."""
        return None

    def turn(self, x_hat: np.ndarray, x: np.ndarray, before: Any = None, share: float = 0.0) -> Any:
        """Return the rotation from the estimated to the measured orientation; None without one.

        With another rotation ``before``, it is the one at this share of the way to that.
        """
        return None

    def carried(self, x_hat: np.ndarray, epsilon: np.ndarray, turn: Any) -> np.ndarray:
        """Return estimated coordinates corrected by an error epsilon (m_p) [m] and a rotation."""
        return x_hat - epsilon

    def moved(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the coordinates displaced from x by ``by`` (m), their error from x."""
        return x + by

    def flaw(self, x: np.ndarray) -> str | None:
        """Return what is wrong with finite coordinates x, or None."""
        return None


@dataclass(frozen=True)
class JointTask(Task):
    """x = q, one number per joint [rad or m], of all joints or of those that have motors.

    The Jacobian is I, or its rows of these joints; no kinematic parameter is unknown.

    The error is that of ``pin.difference``. A continuous joint, which Pinocchio configures by (cos,
    sin), has its angle as coordinate, with any number of whole turns; its error is within half a
    turn. The task velocity is the joint velocity, so x and xd need no sensors of their own.

    Attributes:
        continuous: for each joint, whether it turns without limits.
        places: where each begins in q.
        dofs: its place in v.
        slides: whether it is prismatic.
    """

    continuous: tuple[bool, ...]
    places: tuple[int, ...]
    dofs: tuple[int, ...]
    slides: tuple[bool, ...]

    positions = 0  # no row is a position of the frame

    @classmethod
    def of_joints(cls, model: pin.Model, chosen: np.ndarray | None = None) -> JointTask:
        """Return the task of all joints (n), one degree of freedom each, or of those chosen (n)."""
        rows = [
            (model.names[joint.id], joint.nq == 2, joint.idx_q, joint.idx_v, is_slide(joint))
            for joint in model.joints[1:]
            if chosen is None or chosen[joint.idx_v]
        ]
        return cls("joint", *zip(*rows, strict=True))

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """The slides, and the joints that turn, where there are any."""
        rows = np.flatnonzero(self.slides), np.flatnonzero(np.logical_not(self.slides))
        groups = RowGroup("slides", "m", rows[0]), RowGroup("joints", "rad", rows[1])
        return tuple(group for group in groups if group.rows.size)

    def per_row(self, length: float, angle: float) -> np.ndarray:
        """Return one number for each row (m): of slides, and of joints that turn."""
        return np.where(self.slides, length, angle)

    def of(self, q: np.ndarray) -> np.ndarray:
        """Return the coordinates (m) of a configuration q (nq)."""
        if len(q) == self.size:
            return np.array(q, dtype=float)
        places = zip(self.places, self.continuous, strict=True)
        return np.array([math.atan2(q[i + 1], q[i]) if endless else q[i] for i, endless in places])

    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> Moving:
        """Return the coordinates x (m) and their velocity (m)."""
        return self.of(q), v[list(self.dofs)]

    def measured(self, x: np.ndarray | None, q: np.ndarray) -> np.ndarray:
        """Return the coordinates (m) of the measured q (nq); x is not used."""
        return self.of(q)

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx (m), within half a turn for continuous joints."""
        dx = x - x_d
        for j, endless in enumerate(self.continuous):
            if endless and math.isfinite(dx[j]):
                dx[j] = math.remainder(dx[j], 2.0 * math.pi)
        return dx
