"""How far the truth may be from the belief, which gives a constant gain its shape."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..models.dynamics import Dynamics
from ..models.pseudo_inertia import nearest_physical, pseudo_inertia, ten_parameters
from ..models.translations import PlacedTranslations
from ..robot.robot import Robot

INERTIA, LENGTH = 0.3, 0.1  # relative standard deviations
_SAMPLES_PER_PARAMETER = 10
_RIDGE = 1e-6  # share of its own variance added to each parameter: no combination is known
_LEAST_RADIUS = 1e-3  # [m] of gyration, for bodies that a description leaves without extent


def prior_covariance(robot: Robot, dynamics: Dynamics) -> np.ndarray | None:
    """Return E[da da^T] (p, p) of the errors of a believed robot's parameters.

    None where plausible truths have no value in them.

    The truths are those of ``plausible``, ten a parameter. To first order the covariance of a whole
    body is 0.09 times the inverse of the metric of natural adaptation at the believed body: as a
    constant gain it knows no frames and units either.
    """
    believed, deviations = dynamics.value(robot), []
    for true in plausible(robot, dynamics, _SAMPLES_PER_PARAMETER * dynamics.size):
        value = dynamics.value(true)
        if value is None or believed is None:
            return None
        deviations.append(value - believed)
    errors = np.array(deviations).reshape(-1, dynamics.size)
    covariance = errors.T @ errors / max(len(errors), 1)
    variances = np.diag(covariance)
    return np.asarray(covariance + _RIDGE * np.diag(variances)) if (variances > 0.0).all() else None


def plausible(robot: Robot, dynamics: Dynamics, count: int) -> Iterator[Robot]:
    """Yield seeded robots that differ from the believed one in what the parameters leave unknown.

    The pseudo-inertia P = S S^T of an unknown body becomes S exp(0.3 W) S^T, W symmetric and normal
    with density exp(-tr(W W) / 2): physical, and off by 30 %. Unknown translations are off by 10 %
    of their lengths.
    """
    rng, bodies = np.random.default_rng(0), list(dynamics.bodies)
    mass = pin.computeTotalMass(robot.model) / robot.model.nv
    tens = [robot.model.inertias[body + 1].toDynamicParameters() for body in bodies]
    near = [
        pseudo_inertia(nearest_physical(ten, least_mass=1e-3 * mass, least_radius=_LEAST_RADIUS))
        for ten in tens
    ]
    roots = np.linalg.cholesky(np.array(near).reshape(-1, 4, 4))
    theta, deviations = _lengths(robot, dynamics)
    for _ in range(count):
        model, G = robot.model.copy(), rng.standard_normal((len(bodies), 4, 4))
        w, U = np.linalg.eigh(0.5 * INERTIA * (G + G.transpose(0, 2, 1)))
        A = roots @ U
        for body, P in zip(bodies, (A * np.exp(w)[:, None, :]) @ A.transpose(0, 2, 1), strict=True):
            model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(ten_parameters(P))
        if theta.size:
            lengths = theta + deviations * rng.standard_normal(theta.size)
            PlacedTranslations(model, robot.frame_id, dynamics.translations).write(lengths)
        yield replace(robot, model=model)


def _lengths(robot: Robot, dynamics: Dynamics) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters (p) of the unknown translations and their standard deviations [m]."""
    placed = PlacedTranslations(robot.model, robot.frame_id, dynamics.translations)
    theta = placed.read()
    deviations = [np.full(theta[w].shape, np.sqrt(np.mean(theta[w] ** 2))) for w in placed.windows]
    return theta, LENGTH * np.concatenate([np.zeros(0), *deviations])
