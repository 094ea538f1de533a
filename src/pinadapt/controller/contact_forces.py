"""The choice of contact forces and motor torques of a robot that stands."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np

from ..exceptions import DivergedError, InputError, RobotError
from ..robot.contacts import Contact, ContactConstraints
from ..robot.robot import Robot

_FORCES = 1e-4  # weight of squared contact forces [m^2]; half or double: the torques are as small
# to 1 %, it only decides what no torque shows
_SLACK = 1e6  # weight of a squared torque of the base that is missed; half: misses twice as much of
# what is infeasible, double: the solver needs more iterations
_LEAST = 1e-9  # of the norm of the base's rows, of a singular value that counts
_NONE = 1e20  # what the solver takes for no limit


class ContactForces:
    """Motor torques tau and contact forces f of a torque that a law asks for.

    min |tau|^2 + w |f|^2 subject to S^T tau + A^T f = torque, f in friction pyramids, unilateral,
    the centre of pressure within the soles, |tau| within the motors' limits. The base has no
    motors: its rows are kept by f alone, and where that is infeasible they are missed, by as little
    as possible, never a cone. Any such tau and f leave dV/dt as it is, since A s = 0.

    Attributes:
        constraints: of the contacts.
    """

    def __init__(self, robot: Robot, limits: np.ndarray | None) -> None:
        """Take a robot with contacts, and limits of the torques (n) [N m or N] or None.

        Raises:
            RobotError: the contacts leave a motion of the base that no motor moves.
            InputError: the solver is not installed.
        """
        self.constraints = ContactConstraints(robot.model, robot.contacts)
        self._solver, self._motors = _solver(), robot.motors
        self._limits = None if limits is None else np.minimum(limits[self._motors], _NONE)
        A, _ = self.constraints.at(robot.q0, np.zeros(robot.model.nv))
        base = A[:, ~self._motors]
        if np.linalg.matrix_rank(base, tol=_LEAST * np.linalg.norm(base)) < base.shape[1]:
            raise RobotError(
                "the contacts do not hold the base: a motion of it is left that no motor moves.",
                where="contacts",
                hint="One sole or three point feet, not in a line, hold it.",
            )

    def torque(self, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return the torques (n), zero where there is no motor, for a wanted torque (n).

        Raises:
            DivergedError: the wanted torque is not finite.
        """
        if not np.isfinite(wanted).all():
            raise DivergedError("the torque is no longer finite.")
        motors, k = self._motors, len(self.constraints.at(q, np.zeros(q.size))[0])
        A = self.constraints.at(q, np.zeros(q.size))[0]
        free = np.flatnonzero(~motors)
        own, base = A[:, motors].T, A[:, free].T
        cones = np.concatenate([np.zeros((0, k)), *self._cones(k)])
        limits = np.full(len(own), _NONE) if self._limits is None else self._limits
        # unknown: forces, and what is missed of the base's rows
        H = np.zeros((k + free.size, k + free.size))
        H[:k, :k] = own.T @ own + _FORCES * np.eye(k)
        H[k:, k:] = _SLACK * np.eye(free.size)
        g = np.concatenate([-own.T @ wanted[motors], np.zeros(free.size)])
        equal = np.hstack([base, np.eye(free.size)])
        C = np.zeros((len(cones) + len(own), k + free.size))
        C[: len(cones), :k], C[len(cones) :, :k] = cones, own
        low = np.concatenate([np.zeros(len(cones)), wanted[motors] - limits])
        high = np.concatenate([np.full(len(cones), _NONE), wanted[motors] + limits])
        found = self._solver.dense.solve(H, g, equal, wanted[free], C, low, high, eps_abs=1e-9)
        torque = np.zeros(wanted.size)
        torque[motors] = np.clip(wanted[motors] - own @ found.x[:k], -limits, limits)
        return torque

    def _cones(self, k: int) -> Sequence[np.ndarray]:
        """Return the rows (., k) that are positive for possible forces: pyramids and soles."""
        rows, first = [], 0
        for contact, axes in zip(
            self.constraints.contacts, self.constraints.rotations(), strict=True
        ):
            own = np.zeros((len(_pyramid(contact)), k))
            turned = _pyramid(contact)
            if contact.sole is not None:  # stated in the axes of the sole
                turned = turned.copy()
                turned[:, :3], turned[:, 3:] = turned[:, :3] @ axes.T, turned[:, 3:] @ axes.T
            own[:, first : first + contact.rows] = turned
            rows.append(own)
            first += contact.rows
        return rows


def _pyramid(contact: Contact) -> np.ndarray:
    """Return the rows (., 3 or 6) that are positive for possible forces of a contact.

    Of a sole also those of its centre of pressure, and of the torque about its normal, bounded by
    friction at half of the mean half width.
    """
    mu = contact.friction / np.sqrt(2.0)  # the pyramid inside of the cone
    rows = [[0.0, 0.0, 1.0]]
    rows += [[sign * (i == 0), sign * (i == 1), mu] for i in (0, 1) for sign in (-1.0, 1.0)]
    if contact.sole is None:
        return np.array(rows)
    length, width = contact.sole
    rows = [[*row, 0.0, 0.0, 0.0] for row in rows]
    lever = 0.5 * contact.friction * 0.5 * (length + width)
    for i, half in enumerate((width, length, lever)):
        for sign in (-1.0, 1.0):
            rows.append([0.0, 0.0, half, *(sign * (j == i) for j in range(3))])
    return np.array(rows)


def _solver() -> ModuleType:
    """Return the module of the solver, imported at first use.

    Raises:
        InputError: it is not installed.
    """
    try:
        from proxsuite import proxqp
    except ImportError as error:
        raise InputError(
            "the solver of the contact forces, proxsuite, is not installed.",
            where="contacts",
            hint='Install it: pip install "pinadapt[contacts]".',
        ) from error
    return proxqp
