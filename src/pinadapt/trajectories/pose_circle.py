"""A circle with an orientation."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .circle import Circle
from .orientation import UPRIGHT, Orientation
from .pose_trajectory import PoseTrajectory


class PoseCircle(PoseTrajectory):
    """A pose trajectory whose position goes round a circle, with that circle's numbers."""

    position: Circle

    def __init__(self, position: Circle, orientation: Orientation | ArrayLike = UPRIGHT) -> None:
        """Take the circle (3 coordinates), and an orientation or a quaternion xyzw (4) to hold.

        Raises:
            InputError: a circle in two coordinates, or no unit quaternion.
        """
        super().__init__(position, orientation)

    @property
    def radius(self) -> float:
        """Radius [m]."""
        return self.position.radius

    @property
    def period(self) -> float:
        """Period of a turn [s]."""
        return self.position.period

    @property
    def plane(self) -> str:
        """The two world axes that span it."""
        return self.position.plane

    @property
    def phase(self) -> float:
        """Angle at time 0, from the first of them [rad]."""
        return self.position.phase
