"""How far the truth may be from the belief: what scales a constant gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..robot import Robot
from .dynamic import DynamicParameters
from .kinematic import Translation
from .pseudo_inertia import inertial_ten, nearest_physical, pseudo_inertia

INERTIA, LENGTH = 0.3, 0.1  # relative standard deviations
_SAMPLES_PER_PARAMETER = 10
_RIDGE = 1e-6  # part of its own variance added to each parameter, so that no combination is taken for known


def prior_covariance(robot: Robot, dynamics: DynamicParameters) -> np.ndarray | None:
    """Return E[da da^T] (p, p) of the parameters' errors over seeded plausible truths, or None where these have no value.

    Inertias are off by 30 %: pseudo-inertias P = S S^T become S exp(0.3 W) S^T with W symmetric and standard normal
    in the norm tr(W W), so that to first order the covariance of a body is 0.09 times the inverse of the metric of natural
    adaptation at the believed body, whatever its frame and units. Lengths are off by 10 %.
    """
    rng, deviations = np.random.default_rng(0), []
    believed = dynamics.value(robot)
    for _ in range(_SAMPLES_PER_PARAMETER * dynamics.size):
        value = dynamics.value(plausible(robot, rng, dynamics.bodies, dynamics.translations))
        if value is None or believed is None:
            return None
        deviations.append(value - believed)
    errors = np.array(deviations)
    covariance = errors.T @ errors / max(len(errors), 1)
    variances = np.diag(covariance)
    if not (variances > 0.0).all():
        return None
    return np.asarray(covariance + _RIDGE * np.diag(variances))


def plausible(
    robot: Robot, rng: np.random.Generator, bodies: Sequence[int], translations: Sequence[Translation]
) -> Robot:
    """Return a robot whose chosen bodies (from 0) and joint translations differ at random from the believed ones."""
    model = robot.model.copy()
    mass = sum(inertia.mass for inertia in model.inertias[1:]) / model.nv
    for body in bodies:
        ten = model.inertias[body + 1].toDynamicParameters()
        S = np.linalg.cholesky(pseudo_inertia(nearest_physical(ten, least_mass=1e-3 * mass, least_radius=1e-3)))
        W = rng.standard_normal((4, 4))
        w, U = np.linalg.eigh(INERTIA * (W + W.T) / np.sqrt(2.0) * _HALF)
        A = S @ U
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(inertial_ten((A * np.exp(w)) @ A.T))
    for part in translations:
        if part.joint is not None:
            placement = model.jointPlacements[part.joint]
            theta = part.directions.T @ (placement.translation - part.offset)
            scale = np.maximum(np.abs(theta), np.linalg.norm(theta) / len(theta))
            placement.translation = part.at(theta + LENGTH * scale * rng.standard_normal(len(theta)))
    return replace(robot, model=model)
