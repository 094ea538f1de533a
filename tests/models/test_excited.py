"""What a motion excites of the dynamic parameters, and the error of predicted torques."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.models.excited import TOLD_APART, TorqueErrors, scales
from tests.support.chains import catalogue_robot


def dynamics_of(name="ur5", **options):
    """Return the dynamics of a controller."""
    return pa.make_controller(catalogue_robot(name), **options).dynamics


def sums_of(dynamics, at, true, states):
    """Return the torques that some states take, and their errors."""
    Y = np.array([dynamics.regressor(*state) for state in states])
    dynamics.load(true)
    tau = np.array([dynamics.torque(*state) for state in states])
    return TorqueErrors(Y, Y @ (true - at), tau, at), Y, tau


def states_of(nv, moving, count=40):
    """Return random states in which only some joints move."""
    rng = np.random.default_rng(0)
    kept = np.isin(np.arange(nv), moving)
    return [tuple(rng.standard_normal((3, nv)) * kept) for _ in range(count)]


def test_errors_of_the_torques_are_those_of_the_regressor():
    dynamics, rng = dynamics_of(), np.random.default_rng(1)
    true = dynamics.initial
    at, other = (true * (1.0 + 0.2 * rng.standard_normal(true.size)) for _ in range(2))
    sums, Y, tau = sums_of(dynamics, at, true, states_of(6, range(6)))
    assert sums.size == pytest.approx(np.sqrt(np.mean(tau**2)))
    for a in (at, other):
        assert sums.error(a) == pytest.approx(np.sqrt(np.mean((Y @ (a - true)) ** 2)))
        own = np.sqrt(np.mean(tau**2, axis=0))
        each = np.maximum(own, 0.01 * own.max())
        assert sums.relative_error(a) == pytest.approx(
            np.sqrt(np.mean((Y @ (a - true) / each) ** 2))
        )
    assert sums.error(true) < 1e-6 * sums.size


def test_combinations_are_scaled_and_change_the_torques_independently():
    dynamics = dynamics_of()
    sums, *_ = sums_of(dynamics, dynamics.initial, dynamics.initial, states_of(6, range(6)))
    L = scales(dynamics, dynamics.initial)
    found = sums.excited(dynamics.names, L)
    C = found.combinations
    assert np.allclose(C @ L @ L.T @ C.T, np.eye(found.rank), atol=1e-9)
    squares = C @ L @ L.T @ found.squares @ L @ L.T @ C.T
    assert np.allclose(squares, np.diag(found.effects[: found.rank] ** 2), atol=1e-9)
    assert found.effects[found.rank - 1] > TOLD_APART >= found.effects[found.rank]
    d = np.random.default_rng(2).standard_normal(dynamics.size) * np.abs(dynamics.initial)
    assert np.sum((found.rows @ d) ** 2) == pytest.approx(d @ found.squares @ d)
