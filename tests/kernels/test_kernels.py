"""Every kernel against an independent formula, on whatever memory layout; NaN comes through."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import pinadapt as pa
from pinadapt.realtime.safety import limited_torque

NAN = float("nan")
LMI = np.array([[[1.0, 0], [0, 0]], [[0.0, 1], [1, 0]], [[-1.0, 0], [0, 1]]])


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@cache
def cones():
    panda = pa.load("panda")
    bodies = pa.make_controller(
        panda, adaptation="natural", unknown=pa.Unknown(friction=False, armature=False)
    )
    return {
        "bodies": (bodies.adaptation_d.cone, bodies.dynamics.initial),
        "planar": (pa.adaptation.MatrixInequality(LMI), np.array([3.34, 1.2, 0.97])),
        "blocks": (
            pa.adaptation.MatrixInequality(LMI, blocks=2),
            np.array([3.34, 1.2, 0.97, 2.0, 0.3, 1.1]),
        ),
    }


def _covectors(F, g):
    """Return the symmetric L (1, n, n) with tr(L P(da)) = g . da."""
    flat = F.reshape(len(F), -1)
    return np.linalg.solve(flat @ flat.T, g).dot(flat).reshape(1, *F.shape[1:])


@pytest.mark.parametrize("which", ["bodies", "planar", "blocks"])
@pytest.mark.parametrize("size", [1e-6, 3e-3, 1.0, 1e3])
@pytest.mark.parametrize("most", [0.02, 1.0])
def test_geodesics(which, size, most, rng):
    cone, a = cones()[which]
    g = size * rng.standard_normal(a.size)
    h = 7e-3
    P = cone.matrices(a)
    L = np.concatenate([_covectors(cone.F, part) for part in np.split(g, cone.blocks)])
    length = h * np.sqrt(sum(np.trace(p @ ell @ p @ ell) for p, ell in zip(P, L, strict=True)))
    h_cut = h * min(1.0, most / length)
    exact = [expm(-h_cut * p @ ell) @ p for p, ell in zip(P, L, strict=True)]
    after = cone.step(a, g, h, most)
    error = cone.matrices(after) - np.array(exact)
    assert cone.contains(after)
    assert np.abs(error).max() <= 0.1 * min(length, most) ** 3 * np.abs(P).max() + 1e-12
    assert np.abs(after - a).max() > 0.0
    again = cone.step(np.repeat(a, 2)[::2], g, h, most)
    assert np.allclose(again, after, rtol=1e-12, atol=1e-12)
    g[0] = NAN
    assert np.isnan(cone.step(a, g, h, most)).any()


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
