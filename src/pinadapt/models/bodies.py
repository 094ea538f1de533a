"""Dynamics in the inertial parameters of bodies, ten per body, and their pseudo-inertias."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from .._checks import name_list
from ..description.chain import is_physical
from ..description.floating_base import BASE_JOINTS
from ..exceptions import ParameterError
from ..robot.changes import joint_id
from ..robot.robot import Robot
from .dynamics import Dynamics
from .regressor import LABELS, PER_BODY, UNITS, inertial_parameters

# a body's least radius over the distance of its centre of mass from the joint; half, twice: the
# same
_VISIBLE = 1e-4


ALL, PAYLOAD, NONE = "all", "payload", "none"


def chosen_bodies(robot: Robot, unknown: str | Sequence[str]) -> list[int]:
    """Return the indices, from 0, of the bodies that a user's words name.

    Args:
        robot: with the bodies.
        unknown: "all", "payload" (the bodies of the task frames), "none", or names of the joints
            that move them.

    Raises:
        RobotError: unknown joint.
    """
    every = [i for i, name in enumerate(robot.joint_names) if name not in BASE_JOINTS[:-1]]
    known = {ALL: every, PAYLOAD: robot.carriers, NONE: []}
    if isinstance(unknown, str) and unknown in known:
        return known[unknown]
    return sorted(
        {
            joint_id(robot.model, name, "unknown.bodies", tuple(known)) - 1
            for name in name_list(unknown, "unknown.bodies")
        }
    )


class BodyDynamics(Dynamics):
    """Dynamics in the ten inertial parameters [m, mc, I about the joint] of chosen bodies.

    Attributes:
        bodies: indices of the adapted bodies, from 0, ascending.
    """

    per_body = True

    def __init__(self, robot: Robot, unknown: str | Sequence[str] = ALL) -> None:
        """Choose bodies: "all", "payload", "none" or the names of the joints that move them.

        Raises:
            RobotError: unknown joint.
        """
        self.bodies = chosen_bodies(robot, unknown)
        pi = inertial_parameters(robot.model)
        own = np.repeat(np.isin(np.arange(robot.model.nv), self.bodies), PER_BODY)
        if own.all():
            super().__init__(robot)
        else:
            super().__init__(robot, np.eye(pi.size)[:, own], np.where(own, 0.0, pi))
        self.initial = pi[own]
        names = robot.joint_names
        self.names = tuple(f"{names[body]}.{label}" for body in self.bodies for label in LABELS)
        self.units = UNITS * len(self.bodies)

    def values(self, robot: Robot, inertial: np.ndarray, lengths: np.ndarray) -> np.ndarray | None:
        """Return the ten parameters of each adapted body (N, p): those given."""
        return inertial.reshape(-1, self.size)

    def robot(self, a_d: np.ndarray, nominal: Robot) -> Robot:
        """Return the nominal robot with the bodies of the parameters a_d (p).

        Raises:
            ParameterError: some of the bodies are not physical.
        """
        names = [nominal.joint_names[body] for body in self.bodies]
        if unphysical := unphysical_bodies(a_d, names):
            raise ParameterError(
                f"the bodies moved by {unphysical} have inertias that no mass distribution has.",
                where="learned",
                hint='Adaptation "natural" keeps bodies physical; "gradient" does not.',
            )
        return self._moving(nominal, a_d.reshape(-1, PER_BODY))

    def with_load(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) in which the body of each frame is the nominal one with the load.

        The estimate of that body is replaced, because it may contain the previous load.
        """
        described = self.value(after)
        loaded = np.repeat(np.isin(self.bodies, after.carriers), PER_BODY)
        return None if described is None else np.where(loaded, described, a_d)


# The pseudo-inertia of a body, a matrix linear in its ten parameters:
# P = [[Sigma, mc], [mc^T, m]], Sigma = tr(I)/2 1 - I. A body is physical, so that a mass
# distribution has its parameters, if and only if P is positive definite (Wensing, Kim, Slotine
# 2018).


# as far as a described body may be off, in the metric of natural adaptation; half: errors of a UR10
# a fifth smaller, of a Panda a tenth larger; twice: 1.7 times and 0.8 times
UNCERTAINTY = 0.3


def pseudo_inertia(pi: np.ndarray) -> np.ndarray:
    """Return P (4, 4) of the ten parameters pi (10) of a body."""
    return pin.PseudoInertia.FromDynamicParameters(pi).toMatrix()


COEFFICIENTS = np.array([pseudo_inertia(one) for one in np.eye(PER_BODY)])  # P = sum_i pi_i F_i
COLUMNS = COEFFICIENTS.reshape(PER_BODY, -1)  # the same with P row by row (16)
_FROM_MATRIX = np.linalg.pinv(COLUMNS)


def from_pseudo_inertia(P: np.ndarray) -> np.ndarray:
    """Return the ten parameters (..., 10) of bodies with pseudo-inertias P (..., 4, 4)."""
    return P.reshape(*P.shape[:-2], -1) @ _FROM_MATRIX


def nearest_physical(
    pi: np.ndarray, *, least_mass: float = 1e-6, least_radius: float = 1e-3
) -> np.ndarray:
    """Return ten physical parameters (10) close to pi (10), or pi if it has the margins below.

    The mass becomes at least ``least_mass`` [kg], the eigenvalues of the second moment about the
    centre of mass at least mass times ``least_radius`` squared [m]. The centre of mass is kept; if
    it is far away, the radius is at least 1e-4 of its distance, as rounding would hide a smaller
    one.
    """
    m = max(pi[0], least_mass)
    c = pi[1:4] / pi[0] if pi[0] > 0.0 else np.zeros(3)
    radius = max(least_radius, _VISIBLE * np.linalg.norm(c))
    about_com = pseudo_inertia(pi)[:3, :3] - pi[0] * np.outer(c, c)
    eigenvalues, vectors = np.linalg.eigh(about_com)
    eigenvalues = np.maximum(eigenvalues, m * radius**2)
    Sigma = (vectors * eigenvalues) @ vectors.T + m * np.outer(c, c)
    return from_pseudo_inertia(np.block([[Sigma, m * c[:, None]], [m * c, m]]))


def unphysical_bodies(a_d: np.ndarray, names: Sequence[str]) -> list[str]:
    """Return the names of the bodies with unphysical parameters, stacked in a_d (10 k)."""
    inertial = a_d.reshape(-1, PER_BODY)
    return [name for name, pi in zip(names, inertial, strict=True) if not is_physical(pi)]
