"""Gradient and natural adaptation: metric, cone and pseudo-inertia."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given

import pinadapt as pa
from pinadapt.description.chain import is_physical
from pinadapt.models.bodies import nearest_physical
from tests.support.chains import random_inertia, seeded, seeds
from tests.support.differences import derivative
from tests.support.drives import rate_of, stepped

PLANAR_LMI = np.array([[[1, 0], [0, 0]], [[0, 1], [1, 0]], [[-1, 0], [0, 1]]], dtype=float)


def bodies(rng, count):
    return np.concatenate([random_inertia(rng).toDynamicParameters() for _ in range(count)])


def diagonal_bounds():
    """An incomplete cone: 0 < a1 < 2 a2, 0 < a2."""
    return pa.adaptation.MatrixInequality([np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 2.0, 1.0])])


CASES = {
    "bodies": lambda rng: (
        pa.adaptation.BodyInequality(["a", "b", "c"]),
        bodies(rng, 3),
        bodies(rng, 3),
    ),
    "planar": lambda rng: (
        pa.adaptation.MatrixInequality(PLANAR_LMI),
        np.array([3.0, 0.5, 0.5]),
        np.array([3.34, 1.2, 0.97]),
    ),
    "bounds": lambda rng: (diagonal_bounds(), np.array([0.5, 1.0]), np.array([1.2, 0.7])),
}


def test_unphysical_inertias_are_recognised():
    triangle = pin.Inertia(
        1.0, np.array([0.1, 0.0, 0.0]), np.diag([1.0, 1.0, 3.0])
    )  # Ixx + Iyy < Izz
    assert not is_physical(triangle.toDynamicParameters())
    assert not is_physical(np.zeros(10))
    assert not is_physical(-random_inertia(np.random.default_rng(0)).toDynamicParameters())


@given(seeds)
@seeded
def test_nearest_physical(seed):
    rng = np.random.default_rng(seed)
    anything = rng.standard_normal(10)
    repaired = nearest_physical(anything, least_mass=0.1, least_radius=0.01)
    assert is_physical(repaired)
    good = random_inertia(rng).toDynamicParameters()
    assert np.allclose(nearest_physical(good, least_mass=1e-3, least_radius=1e-4), good, atol=1e-12)


@pytest.mark.parametrize("case", CASES)
@given(seed=seeds)
@seeded
def test_divergence_changes_as_the_lyapunov_proof_requires(case, seed):
    """dD/dt = -(a - a_true)^T g for da/dt = rate(a, g), as every Lyapunov proof requires."""
    rng = np.random.default_rng(seed)
    cone, a, a_true = CASES[case](rng)
    assume(
        pa.adaptation.Natural(0.3, cone).storage(pa.adaptation.Estimate(a), a_true) < 300.0
    )  # rounding grows with it
    g = rng.standard_normal(a.size)
    g /= np.linalg.norm(g)
    for adaptation in (
        pa.adaptation.Natural(0.3, cone, shares=rng.uniform(0.3, 3.0, cone.blocks)),
        pa.adaptation.Gradient(rng.uniform(0.1, 2.0, a.size), a.size),
    ):
        rate = rate_of(adaptation, a, g)
        step = 1e-4 / max(1.0, np.linalg.norm(rate))
        change = derivative(
            lambda t, a=a, r=rate, f=adaptation: f.storage(
                pa.adaptation.Estimate(a + t * r), a_true
            ),
            h=step,
        )
        assert np.isclose(change, -(a - a_true) @ g, rtol=1e-5, atol=1e-7)
        assert adaptation.storage(pa.adaptation.Estimate(a_true), a_true) == pytest.approx(
            0.0, abs=1e-9
        )
        assert adaptation.storage(pa.adaptation.Estimate(a), a_true) > 0.0


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("step", [1e-3, 1.0, 1e4])
def test_natural_adaptation_stays_in_the_cone(case, step):
    rng = np.random.default_rng(6)
    cone, a, _ = CASES[case](rng)
    adaptation = pa.adaptation.Natural(1.0, cone)
    scale = np.abs(rate_of(adaptation, a, np.ones(a.size))).max()
    for _ in range(20):
        g = rng.standard_normal(a.size)
        a_next = stepped(adaptation, a, g, step / scale)
        assert cone.contains(a_next)
        ratios = np.linalg.eigvals(np.linalg.solve(cone.matrices(a), cone.matrices(a_next))).real
        assert ratios.max() <= np.exp(0.02) + 1e-5 and ratios.min() >= np.exp(-0.021)


def test_natural_adaptation_is_coordinate_free():
    """Adaptation commutes with a change of frames and units, unlike gradient adaptation."""
    rng = np.random.default_rng(9)
    cone = pa.adaptation.BodyInequality(["a"])
    a = bodies(rng, 1)
    g = rng.standard_normal(10)
    placement = pin.SE3.Random()

    def move(pi):
        return placement.act(pin.Inertia.FromDynamicParameters(pi)).toDynamicParameters()

    A = (
        np.stack([move(a + e) - move(a) for e in 1e-3 * np.eye(10)], axis=1) / 1e-3
    )  # the map is linear
    h = 1e-3
    natural = pa.adaptation.Natural(1.0, cone)
    there = stepped(natural, move(a), np.linalg.solve(A.T, g), h)
    assert np.allclose(there, move(stepped(natural, a, g, h)), rtol=1e-6, atol=1e-8)


def test_unphysical_bodies_are_made_physical_with_a_warning():
    rng = np.random.default_rng(10)
    a = bodies(rng, 2)
    a[19] += 100.0  # Izz of the second body
    cone = pa.adaptation.BodyInequality(["shoulder", "elbow"], least_mass=1e-3, least_radius=1e-3)
    with pytest.warns(UserWarning, match=r"\['elbow'\]"):
        valid = pa.adaptation.Natural(1.0, cone).init(a).value
    assert cone.contains(valid)
    assert np.array_equal(valid[:10], a[:10])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pa.adaptation.Natural(1.0, cone).init(valid).value is valid
