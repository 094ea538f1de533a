"""A position and an orientation, moving together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import instance, vector
from ..exceptions import InputError
from ..records import Desired
from .orientation import UPRIGHT, FixedOrientation, Orientation
from .trajectory import Trajectory


class PoseTrajectory(Trajectory):
    """The desired motion of a pose task: any trajectory of three coordinates with any orientation.

    x_d is position and quaternion xyzw (7); velocity and acceleration are linear before angular
    (6). ``starting_at`` a pose moves and turns the whole, so that neither a centre nor an
    orientation needs to be known beforehand.
    """

    def __init__(
        self, position: Trajectory, orientation: Orientation | ArrayLike = UPRIGHT
    ) -> None:
        """Take the motion of the position (3), and an orientation or a quaternion xyzw (4) to hold.

        Raises:
            InputError: a motion that has not three coordinates, or no unit quaternion.
        """
        size = instance(position, Trajectory, "reference").at(0.0).x_d.size
        if size != 3:
            raise InputError(
                f"a pose needs a motion of 3 coordinates, got {size}.", where="reference"
            )
        self.position = position
        self.orientation = (
            orientation if isinstance(orientation, Orientation) else FixedOrientation(orientation)
        )

    @property
    def extent(self) -> float | None:
        """That of the position [m]."""
        return self.position.extent

    @property
    def settles(self) -> float | None:
        """Time from which both rest [s], or None."""
        place, turn = self.position.settles, self.orientation.settles
        return None if place is None or turn is None else max(place, turn)

    def shifted(self, by: np.ndarray) -> PoseTrajectory:
        """Return the same motion moved by by[:3] [m] and turned by by[3:] [rad], world axes."""
        return type(self)(self.position.shifted(by[:3]), self.orientation.turned(by[3:]))

    def starting_at(self, start: np.ndarray) -> PoseTrajectory:
        """Return the same motion moved and turned to be at the pose ``start`` (7) at time 0."""
        start = vector(start, 7, "start")
        return type(self)(
            self.position.starting_at(start[:3]), self.orientation.starting_at(start[3:])
        )

    def at(self, t: float) -> Desired:
        """Return pose (7), velocity (6) and acceleration (6) at time t [s]."""
        place, turn = self.position.at(t), self.orientation.at(t)
        return Desired(*(np.concatenate(both) for both in zip(place, turn, strict=True)))
