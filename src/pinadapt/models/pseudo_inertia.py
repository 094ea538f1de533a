"""The pseudo-inertia of a body: a matrix linear in its ten parameters.

P = [[Sigma, mc], [mc^T, m]], Sigma = tr(I)/2 1 - I. A body is physical, so that a mass distribution
has its parameters, if and only if P is positive definite (Wensing, Kim, Slotine 2018).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..description.chain import is_physical
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .regressor import PER_BODY


def _coefficients() -> np.ndarray:
    """Return F (10, 4, 4), P = sum_i pi_i F_i, pi = [m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]."""
    F = np.zeros((PER_BODY, 4, 4))
    F[0, 3, 3] = 1.0
    for axis in range(3):
        F[1 + axis, axis, 3] = F[1 + axis, 3, axis] = 1.0
    for index, (i, j) in {4: (0, 0), 5: (0, 1), 6: (1, 1), 7: (0, 2), 8: (1, 2), 9: (2, 2)}.items():
        F[index, i, j] -= 1.0
        if i == j:
            F[index, :3, :3] += 0.5 * np.eye(3)
        else:
            F[index, j, i] -= 1.0
    return F


COEFFICIENTS = _coefficients()
UNCERTAINTY = 0.3  # as far as a described body may be off, in the metric of natural adaptation


def pseudo_inertia(pi: np.ndarray) -> np.ndarray:
    """Return P (4, 4) of the ten parameters pi (10) of a body."""
    return np.tensordot(pi, COEFFICIENTS, axes=1)


def ten_parameters(P: np.ndarray) -> np.ndarray:
    """Return the ten parameters (..., 10) of bodies with pseudo-inertias P (..., 4, 4)."""
    xx, yy, zz = P[..., 0, 0], P[..., 1, 1], P[..., 2, 2]
    first = [P[..., 3, 3], P[..., 0, 3], P[..., 1, 3], P[..., 2, 3]]
    second = [yy + zz, -P[..., 0, 1], xx + zz, -P[..., 0, 2], -P[..., 1, 2], xx + yy]
    return np.stack([*first, *second], axis=-1)


def nearest_physical(pi: np.ndarray, *, least_mass: float, least_radius: float) -> np.ndarray:
    """Return ten physical parameters (10) close to pi (10), or pi if it has the margins below.

    The mass becomes at least ``least_mass`` [kg], the eigenvalues of the second moment about the
    centre of mass at least mass times ``least_radius`` squared [m]. The centre of mass is kept.
    """
    m = max(float(pi[0]), least_mass)
    c = pi[1:4] / pi[0] if pi[0] > 0.0 else np.zeros(3)
    P = pseudo_inertia(pi)
    about_com = P[:3, :3] - pi[0] * np.outer(c, c)
    eigenvalues, vectors = np.linalg.eigh(about_com)
    eigenvalues = np.maximum(eigenvalues, m * least_radius**2)
    Sigma = (vectors * eigenvalues) @ vectors.T + m * np.outer(c, c)
    return ten_parameters(np.block([[Sigma, m * c[:, None]], [m * c, m]]))


def unphysical_bodies(a_d: np.ndarray, names: Sequence[str]) -> list[str]:
    """Return the names of the bodies with unphysical parameters, stacked in a_d (10 k)."""
    return [
        name
        for name, pi in zip(names, a_d.reshape(-1, PER_BODY), strict=True)
        if not is_physical(pi)
    ]


def with_bodies(robot: Robot, tens: Mapping[int, np.ndarray]) -> Robot:
    """Return a robot with bodies replaced: index from 0 -> ten parameters (10).

    Raises:
        ParameterError: some of them are not physical.
    """
    names = [robot.joint_names[body] for body in tens]
    stacked = np.concatenate([np.zeros(0), *tens.values()])
    if unphysical := unphysical_bodies(stacked, names):
        raise ParameterError(
            f"the bodies moved by {unphysical} have inertias that no mass distribution has.",
            where="learned",
            hint='Adaptation "natural" keeps bodies physical; "gradient" does not.',
        )
    model = robot.model.copy()
    for body, ten in tens.items():
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(ten)
    return replace(robot, model=model)
