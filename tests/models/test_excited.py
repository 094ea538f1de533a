"""What a motion excites of the dynamic parameters, and the error of predicted torques."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.models.excited import IDENTIFIABLE, TorqueErrors, scales
from tests.support.chains import catalogue_robot


def dynamics_of(**options):
    """Return the dynamics of a controller."""
    return pa.make_controller(catalogue_robot("ur5"), **options).dynamics


def sums_of(dynamics, at, true, states):
    """Return the torques that some states take, and their errors."""
    Y = np.array([dynamics.regressor(*state) for state in states])
    dynamics.load(true)
    tau = np.array([dynamics.torque(*state) for state in states])
    return TorqueErrors(Y, Y @ (true - at), tau, at), Y, tau


def states_of(nv, moving):
    """Return forty random states in which only some joints move."""
    rng = np.random.default_rng(0)
    kept = np.isin(np.arange(nv), moving)
    return [tuple(rng.standard_normal((3, nv)) * kept) for _ in range(40)]


def test_combinations_are_scaled_and_change_the_torques_independently():
    dynamics = dynamics_of()
    sums, *_ = sums_of(dynamics, dynamics.initial, dynamics.initial, states_of(6, range(6)))
    L = scales(dynamics, dynamics.initial)
    found = sums.excited(dynamics.names, L)
    C = found.combinations
    assert np.allclose(C @ L @ L.T @ C.T, np.eye(found.rank), atol=1e-9)
    squares = C @ L @ L.T @ found.squares @ L @ L.T @ C.T
    assert np.allclose(squares, np.diag(found.effects[: found.rank] ** 2), atol=1e-9)
    assert found.effects[found.rank - 1] > IDENTIFIABLE >= found.effects[found.rank]
    d = np.random.default_rng(2).standard_normal(dynamics.size) * np.abs(dynamics.initial)
    assert np.sum((found.rows @ d) ** 2) == pytest.approx(d @ found.squares @ d)
