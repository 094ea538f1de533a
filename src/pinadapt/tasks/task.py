"""Which coordinates of a robot are controlled, and how far they are from the desired ones."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

Motion: TypeAlias = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Coordinates x and task velocity (m) of a chain at q (nq) and v (nv)."""


class RowGroup(NamedTuple):
    """Rows of the error that share a unit.

    Attributes:
        name: what they are together: "position", "rotation" or "joints".
        unit: "m" or "rad"; joint coordinates of slides are in metres all the same.
        rows: which rows.
    """

    name: str
    unit: str
    rows: slice


@dataclass(frozen=True)
class Task(ABC):
    """A choice of m coordinates x, with errors, velocities and accelerations of m rows each.

    Attributes:
        name: as written in scenarios.
        labels: one name a row of the error.
    """

    name: str
    labels: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of rows m of errors, velocities and Jacobians."""
        return len(self.labels)

    @property
    def coordinates(self) -> int:
        """How many numbers x has: m, but 7 for a pose."""
        return self.size

    @property
    @abstractmethod
    def positions(self) -> int:
        """How many rows, the first m_p, are positions of the frame, which translations move."""

    @property
    @abstractmethod
    def groups(self) -> tuple[RowGroup, ...]:
        """The rows by unit; the first group is what a run is judged by."""

    @abstractmethod
    def at(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
        """Return the coordinates x of a chain with this task frame at configuration q (nq)."""

    @abstractmethod
    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x and the task velocity (m) at q (nq) and v (nv)."""

    def motion_of(self, model: pin.Model, data: pin.Data, frame: int) -> Motion:
        """Return ``motion`` of one chain, whose data is scratch, as a function of q and v."""
        return partial(self.motion, model, data, frame)

    def measured(self, x: np.ndarray | None, q: np.ndarray) -> np.ndarray:
        """Return the coordinates x: the measured ones, or those that q (nq) tells by itself."""
        assert x is not None  # the controller refuses measurements without it
        return x

    def position(self, x: np.ndarray) -> np.ndarray:
        """Return the positions (m_p) among coordinates x or among a velocity."""
        return x[: self.positions]

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx (m), how far x is from x_d."""
        return x - x_d

    def drift(self, dx: np.ndarray, xd: np.ndarray, xd_d: np.ndarray) -> np.ndarray | None:
        """Return delta (m) = d(dx)/dt - (xd - xd_d), or None where it is always zero."""
        return None

    def known_velocity(self, xd: np.ndarray | None, xd_hat: np.ndarray) -> np.ndarray:
        """Return the velocity xd (m): measured, or xd_hat (m) where no sensor gives it."""
        return xd_hat if xd is None else xd

    def turn(self, x_hat: np.ndarray, x: np.ndarray) -> Any:
        """Return what turns the believed orientation into the seen one; None without any."""
        return None

    def turn_between(self, turn: Any, before: Any, share: float) -> Any:
        """Return a turn and an earlier one in one, with this share of the earlier."""
        return None

    def carried(self, x_hat: np.ndarray, epsilon: np.ndarray, turn: Any) -> np.ndarray:
        """Return the coordinates that are epsilon (m_p) and ``turn`` away from believed ones."""
        return x_hat - epsilon

    def moved(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the coordinates whose error from x is ``by`` (m)."""
        return x + by

    def flaw(self, x: np.ndarray) -> str | None:
        """Return what is wrong with finite coordinates x, or None."""
        return None


@dataclass(frozen=True)
class FrameTask(Task):
    """Coordinates of the task frame, in world axes.

    Attributes:
        rows: selected rows of the LOCAL_WORLD_ALIGNED Jacobian, linear before angular.
        place: selected rows of the frame's position.
    """

    rows: slice
    place: slice

    @abstractmethod
    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return the coordinates x of a frame's placement in the world."""

    @abstractmethod
    def velocity_of(self, motion: pin.Motion) -> np.ndarray:
        """Return the task velocity (m) of a frame's LOCAL_WORLD_ALIGNED motion."""

    def at(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
        """Return the coordinates x at configuration q (nq)."""
        pin.forwardKinematics(model, data, q)
        return self.of(pin.updateFramePlacement(model, data, frame))

    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x and the task velocity (m) at q (nq) and v (nv)."""
        pin.forwardKinematics(model, data, q, v)
        x = self.of(pin.updateFramePlacement(model, data, frame))
        return x, self.velocity_of(
            pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        )
