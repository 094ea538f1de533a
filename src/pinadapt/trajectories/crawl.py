"""A crawl: one foot of a standing robot moves at a time, the trunk over the others before."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive, vector, whole
from ..exceptions import InputError
from ..records import Desired, DesiredSteps, Feet
from .trajectory import Piecewise, Trajectory, moves

# of the largest possible distance to the edges of the triangle of support; half and twice: an A1
# with 6 kg that nobody announced crawls with the same error of the trunk, and its motors give 16
# and 25 N m in place of 16
_MARGIN = 0.5


class Crawl(Trajectory):
    """The pose of the trunk, and the motion of the feet.

    A step has two parts of minimum jerk: the trunk moves until the centre of mass of the described
    robot is above the triangle of the feet that will stand, then one foot moves while the trunk
    rests. The order is that of animals which walk slowly, each hind foot before the fore foot of
    its side. The trunk keeps height and orientation.

    Attributes:
        steps: how many.
        shift, swing: durations of the parts [s].
        length, height: of a step [m].
    """

    exact = True
    _start: np.ndarray
    _order: list[int]
    _plan: Any = None  # a ``Piecewise`` of trunk and feet

    def __init__(
        self,
        steps: int = 12,
        length: float = 0.06,
        height: float = 0.04,
        shift: float = 0.6,
        swing: float = 0.4,
    ) -> None:
        """Take the steps; ``on`` a robot they begin at its home pose.

        Args:
            steps: how many.
            length: of a step, along the axis x of the world; negative: backwards [m].
            height: by which a foot is lifted [m].
            shift: time for the trunk before each step [s].
            swing: time for the foot [s].

        Raises:
            InputError: numbers that are not finite, or not positive.
        """
        self.steps = whole(steps, "steps", 1)
        self.height = positive(height, "height")
        self.length = float(vector(length, 1, "length")[0])
        self.shift = positive(shift, "shift")
        self.swing = positive(swing, "swing")
        self.settles = self.steps * (self.shift + self.swing) + self.shift

    def on(self, robot: Any) -> Crawl:
        """Return the crawl of a robot that stands on four point feet, its task the trunk's pose.

        Raises:
            InputError: a robot with other contacts or another task.
        """
        contacts = robot.contacts
        if len(contacts) != 4 or any(contact.sole is not None for contact in contacts):
            raise InputError("a crawl is for four point feet.", where="robot.contacts")
        if robot.task.coordinates != 7:
            raise InputError("a crawl needs the pose of the trunk as task.", where="robot.task")
        planned = copy(self)
        constraints = robot.constrained
        model = robot.model
        constraints.jacobian(robot.q0)
        feet = constraints.feet
        planned._start = start = robot.position(robot.q0)
        com = pin.centerOfMass(model, model.createData(), robot.q0)
        offset = com[:2] - start[:2]
        order = _order(feet[:, :2])
        planned._order = [order[i % 4] for i in range(self.steps)]
        ends = [np.append(start[:3], feet)]  # trunk and feet (15) at the ends of all parts
        middle = feet.mean(axis=0)
        rise = np.zeros((2 * self.steps + 1, 15))
        for k, foot in enumerate(planned._order):
            rise[2 * k + 1, 5 + 3 * foot] = self.height
            above = np.append(_inside(np.delete(feet[:, :2], foot, axis=0)) - offset, start[2])
            ends.append(np.append(above, feet))
            feet[foot, 0] += self.length
            ends.append(np.append(above, feet))
        ends.append(np.append(start[:3] + feet.mean(axis=0) - middle, feet))
        x = np.array(ends)
        T = np.append(np.tile([self.shift, self.swing], self.steps), self.shift)
        t = np.append(0.0, np.cumsum(T))
        planned._plan = Piecewise(t, x, moves(x, t, rise))
        return planned

    def shifted(self, by: ArrayLike) -> Trajectory:
        """Refuse: the steps begin where the robot stands.

        Raises:
            InputError: always.
        """
        raise InputError("a crawl begins at the robot's home pose.", where="trajectory")

    @property
    def footholds(self) -> np.ndarray:
        """Where the feet stand after each step, and at first (steps + 1, 4, 3) [m]."""
        return np.reshape(self._plan.x[::2, 3:], (-1, 4, 3))

    def at(self, t: float) -> Desired:
        """Return the pose of the trunk and the motion of the feet at time t [s].

        Raises:
            InputError: it is on no robot yet.
        """
        if self._plan is None:
            raise InputError("give it a robot first, by on(robot).", where="trajectory")
        period = self.shift + self.swing
        k = min(int(max(t, 0.0) / period), self.steps)
        stands = np.ones(4, dtype=bool)
        if k < self.steps and t - k * period > self.shift:
            stands[self._order[k]] = False
        planned = self._plan.at(t)
        turns = (self._start[3:], np.zeros(3), np.zeros(3))
        feet = Feet(stands, *(each[3:].reshape(4, 3) for each in planned))
        trunk = (np.append(each[:3], turn) for each, turn in zip(planned, turns, strict=True))
        return DesiredSteps.of(Desired(*trunk), feet)


def _order(feet: np.ndarray) -> list[int]:
    """Return the feet (4, 2) in the order of a crawl: hind, then fore, of one side and the other.

    The fore ones are those with the largest x.
    """
    side = feet[:, 1] > feet[:, 1].mean()
    return np.lexsort((feet[:, 0], side)).tolist()


def _inside(triangle: np.ndarray) -> np.ndarray:
    """Return the point (2) on the way from the middle of the longest edge to the incentre (3, 2).

    The incentre has the largest distance from the edges.
    """
    edges = [np.linalg.norm(triangle[i - 1] - triangle[i - 2]) for i in range(3)]
    incentre = np.average(triangle, axis=0, weights=edges)
    middle = np.delete(triangle, np.argmax(edges), axis=0).mean(axis=0)
    return middle + _MARGIN * (incentre - middle)
