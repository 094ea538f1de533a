"""Motor torques and constraint forces of which a torque that a law asks for is made."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .._checks import optional
from .._kernels import linear_algebra as kernels
from ..exceptions import DivergedError, RobotError
from ..models.typical_motion import joint_inertia
from ..robot.constraints import DEPENDENT, Constraints, Contact
from ..robot.motors import torque_bounds
from ..robot.robot import Robot

# weight of squared forces [m^2], for a unique choice; half or double: the torques change by 1e-6
_FORCES = 1e-4
# weight of a squared torque that is missed where there is no motor; half: twice is missed, 7e-6 of
# dV/dt on a1 in place of 4e-6; double: half; with twenty times the solver takes seconds
_SLACK = 1e5
# of the solver, which needs 2 to 10; a torque that is infeasible never reaches the tolerance, and
# forces are known to a thousandth of what is missed: half or twice change the time alone
_ITERATIONS = 50
_NONE = 1e20  # what the solver takes for no limit
# share of a torque, above which it is missed: feasible ones are missed by 2e-7, one beyond friction
# by half a percent by 4e-4; half or twice: the same samples of a1 and talos
_MISSED = 1e-5


class Missed(NamedTuple):
    """What neither motors nor constraint forces give of the torque that a law asks for.

    Attributes:
        size: its norm [N, N m]; zero where the torque is feasible.
        cause: the limit that counts most: "contact of" a foot, its friction, normal force or centre
            of pressure, or "effort of" a joint; empty where the torque is feasible.
    """

    size: float = 0.0
    cause: str = ""


FEASIBLE = Missed()


class Solution(NamedTuple):
    """Motor torques and constraint forces that make a wanted torque.

    Attributes:
        torque: (n) of the motors, zero where there is none [N m or N].
        forces: (k) of the rows of A [N or N m], zero of contacts in the air.
        missed: what they do not make.
    """

    torque: np.ndarray
    forces: np.ndarray
    missed: Missed


class ConstraintForces:
    """Motor torques tau and constraint forces f of a torque that a law asks for.

    min |tau|^2 + w |f|^2 subject to S^T tau + A^T f = torque, and to the chosen squeezes of what
    several arms hold. Forces of contacts stay in friction
    pyramids, unilateral, with the centre of pressure within the soles, and |tau| within the motors'
    limits. Rows without a motor, those of a free base, are kept by f alone, and where that is
    infeasible they are missed, by as little as possible, never a cone. Any such tau and f leave
    dV/dt as it is, since A s = 0.

    Attributes:
        constraints: of the robot.
    """

    def __init__(self, robot: Robot, constraints: Constraints | None = None) -> None:
        """Take a robot with constraints; ``constraints`` are these with the scratch to use.

        Raises:
            RobotError: the constraints leave a motion that no motor moves.
            InputError: the solver is not installed.
        """
        self.constraints = constraints or robot.constrained
        self._contacts = robot.contacts
        self._motors = np.flatnonzero(robot.motors)
        self._idle = np.flatnonzero(~robot.motors)
        self._names = [f"effort of {robot.joint_names[i]}" for i in self._motors]
        self._mobilities = 1.0 / joint_inertia(robot)
        A = self.constraints.jacobian(robot.q0)
        idle = A[:, self._idle]
        if np.linalg.matrix_rank(idle, tol=DEPENDENT * np.linalg.norm(idle)) < idle.shape[1]:
            raise RobotError(
                "the constraints leave a motion that no motor moves.",
                where="contacts" if self._contacts else "constraints",
                hint="A free base is held by one sole or three point feet, not in a line; joints "
                "without a motor by loops, or lock them.",
            )
        # what a sample does not change of the program: forces, and with a solver what is missed
        # where there is no motor
        k = len(A)
        rest = self._idle.size
        m = rest if self._contacts else 0
        squeezes = len(self.constraints.squeezes(k)[1])
        self._H = np.diag(np.repeat((_FORCES, _SLACK), (k, m)))
        self._equal = np.zeros((rest + squeezes, k + m))
        self._equal[:m, k:] = np.eye(m)
        if self._contacts:
            from scipy.linalg import block_diag  # here, because scipy is slow to import

            _solver()
            pyramids = [_pyramid(part) for part in self._contacts]
            cones = block_diag(*pyramids)
            first = k - cones.shape[1]  # the contacts come last
            borne = list[str]()
            self._cones = np.pad(cones, ((0, self._motors.size), (first, m)))
            self._soles = []  # and the first columns of their forces, and of their torques
            for number, (part, pyramid) in enumerate(zip(self._contacts, pyramids, strict=True)):
                borne += [f"contact of {part.frame}"] * len(pyramid)
                if part.sole is not None:
                    self._soles += [(number, first), (number, first + 3)]
                first += part.size
            self._names = borne + self._names

    def solve(
        self,
        q: np.ndarray,
        wanted: np.ndarray,
        stands: np.ndarray | None = None,
        disturbance: np.ndarray | None = None,
        limits: np.ndarray | None = None,
    ) -> Solution:
        """Return motor torques and constraint forces for a wanted torque (n).

        Args:
            q: (nq) configuration.
            wanted: (n) torque of the law [N m or N].
            stands: (c) which contacts bear a force, points all of them; None: all.
            disturbance: (n) what ``wanted`` is reduced by, known but for A^T f, see
                ``Constraints.free``. f is chosen such that joints take it up by their inertias: a
                push stays one on a heavy base, and the cones of its feet see it.
            limits: (n) of the motors [N m or N]; None: there are none.

        Raises:
            DivergedError: the wanted torque is not finite.
        """
        if not math.isfinite(wanted.dot(wanted)):
            raise DivergedError("the torque is no longer finite.")
        A = self.constraints.jacobian(q)
        holds = self.constraints.holding(stands)
        if stands is not None:  # no force of a foot in the air counts, so the least of all is none
            A = A * holds[:, None]
        if disturbance is not None:
            B = A * self._mobilities
            gram = B.dot(A.T)
            f = B.dot(disturbance)
            gram.flat[:: len(A) + 1] += ~holds
            if kernels.solve_definite(gram, f):
                wanted = wanted + f.dot(A)
        own = A.take(self._motors, axis=1).T
        idle = A.take(self._idle, axis=1).T
        asked = wanted[self._motors]
        most = np.minimum(torque_bounds(limits, wanted.size), _NONE)[self._motors]
        k = len(A)
        rest = len(idle)
        H = self._H.copy()
        g = np.zeros(len(self._H))
        equal = self._equal.copy()
        right = np.zeros(len(equal))
        H[:k, :k] += own.T.dot(own)
        g[:k] = -asked.dot(own)
        equal[:rest, :k] = idle
        right[:rest] = wanted[self._idle]
        if len(equal) > rest:
            equal[rest:, :k], right[rest:] = self.constraints.squeezes(k)
        if self._contacts:
            C = self._cones.copy()
            n = len(self._cones) - len(own)
            for sole, at in self._soles:  # stated in its axes
                axes = self.constraints.placements[sole].rotation
                C[:, at : at + 3] = C[:, at : at + 3].dot(axes.T)
            C[n:, :k] = own
            low = np.zeros(len(C))
            high = np.full(len(C), _NONE)
            low[n:] = asked - most
            high[n:] = asked + most
            solve = _solver().dense.solve
            found = solve(H, g, equal, right, C, low, high, eps_abs=1e-9, max_iter=_ITERATIONS)
            x = found.x
        else:
            KKT = np.block([[H, equal.T], [equal, np.zeros((len(equal), len(equal)))]])
            x = np.linalg.solve(KKT, np.append(-g, right))[:k]
        forces = x[:k]
        slack = x[k:]
        torque = np.zeros(wanted.size)
        needed = asked - own.dot(forces)
        torque[self._motors] = given = np.minimum(np.maximum(needed, -most), most)
        beyond = needed - given
        size = math.sqrt(slack.dot(slack) + beyond.dot(beyond))
        if not size > _MISSED * math.sqrt(wanted.dot(wanted)):
            return Solution(torque, forces, FEASIBLE)
        pressed = np.abs(beyond)
        if self._contacts:
            rows = C @ x
            pressed = np.abs(found.z) if found.z.any() else np.maximum(low - rows, rows - high)
        return Solution(torque, forces, Missed(size, self._names[int(pressed.argmax())]))

    def of_contacts(self, forces: np.ndarray) -> np.ndarray:
        """Return forces [N] and torques [N m] on the contacts' frames (c, 6), in world axes."""
        ends = np.cumsum([part.size for part in self.constraints.parts])
        own = np.split(forces, ends[:-1])[len(ends) - len(self._contacts) :]
        return np.reshape([np.pad(each, (0, 6 - each.size)) for each in own], (-1, 6))


def _solver() -> Any:
    """Return the solver of quadratic programs.

    Raises:
        InputError: it is not installed.
    """
    return optional("proxsuite", "contacts", "contacts").proxqp


def _pyramid(contact: Contact) -> np.ndarray:
    """Return the rows (., 3 or 6) that are positive for possible forces of a contact.

    Of a sole also those of its centre of pressure, and of the torque about its normal: friction at
    a quarter of the sum of half the length and half the width. That is a quarter to a third of what
    the corners bear by themselves, as they bear forces along the ground too.
    """
    mu = contact.friction / np.sqrt(2.0)  # the pyramid inside of the cone
    rows = np.zeros((11, 6))
    rows[:5, :3] = [[0, 0, 1], [-1, 0, mu], [1, 0, mu], [0, -1, mu], [0, 1, mu]]
    if contact.sole is None:
        return rows[:5, :3]
    length, width = contact.sole
    rows[5:, 2] = np.repeat([width, length, 0.25 * contact.friction * (length + width)], 2)
    rows[5::2, 3:] = -np.eye(3)
    rows[6::2, 3:] = np.eye(3)
    return rows
