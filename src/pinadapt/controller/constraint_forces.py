"""Motor torques and constraint forces of which a torque that a law asks for is made."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import optional
from ..exceptions import DivergedError, RobotError
from ..robot.constraints import Contact
from ..robot.robot import Robot

# weight of squared forces [m^2], for a unique choice; half or double: the torques change by 1e-6
_FORCES = 1e-4
# weight of a squared torque that is missed where there is no motor; half: twice is missed, 7e-6 of
# dV/dt on a1 in place of 4e-6; double: half; with twenty times the solver takes seconds
_SLACK = 1e5
# of the solver, which needs 2 to 10; a torque that is infeasible never reaches the tolerance, and
# forces are known to a thousandth of what is missed: half or twice change the time alone
_ITERATIONS = 50
_LEAST = 1e-9  # of the norm of the rows without motors, of a singular value that counts
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

    def __init__(self, robot: Robot, limits: np.ndarray | None) -> None:
        """Take a robot with constraints, and limits of the torques (n) [N m or N] or None.

        Raises:
            RobotError: the constraints leave a motion that no motor moves.
            InputError: the solver is not installed.
        """
        self.constraints, self._motors = robot.constrained, robot.motors
        self._contacts = [part for part in robot.constraints if isinstance(part, Contact)]
        self._pyramids = [_pyramid(part) for part in self._contacts]
        self._efforts = [f"effort of {name}" for name in np.array(robot.joint_names)[self._motors]]
        self._solver: Any = None
        if self._contacts:
            self._solver = optional("proxsuite", "contacts", "contacts").proxqp
        self._limits = np.full(int(self._motors.sum()), _NONE)
        if limits is not None:
            self._limits = np.minimum(limits[self._motors], _NONE)
        M = pin.crba(robot.model, robot.model.createData(), robot.q0)
        self._mobilities = 1.0 / np.diag(M)
        A, _ = self.constraints.at(robot.q0, np.zeros(robot.model.nv))
        idle = A[:, ~self._motors]
        if np.linalg.matrix_rank(idle, tol=_LEAST * np.linalg.norm(idle)) < idle.shape[1]:
            raise RobotError(
                "the constraints leave a motion that no motor moves.",
                where="contacts" if self._contacts else "constraints",
                hint="A free base is held by one sole or three point feet, not in a line; joints "
                "without a motor by loops, or lock them.",
            )

    def solve(
        self,
        q: np.ndarray,
        wanted: np.ndarray,
        stands: np.ndarray | None = None,
        disturbance: np.ndarray | None = None,
    ) -> Solution:
        """Return motor torques and constraint forces for a wanted torque (n).

        Args:
            q: (nq) configuration.
            wanted: (n) torque of the law [N m or N].
            stands: (c) which contacts bear a force, points all of them; None: all.
            disturbance: (n) what ``wanted`` is reduced by, known but for A^T f, see
                ``Constraints.free``. f is chosen such that joints take it up by their inertias: a
                push stays one on a heavy base, and the cones of its feet see it.

        Raises:
            DivergedError: the wanted torque is not finite.
        """
        if not np.isfinite(wanted).all():
            raise DivergedError("the torque is no longer finite.")
        motors, every = self._motors, self.constraints.at(q, np.zeros(wanted.size))[0]
        kept = self.constraints.holding(stands)
        A = every[kept]
        if disturbance is not None:
            H = A * self._mobilities
            wanted = wanted + A.T @ np.linalg.solve(H @ A.T, H @ disturbance)
        own, idle, asked = A[:, motors].T, A[:, ~motors].T, wanted[motors]
        chosen, squeezes = self.constraints.squeezes(len(A))
        # forces, and with a solver what is missed where there is no motor
        k, m, rest = len(A), 0 if self._solver is None else len(idle), len(idle)
        H = np.diag(np.repeat((_FORCES, _SLACK), (k, m)))
        g, equal = np.zeros(k + m), np.zeros((rest + len(chosen), k + m))
        H[:k, :k] += own.T @ own
        g[:k] = -asked @ own
        equal[:rest, :k], equal[rest:, :k], equal[:m, k:] = idle, chosen, np.eye(m)
        right = np.concatenate([wanted[~motors], squeezes])
        if self._solver is None:
            KKT = np.block([[H, equal.T], [equal, np.zeros((len(equal), len(equal)))]])
            x = np.linalg.solve(KKT, np.append(-g, right))[:k]
        else:
            cones = self._cones(len(every))[:, kept]
            n = len(cones)
            C, low = np.zeros((n + len(own), k + m)), np.zeros(n + len(own))
            high = np.full(n + len(own), _NONE)
            C[:n, :k], C[n:, :k] = cones, own
            low[n:], high[n:] = asked - self._limits, asked + self._limits
            solve = self._solver.dense.solve
            found = solve(H, g, equal, right, C, low, high, eps_abs=1e-9, max_iter=_ITERATIONS)
            x = found.x
        needed, torque, forces = asked - own @ x[:k], np.zeros(wanted.size), np.zeros(len(every))
        torque[motors] = given = np.minimum(np.maximum(needed, -self._limits), self._limits)
        forces[kept], beyond, slack = x[:k], needed - given, x[k:]
        size = math.sqrt(slack.dot(slack) + beyond.dot(beyond))
        if not size > _MISSED * math.sqrt(wanted.dot(wanted)):
            return Solution(torque, forces, Missed())
        pressed, names = np.abs(beyond), self._efforts
        if self._solver is not None:
            at = C @ x
            pressed = np.abs(found.z) if found.z.any() else np.maximum(low - at, at - high)
            pyramids = zip(self._contacts, self._pyramids, strict=True)
            names = [f"contact of {part.frame}" for part, rows in pyramids for _ in rows] + names
        return Solution(torque, forces, Missed(size, names[int(pressed.argmax())]))

    def of_contacts(self, forces: np.ndarray) -> np.ndarray:
        """Return forces [N] and torques [N m] on the contacts' frames (c, 6), in world axes."""
        ends = np.cumsum([part.size for part in self.constraints.parts])
        own = np.split(forces, ends[:-1])[len(ends) - len(self._contacts) :]
        return np.reshape([np.pad(each, (0, 6 - each.size)) for each in own], (-1, 6))

    def _cones(self, k: int) -> np.ndarray:
        """Return the rows (., k) that are positive for possible forces of contacts.

        The contacts are the last of the constraints.
        """
        rows, first = [], k - sum(contact.size for contact in self._contacts)
        for contact, own in zip(self._contacts, self._pyramids, strict=True):
            last = first + contact.size
            if contact.sole is not None:  # stated in the axes of the sole
                own = own @ np.kron(np.eye(2), self.constraints.axes(contact).T)
            rows.append(np.zeros((len(own), k)))
            rows[-1][:, first:last], first = own, last
        return np.concatenate(rows)


def _pyramid(contact: Contact) -> np.ndarray:
    """Return the rows (., 3 or 6) that are positive for possible forces of a contact.

    Of a sole also those of its centre of pressure, and of the torque about its normal: friction at
    a quarter of the sum of half the length and half the width. That is a quarter to a third of what
    the corners bear by themselves, as they bear forces along the ground too.
    """
    mu = contact.friction / np.sqrt(2.0)  # the pyramid inside of the cone
    rows = [[0.0, 0.0, 1.0]]
    rows += [[sign * (i == 0), sign * (i == 1), mu] for i in (0, 1) for sign in (-1.0, 1.0)]
    if contact.sole is None:
        return np.array(rows)
    length, width = contact.sole
    rows = [[*row, 0.0, 0.0, 0.0] for row in rows]
    lever = 0.25 * contact.friction * (length + width)
    for i, half in enumerate((width, length, lever)):
        rows += [[0.0, 0.0, half, *(sign * (j == i) for j in range(3))] for sign in (-1.0, 1.0)]
    return np.array(rows)
