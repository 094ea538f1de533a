"""Every kernel against an independent formula, on whatever memory layout; NaN comes through."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import pinadapt as pa
from pinadapt.models.right_inverse import bound_smoothly
from pinadapt.realtime.safety import limited_torque

LAYOUTS = {
    "C": np.ascontiguousarray,
    "F": np.asfortranarray,
    "strided": lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
}
NAN = float("nan")
LMI = np.array([[[1.0, 0], [0, 0]], [[0.0, 1], [1, 0]], [[-1.0, 0], [0, 1]]])


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.fixture(params=LAYOUTS)
def laid(request):
    return LAYOUTS[request.param]


def filled(*shape):
    return np.full(shape, NAN)


def close(a, b, tolerance=1e-12):
    return np.allclose(a, b, rtol=tolerance, atol=tolerance)


@cache
def cones():
    panda = pa.load("panda")
    bodies = pa.make_controller(
        panda, adaptation="natural", unknown=pa.Unknown(friction=False, armature=False)
    )
    return {
        "bodies": (bodies.adaptation_d.cone, bodies.dynamics.initial),
        "planar": (pa.adaptation.MatrixInequality(LMI), np.array([3.34, 1.2, 0.97])),
        "offset": (
            pa.adaptation.MatrixInequality(LMI, offset=0.3 * np.eye(2)),
            np.array([3.34, 1.2, 0.97]),
        ),
        "blocks": (
            pa.adaptation.MatrixInequality(LMI, blocks=2),
            np.array([3.34, 1.2, 0.97, 2.0, 0.3, 1.1]),
        ),
    }


@pytest.mark.parametrize("which", ["bodies", "planar", "offset", "blocks"])
@pytest.mark.parametrize("size", [1e-6, 3e-3, 1.0, 1e3])
@pytest.mark.parametrize("most", [0.02, 1.0])
def test_geodesics(which, size, most, rng):
    cone, a = cones()[which]
    g, h = size * rng.standard_normal(a.size), 7e-3
    P, L = cone.matrices(a), cone.covectors(g)
    length = h * np.sqrt(sum(np.trace(p @ ell @ p @ ell) for p, ell in zip(P, L, strict=True)))
    h_cut = h * min(1.0, most / length)
    exact = [expm(-h_cut * p @ ell) @ p for p, ell in zip(P, L, strict=True)]
    after = cone.follow_geodesic(a, g, h, most)
    error = cone.matrices(after) - np.array(exact)
    assert cone.contains(after)
    assert np.abs(error).max() <= 0.1 * min(length, most) ** 3 * np.abs(P).max() + 1e-12
    assert np.abs(after - a).max() > 0.0
    assert close(cone.follow_geodesic(np.repeat(a, 2)[::2], g, h, most), after)
    g[0] = NAN
    assert np.isnan(cone.follow_geodesic(a, g, h, most)).any()


def test_bound_smoothly(rng, laid):
    """Zero up to the knee, direction and rate beyond it, bounded by the largest value."""
    x, rate, limits = rng.standard_normal(6), rng.standard_normal(6), rng.uniform(0.5, 2.0, 6)
    limits[2] = np.inf
    r = ((np.abs(x) / limits) ** 8).sum() ** 0.125

    def bound(size, t=0.0):
        given, given_rate = laid(size * (x + t * rate)), laid(size * rate)
        found, found_rate = bound_smoothly(laid(limits), 0.5, 0.6, given, given_rate)
        return found is not given, found, found_rate

    did, found, found_rate = bound(0.49 / r)
    assert not did and np.array_equal(found, 0.49 / r * x)
    for size in (0.51 / r, 1.0 / r, 1e6 / r):
        did, found, found_rate = bound(size)
        assert did and close(found / np.linalg.norm(found), x / np.linalg.norm(x))
        assert (np.abs(found) <= 0.6 * limits).all()
        g = 0.5 + 0.1 * np.tanh((size * r - 0.5) / 0.1)
        assert close(found, x * g / r)
        numerical = (bound(size, 1e-6)[1] - bound(size, -1e-6)[1]) / 2e-6
        assert close(found_rate, numerical, 1e-6)
    for nothing in (np.zeros(6), np.full(6, NAN)):
        assert bound_smoothly(limits, 0.5, 0.6, nothing, rate)[0] is nothing


NUMBERS = st.floats(width=64) | st.sampled_from([NAN, np.inf, -np.inf, 1e300, -2000.0, 0.0])


@settings(deadline=None)
@given(NUMBERS, NUMBERS, st.floats(0.0, np.inf, exclude_min=True), st.floats(0.0, np.inf))
def test_no_history_takes_a_torque_out_of_its_limit(torque, before, limit, rate):
    dt = 1e-3
    arrays = (np.array([each]) for each in (torque, limit, before, rate * dt))
    out = limited_torque(*arrays)
    assert abs(out[0]) <= limit
    if abs(before) <= min(limit, 1e300) and np.isfinite(rate) and not np.isnan(torque):
        assert abs(out[0] - before) <= rate * dt * (1.0 + 1e-9) + 1e-12 * abs(before)
