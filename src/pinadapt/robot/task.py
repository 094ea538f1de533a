"""Which coordinates of the frame's motion are controlled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin


@dataclass(frozen=True)
class Task:
    """A choice of rows of the frame's position, in world axes; m coordinates, all of them lengths.

    The measured x and the desired x_d are these coordinates, velocities their derivatives. ``PoseTask`` adds the orientation.

    Attributes:
        name: as written in scenarios.
        labels: one name a row of the error.
        rows: selected rows of the LOCAL_WORLD_ALIGNED Jacobian, linear before angular.
        place: selected rows of the frame's position.
    """

    name: str
    labels: tuple[str, ...]
    rows: slice
    place: slice

    @property
    def size(self) -> int:
        """Number of rows m of errors, velocities and Jacobians."""
        return len(self.labels)

    @property
    def coordinates(self) -> int:
        """How many numbers x has: m, but 7 for a pose."""
        return self.size

    @property
    def positions(self) -> int:
        """How many of the m rows are positions: m, but 3 for a pose. They come first."""
        return self.size

    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return the coordinates x of a frame's placement in the world."""
        return np.array(placement.translation[self.place])

    def velocity_of(self, motion: pin.Motion) -> np.ndarray:
        """Return the task velocity (m) of a frame's LOCAL_WORLD_ALIGNED motion."""
        return np.array(motion.linear[self.place])

    def position(self, x: np.ndarray) -> np.ndarray:
        """Return the positions among coordinates x or among a velocity."""
        return x

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx (m), how far x is from x_d."""
        return x - x_d

    def drift(self, dx: np.ndarray, xd: np.ndarray, xd_d: np.ndarray) -> np.ndarray | None:
        """Return delta (m) = d(dx)/dt - (xd - xd_d), or None where it is always zero."""
        return None

    def known_velocity(self, xd: np.ndarray | None, xd_hat: np.ndarray) -> np.ndarray | None:
        """Return the measured task velocity xd (m) with the rows that the believed xd_hat (m) knows without a sensor."""
        return xd

    def moved(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the coordinates whose error from x is ``by`` (m)."""
        return x + by

    def flaw(self, x: np.ndarray) -> str | None:
        """Return what is wrong with finite coordinates x, or None."""
        return None
