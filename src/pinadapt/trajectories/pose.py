"""Orientations, and poses: a position and an orientation that move together."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError
from ..records import Desired
from ..tasks.frame import matrix, rotation_between, turned
from .crawl import Crawl
from .given import TrajectoryLike, as_trajectory, converted
from .periodic import Circle, Sinusoid
from .trajectory import Hold, Trajectory

UPRIGHT = tuple(pin.Quaternion.Identity().coeffs().tolist())


class Swing(Trajectory):
    """R_d = R_0 exp(axis amplitude sin(w t + phase)), w = 2 pi / period, axis fixed in the tool.

    Attributes:
        axis: unit vector (3) in the tool's axes.
        amplitude, phase: [rad].
        period: [s].
        quaternion: R_0 as xyzw (4).
    """

    def __init__(
        self,
        axis: ArrayLike = (0.0, 0.0, 1.0),
        amplitude: float = 0.0,
        period: float = 3.0,
        phase: float = 0.0,
        quaternion: ArrayLike | None = None,
    ) -> None:
        """Take axis (3), amplitude and phase [rad], period [s], and R_0 as quaternion xyzw (4).

        The axis is in the tool's axes, of any length. Without R_0 the motion begins at the
        orientation that the robot has.

        Raises:
            InputError: numbers that are not finite or of the wrong size, a period that is not
                positive, an axis of length zero, or a quaternion that is not of length 1.
        """
        direction = vector(axis, 3, "orientation.axis", fills=False)
        if not direction.any():
            raise InputError("an axis needs a direction, got zeros.", where="orientation.axis")
        self.axis = direction / np.linalg.norm(direction)
        self.amplitude = positive(amplitude, "orientation.amplitude", zero=True)
        self.period = positive(period, "orientation.period")
        self.phase = float(vector(phase, 1, "orientation.phase")[0])
        self._angle = Sinusoid(0.0, self.amplitude, self.period, self.phase)
        self._unplaced = quaternion is None
        own = UPRIGHT if quaternion is None else quaternion
        self.quaternion = unit_quaternion(own, "orientation.quaternion")

    def at(self, t: float) -> Desired:
        """Return quaternion (4), angular velocity (3) and acceleration (3) at time t [s]."""
        angle, rate, acceleration = self._angle.at(t)
        axis = matrix(self.quaternion) @ self.axis  # constant in world axes
        return Desired(turned(self.quaternion, angle * axis), rate * axis, acceleration * axis)


class PoseTrajectory(Trajectory):
    """The desired motion of a pose task: a motion of three coordinates with any orientation.

    x_d is position and quaternion xyzw (7); velocity and acceleration are linear before angular
    (6). ``starting_at`` a pose displaces and turns the whole, so that neither a centre nor an
    orientation needs to be known beforehand. A function that returns the whole pose needs no
    PoseTrajectory, see ``as_trajectory``.

    Attributes:
        position: the motion of the position.
        orientation: the motion of the orientation.
    """

    def __init__(
        self,
        position: TrajectoryLike,
        orientation: TrajectoryLike | ArrayLike | None = UPRIGHT,
    ) -> None:
        """Take the motion of the position (3) and that of the orientation.

        Args:
            position: whatever ``as_trajectory`` takes, of three coordinates [m].
            orientation: a quaternion xyzw (4) to hold, None for that of the start; ``Swing``; or
                whatever ``as_trajectory`` takes, with quaternions as positions, and angular
                velocities [rad/s] and accelerations [rad/s^2] (3) in world axes.

        Raises:
            InputError: another number of coordinates, numbers that are not finite, or a quaternion
                that is not of length 1.
        """
        place = as_trajectory(position)
        size = place.at(0.0).x_d.size
        if size != 3:
            raise InputError(
                f"a pose needs a motion of 3 coordinates, got {size}.", where="trajectory"
            )
        self._take(place, Swing() if orientation is None else _orientation(orientation))

    def _take(self, place: Trajectory, turn: Trajectory) -> None:
        self.position = place
        self.orientation = turn
        self.extent = place.extent
        if place.settles is not None and turn.settles is not None:
            self.settles = max(place.settles, turn.settles)

    def placed(self, start: np.ndarray) -> Trajectory:
        """Return the motion whose parts without a place of their own begin at a pose (7)."""
        return self._of(self.position.placed(start[:3]), self.orientation.placed(start[3:]))

    def shifted(self, by: ArrayLike) -> PoseTrajectory:
        """Return the same motion displaced by by[:3] [m] and turned by by[3:] [rad], world axes."""
        by = vector(by, 6, "by", fills=False)
        return self._of(self.position.shifted(by[:3]), self.orientation.shifted(by[3:]))

    def _of(self, position: Trajectory, orientation: Trajectory) -> PoseTrajectory:
        other = copy(self)
        other._take(position, orientation)
        return other

    def at(self, t: float) -> Desired:
        """Return pose (7), velocity (6) and acceleration (6) at time t [s]."""
        place = self.position.at(t)
        turn = self.orientation.at(t)
        return Desired(*(np.concatenate(both) for both in zip(place, turn, strict=True)))


def placed_trajectory(
    given: TrajectoryLike, robot: Any, start: np.ndarray | None = None
) -> Trajectory:
    """Return a user's motion as ``as_trajectory``, placed where it has no place of its own.

    A ``Circle`` without a centre begins where the robot is; a motion of three coordinates holds
    the initial orientation in a pose task; a ``Crawl`` begins at the feet.

    Args:
        given: as in ``as_trajectory``.
        robot: the ``Robot``.
        start: coordinates at which it starts; None: those of the robot's home pose.

    Raises:
        InputError: as ``as_trajectory`` and ``Crawl.on``.
    """
    task = robot.task
    start = robot.position(robot.q0) if start is None else start
    if isinstance(given, Crawl):
        given = given.on(robot)
    if isinstance(given, Trajectory):
        exact = given.exact
        if task.coordinates == task.size + 1 and given.at(0.0).x_d.size == 3:
            given = PoseTrajectory(given, None)
        given = given.placed(start)
        given = given.as_given() if exact else given
    return as_trajectory(given, task)


class PoseCircle(PoseTrajectory):
    """A pose trajectory whose position is a circle, with the numbers of that circle.

    Attributes:
        radius: [m].
        period: of a turn [s].
        plane: the two world axes that span it.
        phase: angle at time 0, from the first of them [rad].
    """

    def __init__(self, position: Circle, orientation: TrajectoryLike | ArrayLike = UPRIGHT) -> None:
        """Take the circle (3 coordinates), and an orientation as in ``PoseTrajectory``.

        Raises:
            InputError: a circle in two coordinates, or a quaternion that is not of length 1.
        """
        super().__init__(position, orientation)
        self.radius = position.radius
        self.period = position.period
        self.plane = position.plane
        self.phase = position.phase


def unit_quaternion(value: ArrayLike, name: str) -> np.ndarray:
    """Return a quaternion xyzw (4), made exactly of unit length.

    Raises:
        InputError: not four finite numbers, or a length that differs from 1 by more than 1 %.
    """
    q = vector(value, 4, name, names=("x", "y", "z", "w"), fills=False)
    length = np.linalg.norm(q)
    if abs(length - 1.0) > 0.01:
        raise InputError(
            f"a quaternion xyzw of length 1 is expected, got length {length:.4g}.", where=name
        )
    return q / length


def _orientation(given: Any) -> Trajectory:
    """Return the motion of an orientation.

    Raises:
        InputError: it has not the sizes of one, is not finite, or starts at no unit quaternion.
    """
    if isinstance(given, list | tuple | np.ndarray) and np.ndim(given) == 1:
        return Hold(unit_quaternion(given, "orientation.quaternion")).with_rows(3)
    motion = converted(given, rotation_between, quaternion=True)
    start = as_trajectory(motion).at(0.0)
    unit_quaternion(start.x_d, "orientation")
    for rates in start[1:]:
        vector(rates, 3, "orientation", fills=False)
    return motion
