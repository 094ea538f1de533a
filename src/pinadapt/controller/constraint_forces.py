"""Motor torques and constraint forces of which a torque that a law asks for is made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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

    def torque(
        self,
        q: np.ndarray,
        wanted: np.ndarray,
        stands: np.ndarray | None = None,
        disturbance: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the torques (n), zero where there is no motor, for a wanted torque (n).

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
        motors, A = self._motors, self.constraints.at(q, np.zeros(wanted.size))[0]
        contacts = self._contacts
        if stands is not None:
            A = A[self.constraints.holding(stands)]
            contacts = [part for part, bears in zip(contacts, stands, strict=True) if bears]
        if disturbance is not None:
            H = A * self._mobilities
            wanted = wanted + A.T @ np.linalg.solve(H @ A.T, H @ disturbance)
        own, idle, asked = A[:, motors].T, A[:, ~motors].T, wanted[motors]
        k, m = len(A), len(idle)
        H, g = own.T @ own + _FORCES * np.eye(k), -own.T @ asked
        equal, right = self.constraints.squeezes(k)
        equal, right = np.vstack([idle, equal]), np.append(wanted[~motors], right)
        if self._solver is None:
            KKT = np.block([[H, equal.T], [equal, np.zeros((len(equal), len(equal)))]])
            f = np.linalg.solve(KKT, np.append(-g, right))[:k]
        else:  # with what is missed as further unknowns
            H = np.block([[H, np.zeros((k, m))], [np.zeros((m, k)), _SLACK * np.eye(m)]])
            g, equal = np.concatenate([g, np.zeros(m)]), np.hstack([equal, np.eye(len(equal), m)])
            cones = self._cones(contacts, k)
            C = np.zeros((len(cones) + len(own), k + m))
            C[: len(cones), :k], C[len(cones) :, :k] = cones, own
            low = np.concatenate([np.zeros(len(cones)), asked - self._limits])
            high = np.concatenate([np.full(len(cones), _NONE), asked + self._limits])
            solve = self._solver.dense.solve
            f = solve(H, g, equal, right, C, low, high, eps_abs=1e-9, max_iter=_ITERATIONS).x[:k]
        torque = np.zeros(wanted.size)
        torque[motors] = np.clip(asked - own @ f, -self._limits, self._limits)
        return torque

    def _cones(self, contacts: Sequence[Contact], k: int) -> np.ndarray:
        """Return the rows (., k) that are positive for possible forces of contacts.

        The contacts are the last of the constraints.
        """
        rows, first = [], k - sum(contact.size for contact in contacts)
        for contact in contacts:
            own, last = _pyramid(contact), first + contact.size
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
