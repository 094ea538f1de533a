"""Least squares in the physical cone: a unique minimum inside it, whatever the coordinates."""

import numpy as np
import pinocchio as pin
import pytest

from pinadapt.models.bodies import from_pseudo_inertia, pseudo_inertia
from pinadapt.models.physical_fit import PhysicalSet, nearest_with, physical_fit
from tests.support.chains import random_inertia

GAMMA = 1e-2


def bodies(seed, count):
    """Return the ten parameters of bodies, stacked."""
    rng = np.random.default_rng(seed)
    return np.concatenate([random_inertia(rng).toDynamicParameters() for _ in range(count)])


def problem(seed, rows, count=2, joints=3):
    """Return rows, a right-hand side, and a physical set."""
    rng = np.random.default_rng(seed)
    center = np.concatenate([bodies(seed, count), rng.uniform(0.1, 1.0, joints)])
    A = 30.0 * rng.standard_normal((rows, center.size))
    return A, A @ rng.standard_normal(center.size), PhysicalSet(count, center)


def objective(A, b, physical, a):
    return 0.5 * np.sum((A @ a - b) ** 2) + GAMMA * physical.divergence(a)


@pytest.mark.parametrize("rows", [4, 15, 60])
@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_minimum_and_physical(seed, rows):
    A, b, physical = problem(seed, rows)
    a = physical_fit(A, b, physical, gamma=GAMMA)
    assert (np.linalg.eigvalsh(physical.matrices(a)) > 0.0).all()
    assert (physical.coefficients(a) > 0.0).all()
    least = objective(A, b, physical, a)
    T = physical.local(a)[0]
    rng = np.random.default_rng(9)
    for _ in range(40):  # steps of the size of what bounds the set there
        step = T @ rng.standard_normal(a.size)
        for size in (1e-4, 1e-2):
            assert objective(A, b, physical, a + size * step) >= least * (1.0 - 1e-10)


def test_physical_parameters_are_found_from_sufficient_rows():
    A, _, physical = problem(1, 60)
    true = np.concatenate([bodies(5, 2), [0.3, 1e-3, 2.0]])
    assert np.allclose(physical_fit(1e6 * A, 1e6 * A @ true, physical, gamma=1e-4), true, atol=1e-6)


def test_rows_of_parameters_that_are_not_physical_are_told_in_time():
    A, b, physical = problem(0, 23)
    assert nearest_with(A, np.linalg.solve(A, b), physical, 1e-2) is None


def test_unexcited_directions_stay_as_described_within_the_cone():
    _, _, physical = problem(2, 1)
    row = np.zeros((1, physical.center.size))
    row[0, 0] = 1e6  # the mass of the first body
    a = physical_fit(row, row @ (2.0 * physical.center), physical, gamma=1e-4)
    assert a[0] == pytest.approx(2.0 * physical.center[0])
    assert np.allclose(a[10:], physical.center[10:], rtol=1e-5)
    centre = physical.center[1:4] / physical.center[0]
    assert np.allclose(a[1:4] / a[0], centre, rtol=1e-4)  # the same centre


def test_the_estimate_does_not_depend_on_frame_or_unit():
    A, b, physical = problem(3, 12, count=1, joints=1)
    a = physical_fit(A, b, physical, gamma=GAMMA)
    G = pin.SE3.Random().homogeneous
    G[:3] *= 3.0  # other axes, another origin, another unit of length

    def moved(ten):
        return from_pseudo_inertia(G @ pseudo_inertia(ten) @ G.T)

    T = np.eye(11)
    T[:10, :10] = np.column_stack([moved(e) for e in np.eye(10)])
    T[10, 10] = 7.0
    other = PhysicalSet(1, T @ physical.center)
    assert np.allclose(physical_fit(A @ np.linalg.inv(T), b, other, gamma=GAMMA), T @ a, rtol=1e-5)
