"""Every kernel against an independent formula, on whatever memory layout; NaN comes through."""

import pickle
import sys
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import pinadapt as pa
from pinadapt import _compiled
from pinadapt._kernels import estimates as adaptation
from pinadapt._kernels import laws, linear_algebra, models
from pinadapt._kernels import samples as checks
from pinadapt.exceptions import ArrayError
from pinadapt.models.regressor import live_array

_compiled.compile_all()
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


def test_kernels_have_one_specialisation_each():
    assert len(_compiled.kernels) >= 16
    for dispatcher in _compiled.kernels.values():
        assert len(dispatcher.signatures) == 1 and dispatcher.__doc__


def test_all_kernels_are_kept_on_disk():
    """One that is not is compiled by every process, for a second."""
    assert [name for name, kernel in _compiled.kernels.items() if not kernel.stats.cache_path] == []


def test_kernels_hold_no_array(rng):
    a, low, high = rng.standard_normal(3), -np.full(3, 9.0), np.full(3, 9.0)
    before = [sys.getrefcount(x) for x in (a, low, high)]
    assert all(adaptation.inside(a, low, high) for _ in range(3))
    assert [sys.getrefcount(x) for x in (a, low, high)] == before
    alike = a.view(type("Own", (np.ndarray,), {})), pickle.loads(pickle.dumps(a))
    for right in (*alike, a):
        assert adaptation.inside(right, low, high) and not adaptation.inside(high, low, right)


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


def test_gain_of_bodies(rng, laid):
    """P L P of every body, with tr(L P(da)) = x . da for each column x."""
    names, gamma = ["shoulder", "elbow"], np.array([0.5, 3.0])
    bodies = pa.adaptation.BodyInequality(names)
    whole = pa.adaptation.MatrixInequality(bodies.F, blocks=2)
    root = rng.standard_normal((2, 4, 4))
    a, X = bodies.components(root @ root.swapaxes(1, 2)), laid(rng.standard_normal((20, 3)))
    P = bodies.matrices(a)
    expected = [
        bodies.components(gamma[:, None, None] * (P @ bodies.covectors(x) @ P)) for x in X.T
    ]
    for cone in (bodies, whole):
        assert close(cone.metric_inverse_times(laid(a), X, gamma), np.transpose(expected))
    X[3, 1] = NAN
    product = bodies.metric_inverse_times(a, X, gamma)
    assert np.isnan(product[:10, 1]).all() and np.isfinite(product[:, [0, 2]]).all()


def test_filtered_regressor(rng, laid):
    Y_M, Y_0 = laid(rng.standard_normal((2, 3, 4)))
    p_0, tau_0 = laid(rng.standard_normal((2, 3)))
    Z, before = laid(rng.standard_normal((2, 3, 5)))
    u, Z_now, W = filled(3, 3, 5)
    models.filtered_regressor(Y_M, Y_0, p_0, tau_0, 7.0, Z, before, 0.2, 0.3, u, Z_now, W)
    momentum = 7.0 * np.column_stack([Y_M, p_0])
    assert close(u, momentum - np.column_stack([Y_0, tau_0]))
    assert close(Z_now, Z + 0.2 * (before - Z) + 0.3 * (u - before)) and close(W, momentum - Z_now)
    Y_0[1, 2] = NAN
    models.filtered_regressor(Y_M, Y_0, p_0, tau_0, 7.0, Z, before, 0.2, 0.3, u, Z_now, W)
    assert np.isnan(u[1, 2]) and np.isnan(W).sum() == 1


def test_descent(rng, laid):
    (a, g), after = rng.standard_normal((2, 9)), filled(9)
    Gamma = a[:, None] * a + np.diag(g)
    adaptation.descend(laid(a), laid(g), Gamma, 0.1, after)
    assert close(after, a - 0.1 * Gamma @ g)
    adaptation.descent(laid(g), Gamma, after)
    assert close(after, -Gamma @ g)
    adaptation.descend(a, NAN * g, Gamma, 0.1, after)
    assert np.isnan(after).all()


def test_inside(rng):
    a = rng.standard_normal(3)
    assert adaptation.inside(a, a - 1.0, a + 1.0) and adaptation.inside(a[:0], a[:0], a[:0])
    for i in range(3):
        edge = a + np.where(np.arange(3) == i, 0.0, 1.0)
        assert not adaptation.inside(a, a - 1.0, edge)
        assert not adaptation.inside(a, 2.0 * a - edge, a + 1.0)
        unknown = np.where(np.arange(3) == i, NAN, a)
        assert not adaptation.inside(unknown, a - 1.0, a + 1.0)


@pytest.mark.parametrize("shape", [(2, 2), (2, 5), (3, 3), (3, 7), (6, 6), (6, 7)])
def test_right_inverse(shape, rng, laid):
    m, n = shape
    J, G = laid(rng.standard_normal(shape)), laid(filled(m, m))
    G = G if G.flags.c_contiguous else filled(m, m)  # as its signature has it
    s = np.trace(np.linalg.inv(J @ J.T)) ** -0.5
    for threshold in (0.0, 0.5 * s, 3.0 * s):
        found, mu_2, lost = linear_algebra.invert_gram(J, threshold, G)
        expected = 0.5 * (threshold**2 - s**2) if s < threshold else 0.0
        assert np.isclose(found, s) and np.isclose(mu_2, expected) and not lost
        assert close(G, np.linalg.inv(J @ J.T + expected * np.eye(m)), 1e-8)
        u, psi, solution = laid(rng.standard_normal(m)), laid(rng.standard_normal(n)), filled(n)
        linear_algebra.right_inverse(J, G, u, psi, solution)
        assert close(solution, psi + J.T @ G @ (u - J @ psi), 1e-9)
    flawed = np.where(np.eye(m, n) > 0, NAN, J)
    for lost_rank, threshold in ((flawed, 0.0), (flawed, 0.1), (np.zeros(shape), 0.0)):
        assert linear_algebra.invert_gram(lost_rank, threshold, G)[2]


@pytest.mark.parametrize("n", [1, 2, 6, 7])
def test_gradient_through_inverse(n, rng, laid):
    root, J, e = rng.standard_normal((n, n)), laid(rng.standard_normal((3, n))), np.ones(3)
    M, x = laid(root @ root.T + 0.1 * np.eye(n)), filled(n)
    Y, L, g = laid(rng.standard_normal((n, 10 * n))), filled(n, n), filled(10 * n)
    assert linear_algebra.gradient_through_inverse(M, J, e, Y, L, x, g)
    assert close(M @ x, J.T @ e) and close(g, Y.T @ x)
    unknown = M.copy()
    unknown[-1, 0] = NAN
    for flawed in (M - 1e3 * np.eye(n), unknown):
        assert not linear_algebra.gradient_through_inverse(flawed, J, e, Y, L, x, g)


@pytest.mark.parametrize(("m", "m_p", "p"), [(2, 2, 2), (3, 3, 3), (6, 3, 5), (3, 3, 0)])
def test_law_algebra(m, m_p, p, rng, laid):
    K_v, K_P, R_k = (laid(rng.standard_normal((k, k))) for k in (m, m, m_p))
    Y_k, W_k = laid(rng.standard_normal((m, p))), laid(rng.standard_normal((m_p, p)))
    dx, xd, xd_d, xdd, Jdot_v = (laid(row) for row in rng.standard_normal((5, m)))
    a_k, rate, y = rng.standard_normal(p), rng.standard_normal(p), rng.standard_normal(m_p)
    e, error, residual, g_k = filled(m), filled(m), filled(m_p), filled(p)
    laws.kinematic_drive(K_P, dx, 5.0, xd, xd_d, Y_k, W_k, R_k, a_k, y, e, error, residual, g_k)
    dxd = xd - xd_d
    assert close(e, dxd + 5.0 * dx) and close(error, -K_P @ dx - 5.0 * dxd)
    assert close(residual, W_k @ a_k - y)
    assert close(g_k, W_k.T @ R_k @ (W_k @ a_k - y) - Y_k.T @ (K_P @ dx + 5.0 * dxd), 1e-11)
    J, G, v = laid(rng.standard_normal((m, 7))), laid(rng.standard_normal((m, m))), filled(7)
    (qd, q), own, offset = rng.standard_normal((2, 7)), laid(resting(rng, 7)), filled(7)
    missed = filled(m)
    laws.posture_offset(q, own, offset)
    laws.commanded_acceleration(
        xdd, K_v, xd, xd_d, K_P, dx, Jdot_v, Y_k, rate, J, G, qd, q, own, 4.0, missed, v
    )
    u, psi = xdd - K_v @ dxd - K_P @ dx - (Jdot_v + Y_k @ rate), -8.0 * qd - 16.0 * offset
    assert close(missed, u - J @ psi, 1e-10)
    assert close(v, psi + J.T @ G @ (u - J @ psi), 1e-10)
    none = np.zeros((4, 0))  # a posture that is not asked for is not read
    laws.commanded_acceleration(
        xdd, K_v, xd, xd_d, K_P, dx, Jdot_v, Y_k, rate, J, G, qd, q, none, 0.0, missed, v
    )
    assert close(v, J.T @ G @ u, 1e-10)
    laws.commanded_acceleration(
        NAN * xdd, K_v, xd, xd_d, K_P, dx, Jdot_v, Y_k, rate, J, G, qd, q, own, 4.0, missed, v
    )
    assert np.isnan(v).all()


def resting(rng, n):
    """Return rest, low, high and margin (4, n) of a posture."""
    return np.stack([rng.standard_normal(n), np.full(n, -0.5), np.full(n, 0.8), np.full(n, 0.3)])


@pytest.mark.parametrize(("m", "n"), [(2, 2), (3, 6), (6, 7)])
def test_right_inverse_and_rate(m, n, rng, laid):
    """r of x = psi + J^T G (u - J psi) by differences, G damped by mu^2 that itself moves."""
    J, Jdot = laid(rng.standard_normal((m, n))), laid(rng.standard_normal((m, n)))
    u, ud = laid(rng.standard_normal((2, m)))
    psi, psid = laid(rng.standard_normal((2, n)))
    mu_2, damping_rate, h = 0.3, -0.7, 1e-5

    def solution(t):
        J_t = J + t * Jdot
        G = np.linalg.inv(J_t @ J_t.T + (mu_2 + t * damping_rate) * np.eye(m))
        return psi + t * psid + J_t.T @ G @ (u + t * ud - J_t @ (psi + t * psid))

    G, x, rate = laid(np.linalg.inv(J @ J.T + mu_2 * np.eye(m))), filled(n), filled(n)
    moving, work = (ud, psid, Jdot, damping_rate), (filled(m), filled(m))
    linear_algebra.right_inverse_and_rate(J, G, u, psi, *moving, *work, x, rate)
    assert close(x, solution(0.0))
    assert close(rate, (solution(h) - solution(-h)) / (2.0 * h), 1e-7)
    linear_algebra.right_inverse_and_rate(J, G, u, NAN * psi, *moving, *work, x, rate)
    assert np.isnan(rate).all() and np.isnan(x).all()


def test_bound_smoothly(rng, laid):
    """Zero up to the knee, direction and rate beyond it, bounded by the largest value."""
    x, rate, limits = rng.standard_normal(6), rng.standard_normal(6), rng.uniform(0.5, 2.0, 6)
    limits[2] = np.inf
    r = ((np.abs(x) / limits) ** 8).sum() ** 0.125

    def bound(size, t=0.0):
        found, found_rate = laid(size * (x + t * rate)), laid(size * rate)
        did = linear_algebra.bound_smoothly(laid(limits), 0.5, 0.6, found, found_rate)
        return did, found, found_rate

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
        left = nothing.copy()
        assert not linear_algebra.bound_smoothly(limits, 0.5, 0.6, left, rate.copy())
        assert np.array_equal(left, nothing, equal_nan=True)


@pytest.mark.parametrize(("m", "n"), [(2, 2), (3, 6), (6, 7)])
def test_null_space(m, n, rng, laid):
    J, z, null = laid(rng.standard_normal((m, n))), laid(rng.standard_normal(n)), filled(n)
    linear_algebra.null_space(J, laid(np.linalg.inv(J @ J.T)), z, null)
    assert close(null, z - np.linalg.pinv(J) @ J @ z, 1e-9) and close(J @ null, 0.0, 1e-9)


def test_products(rng, laid):
    A, B, x = (laid(rng.standard_normal(shape)) for shape in ((3, 5), (5, 4), 5))
    Ax, AB = filled(3), filled(3, 4)
    linear_algebra.apply(A, x, Ax)
    linear_algebra.multiply(A, B, AB)
    assert close(Ax, A @ x) and close(AB, A @ B)


@pytest.mark.parametrize(("m", "n"), [(1, 2), (3, 6), (6, 7)])
def test_null_space_damping(m, n, rng, laid):
    J, D, z = (
        laid(rng.standard_normal((m, n))),
        laid(rng.uniform(0.1, 2.0, n)),
        np.arange(1.0, n + 1),
    )
    N, torque = np.eye(n) - np.linalg.pinv(J) @ J, np.ones(n)
    G = laid(np.linalg.inv(J @ J.T))
    linear_algebra.subtract_null_space_damping(J, G, D, laid(z), torque)
    assert close(torque, 1.0 - N @ (D * (N @ z)), 1e-9)


@pytest.mark.parametrize("m", [2, 3])
def test_observation_drive(m, rng, laid):
    Y_k, X_k, R = (laid(rng.standard_normal(shape)) for shape in ((6, 4), (m, 4), (m, m)))
    dx_o, epsilon = (laid(row) for row in rng.standard_normal((2, m)))
    error, gradient = filled(m), filled(4)
    laws.observation_drive(Y_k, dx_o, 0.7, X_k, epsilon, R, error, gradient)
    assert close(error, 0.7 * dx_o)
    assert close(gradient, 0.7 * Y_k[:m].T @ dx_o + X_k.T @ (R @ epsilon))


def test_posture(rng, laid):
    """A parabola beyond either edge, and the rate by differences."""
    (q, v), own = map(laid, rng.standard_normal((2, 200))), resting(rng, 200)
    own[1, ::7], own[2, ::7] = -np.inf, np.inf
    own, (offset, psi, rate, after) = laid(own), (filled(200) for _ in range(4))
    laws.posture_offset(q, own, offset)
    rest, low, high, _ = own
    d = q - rest
    beyond = np.where(d > high, (d - high) ** 2, 0.0) - np.where(d < low, (d - low) ** 2, 0.0)
    assert close(offset, d + 2.0 * beyond / 0.3) and beyond.min() < 0.0 < beyond.max()
    laws.posture_velocity(q, own, v, 4.0, psi, rate)
    assert close(psi, -4.0 * offset)
    laws.posture_offset(q + 1e-7 * v, own, after)
    laws.posture_offset(q - 1e-7 * v, own, offset)
    assert close(rate, -4.0 * (after - offset) / 2e-7, 1e-5)


def test_damping(rng, laid):
    feedforward, v, v_r = map(laid, rng.standard_normal((3, 5)))
    K_D, error, torque = laid(rng.standard_normal((5, 5))), filled(5), filled(5)
    laws.subtract_damping(feedforward, K_D, v, v_r, error, torque)
    assert close(error, v - v_r) and close(torque, feedforward - K_D @ error)


def test_borne_damping(rng, laid):
    feedforward, v, v_r = map(laid, rng.standard_normal((3, 5)))
    D, M = (laid(root @ root.T + np.eye(5)) for root in rng.standard_normal((2, 5, 5)))
    error, torque = filled(5), filled(5)
    laws.subtract_limited_damping(feedforward, D, M, 3.0, v, v_r, error, torque)
    borne = np.linalg.inv(np.linalg.inv(D) + np.linalg.inv(3.0 * M))
    assert close(error, v - v_r) and close(torque, feedforward - borne @ error, 1e-9)


def test_polarisation(rng, laid):
    (v, v_r), mean, half = map(laid, rng.standard_normal((2, 5))), filled(5), filled(5)
    models.polarise(v, v_r, mean, half)
    assert close(mean + half, v) and close(mean - half, v_r)
    Y, Y_0, pi, tau = *rng.standard_normal((2, 5, 20)), rng.standard_normal(20), filled(5)
    taken = laid(Y.copy())
    models.polarised(laid(Y_0), laid(pi), taken, tau)
    assert close(taken, Y - Y_0) and close(tau, (Y - Y_0) @ pi)


def test_prediction_of_a_torque(rng, laid):
    W, (a, y), residual = laid(rng.standard_normal((4, 6))), rng.standard_normal((2, 6)), filled(4)
    checks.prediction_error(W, laid(a), laid(y[:4]), residual)
    assert close(residual, W @ a - y[:4])


def test_hold(rng, laid):
    """A low pass with its input held, and a ramp through it, against many small steps."""
    (y, tau), x = map(laid, rng.standard_normal((2, 3))), 0.7
    after, shares, count = filled(3), filled(2), 20000
    laws.hold(y, tau, x, after, shares)
    assert close(after, tau + np.exp(-x) * (y - tau))
    ramp, slow, share = np.linspace(0.0, 1.0, count + 1), 0.0, -np.expm1(-x / count)
    for middle in 0.5 * (ramp[1:] + ramp[:-1]):
        slow += share * (middle - slow)
    assert close(shares, [slow, -np.expm1(-x)], 1e-8)
    laws.hold(y, tau, 0.0, after, shares)
    assert close(after, y) and not shares.any()


def test_carry(rng, laid):
    memory, xd_hat, x = map(laid, rng.standard_normal((3, 3)))
    memory[2], dx_o, after = 0.03, filled(2), filled(3)
    laws.observed(memory, 0.02, xd_hat, x[:2], dx_o)
    assert close(dx_o, (memory + 0.05 * xd_hat - x)[:2])
    laws.carry(memory, xd_hat, dx_o, 7.0, 0.1, after)
    assert close(after[:2], (memory + 0.08 * xd_hat)[:2] - (1.0 - np.exp(-0.7)) * dx_o)
    assert after[2] == 0.05


@pytest.mark.parametrize("observed", [0, 2, 3])
def test_reference(observed, rng, laid):
    xd_d, dx, xdd_d, xd, dx_o = (laid(row) for row in rng.standard_normal((5, 3)))
    dx_o[observed:] = 0.0
    u, ud = filled(3), filled(3)
    laws.reference(xd_d, dx, xdd_d, xd, dx_o[:observed], 5.0, 7.0, u, ud)
    assert close(u, xd_d - 5.0 * (dx + dx_o))
    assert close(ud, xdd_d - 5.0 * (xd - xd_d - 7.0 * dx_o))


@pytest.mark.parametrize("h", [1e-4, 1.0])
def test_exponentiation(h, rng, laid):
    a, g, scale = laid(rng.uniform(0.1, 2.0, 4)), laid(rng.standard_normal(4)), rng.uniform(1, 2, 4)
    exponent, after = -h * scale * g, filled(4)
    adaptation.exponentiate(a, g, scale, h, 0.02, after)
    cut = np.clip(exponent, -0.02, 0.02) if np.linalg.norm(exponent) > 0.02 else exponent
    assert close(after, a * np.exp(cut)) and (after > 0.0).all()
    adaptation.exponentiate(a, np.array([NAN, 1.0, 1.0, 1.0]), scale, h, 0.02, after)
    assert np.isnan(after[0])


def test_task_force(rng, laid):
    K_v, K_P, J = (laid(rng.standard_normal(shape)) for shape in ((3, 3), (3, 3), (3, 7)))
    xd, xd_d, dx = map(laid, rng.standard_normal((3, 3)))
    feedforward, v, v_r = map(laid, rng.standard_normal((3, 7)))
    error, torque = filled(7), filled(7)
    laws.subtract_task_force(J, K_v, xd, xd_d, K_P, dx, feedforward, v, v_r, error, torque)
    assert close(torque, feedforward - J.T @ (K_v @ (xd - xd_d) + K_P @ dx))
    assert close(error, v - v_r)


@pytest.mark.parametrize("threshold", [1e-2, 1.0])
def test_joint_effects(threshold, rng, laid):
    """The torque of five joints and two coupled shafts, by numpy, and by its regressor."""
    n, k = 5, 2
    (inertial, v, a, g), B = laid(rng.standard_normal((4, n))), laid(rng.standard_normal((k, n)))
    values, shape = laid(rng.standard_normal((6, n + k))), rng.uniform(0.5, 2.0, (3, n + k))
    shape[0], shape[1, ::2] = 1.0 / threshold, 0.0
    shape = laid(shape)
    u, w = np.append(v, B @ v), np.append(a, B @ a)
    load = np.append(g, np.zeros(k))
    s = np.tanh(u * shape[0]) * (1.0 + shape[1] * np.exp(-np.abs(u) * shape[2]))
    armature, viscous, coulomb, loaded, asymmetry, offset = values
    f = armature * w + viscous * u + (coulomb + loaded * load) * s + asymmetry * np.abs(s) + offset
    expected = inertial + f[:n] + B.T @ f[n:]
    kinds, shafts = (index.ravel() for index in np.indices(values.shape))
    told, Y_b = filled(6, n + k), laid(rng.standard_normal((n, 4)))
    models.take_coefficients(laid(values.ravel()), kinds, shafts, told)
    assert np.array_equal(told, values)
    tau, Y = filled(n), filled(n, 4 + values.size)
    every = np.arange(values.size).reshape(values.shape)
    motion = shape, B, v, a, g
    models.add_joint_effects(values, every, *motion, 1.0, Y_b, inertial, Y, tau)
    assert close(tau, expected, 1e-11)
    assert close(Y[:, :4], Y_b) and close(Y[:, 4:] @ values.ravel(), expected - inertial, 1e-11)
    few = filled(n, 4 + 5 * (n + k))
    columns = np.where(every < few.shape[1] - 4, every, -1)  # the offsets are known
    models.add_joint_effects(values, columns, *motion, 0.0, Y_b, inertial, few, tau)
    assert np.array_equal(few, Y[:, : few.shape[1]])
    without = offset[:n] + B.T @ offset[n:]
    assert close(tau, expected - without, 1e-11)


def moving(name, rng, length):
    """Return a chain's model and data, q, v, and a frame this far from its last joint."""
    model = pa.load(name).model
    v = rng.standard_normal(model.nv)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
    lever = pin.SE3(np.eye(3), length)
    frame = model.addFrame(pin.Frame("off", model.njoints - 1, 0, lever, pin.FrameType.OP_FRAME))
    return model, model.createData(), q, v, frame


CHAINS = ["panda", "scara", "kinova", "planar_2r"]
ROWS = [[0, 1, 2], [0, 2], [0, 1, 2, 3, 4, 5]]


def arrays_of(data):
    """Return rotations, origins and velocities of all joints, their axes and the axes' rates."""
    R, o = (
        np.array([getattr(oMi, part) for oMi in data.oMi]) for part in ("rotation", "translation")
    )
    V = np.array([np.array(motion.vector) for motion in data.v])
    return R, o, V, data.J.reshape(6, -1), data.dJ.reshape(6, -1)


@pytest.mark.parametrize("rows", ROWS)
@pytest.mark.parametrize("name", CHAINS)
def test_frame_motion(name, rows, rng, laid):
    """As Pinocchio has it; Y_k's columns are the velocity that a length b adds to the frame's."""
    lever = rng.standard_normal(3)
    model, data, q, v, frame = moving(name, rng, lever)
    place, rows, aligned = [i for i in rows if i < 3], np.array(rows), pin.LOCAL_WORLD_ALIGNED
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    parents, B = np.array([model.njoints - 1, 1]), laid(rng.standard_normal((3, 2)))
    m, given = len(rows), [laid(part) for part in (*arrays_of(data), v, lever)]
    J, Jdot, Jdot_v, xd = filled(m, model.nv), filled(m, model.nv), filled(m), filled(m)
    Y, x, X = filled(m, 2), filled(len(place)), filled(len(place), 2)
    filling = J, Jdot, Jdot_v, xd, Y, x, X
    models.frame_motion(*given, rows, parents, B, *filling)
    assert close(x, pin.updateFramePlacement(model, data, frame).translation[place])
    turned = [data.oMi[int(i)].rotation @ b for i, b in zip(parents, B.T, strict=True)]
    assert close(X, np.transpose(turned)[place])
    expected = pin.getFrameJacobian(model, data, frame, aligned).reshape(6, -1)[rows]
    assert close(J, expected) and close(xd, expected @ v)
    changing = pin.getFrameJacobianTimeVariation(model, data, frame, aligned).reshape(6, -1)
    assert close(Jdot, changing[rows], 1e-11)
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    fast = pin.getFrameClassicalAcceleration(model, data, frame, aligned).vector
    assert close(Jdot_v, fast[rows], 1e-11)
    assert (Y[len(place) :] == 0.0).all()
    for column, parent, b in zip(Y.T, parents, B.T, strict=True):
        lever_b = pin.SE3(np.eye(3), b)
        far = pin.Frame("far", int(parent), 0, lever_b, pin.FrameType.OP_FRAME)
        near = pin.Frame("near", int(parent), 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
        ends = _velocities(model, q, v, far, near)
        assert close(column[: len(place)], (ends[0] - ends[1])[place])
    pin.computeJointJacobiansTimeVariation(model, data, q, NAN * v)
    models.frame_motion(*arrays_of(data), v, lever, rows, parents, B, *filling)
    assert np.isnan(xd).all()


def _velocities(model, q, v, *frames):
    """Return the linear velocities (3) of frames that a copy of the model carries."""
    model = model.copy()
    ids = [model.addFrame(frame) for frame in frames]
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    aligned = pin.LOCAL_WORLD_ALIGNED
    return [pin.getFrameVelocity(model, data, i, aligned).linear for i in ids]


@pytest.mark.parametrize("name", ["panda", "scara", "kinova", "planar_2r"])
def test_translation_rates(name, rng, laid):
    """dJ/dt of a tool that grows by b da/dt, against differences of the frame's Jacobian."""
    b, rate, h, start = rng.standard_normal(3), 0.7, 1e-6, rng.standard_normal(3)
    model, data, q, _, frame = moving(name, rng, start)
    n, place = model.nv, np.array([0, 1, 2])
    pin.computeJointJacobians(model, data, q)
    R = np.array([oMi.rotation for oMi in data.oMi])
    axes, last = laid(np.array(data.J)), np.full(model.njoints, n - 1)
    for rows in (place, place[::2]):
        Jdot, parent = filled(len(rows), n), np.array([model.njoints - 1])
        Jdot[:] = 1.0
        models.add_translation_rates(
            np.array([rate]), parent, laid(b[:, None]), R, axes, last, rows, Jdot
        )
        ends = []
        for t in (h, -h):
            model.frames[frame].placement = pin.SE3(np.eye(3), start + t * rate * b)
            now = model.createData()
            pin.computeJointJacobians(model, now, q)
            pin.updateFramePlacements(model, now)
            ends.append(pin.getFrameJacobian(model, now, frame, pin.LOCAL_WORLD_ALIGNED)[rows])
        assert close(Jdot - 1.0, (ends[0] - ends[1]) / (2.0 * h), 1e-8)


@pytest.mark.parametrize("place", [[0, 1, 2], [0, 2]])
def test_predictions(place, rng, laid):
    lever, B = rng.standard_normal(3), laid(rng.standard_normal((3, 2)))
    model, data, q, _, frame = moving("panda", rng, lever)
    pin.framesForwardKinematics(model, data, q)
    parents, x, X = np.array([7, 2]), filled(len(place)), filled(len(place), 2)
    R, o = (laid(part) for part in arrays_of(data)[:2])
    models.positions_at(R, o, laid(lever), np.array(place), parents, B, x, X)
    assert close(x, data.oMf[frame].translation[place])
    for column, parent, b in zip(X.T, parents, B.T, strict=True):
        assert close(column, (R[parent] @ b)[place])


def test_live_arrays_move_with_the_data(rng):
    model, data, q, _, _ = moving("panda", rng, np.zeros(3))
    live = live_array([oMi.translation for oMi in data.oMi])
    pin.computeJointJacobians(model, data, q)
    assert np.array_equal(live, [oMi.translation for oMi in data.oMi]) and live.any()
    assert not live.flags.writeable
    with pytest.raises(ValueError, match="equal distances"):
        live_array([np.zeros(3), np.zeros((2, 3)).T[0], np.zeros(3)])


def test_translations(rng, laid):
    theta, B, offset = (laid(rng.standard_normal(shape)) for shape in (4, (3, 2), 3))
    for first in range(3):
        translation = filled(3)
        models.place(theta, first, B, offset, translation)
        assert close(translation, offset + B @ theta[first : first + 2])


def test_columns(rng, laid):
    Y, columns, base = laid(rng.standard_normal((3, 30))), np.array([2, 7, 29]), filled(3, 5)
    models.take_columns(Y, columns, base[:, 1:4])
    assert np.array_equal(base[:, 1:4], Y[:, columns]) and np.isnan(base[:, [0, 4]]).all()


@pytest.mark.parametrize("lightest", [1.0, 1e-9, -2.0])
def test_inertias(lightest, rng, laid):
    pi, ballast = rng.standard_normal(30), rng.standard_normal(30)
    pi[::10], ballast[::10] = [3.0, lightest, 4.0], 1.0
    tens = filled(3, 10)
    expected = 1.0 - 2.0 * lightest if lightest < 1e-6 else 0.0
    assert models.take(laid(pi), laid(ballast), tens) == expected
    assert close(tens.ravel(), pi + expected * ballast)


def test_filters(rng, laid):
    X, low, v, x, x_hat, a_k = (
        laid(rng.standard_normal(size)) for size in ((3, 5), 25, 7, 3, 3, 5)
    )
    d, seen = x - x_hat + X @ a_k, (x_hat, a_k, x)
    W, y, a = filled(3, 5), filled(3), filled(7)
    assert not laws.filtered_rates(low[1:], X, *seen, 4.0, v, 60.0, W, y, a)
    assert not laws.filtered_rates(low, X[:, 1:], *seen, 4.0, v, 60.0, W, y, a)
    assert np.isnan(W).all() and np.isnan(y).all() and np.isnan(a).all()
    assert laws.filtered_rates(low, X, *seen, 4.0, v, 60.0, W, y, a)
    assert close(W.ravel(), 4.0 * (X.ravel() - low[:15])) and close(y, 4.0 * (d - low[15:18]))
    assert close(a, 60.0 * (v - low[18:]))
    after, share = filled(25), 1.0 - np.exp(-np.repeat([0.04, 0.6], [18, 7]))
    laws.advance(low, W, y, a, 4.0, 60.0, 1e-2, after)
    assert close(after, low + share * (np.r_[X.ravel(), d, v] - low))


def test_size_of_estimates(rng):
    a_d, a_k, torque = rng.standard_normal(70), rng.standard_normal(3), rng.standard_normal(7)
    assert close(checks.size_of_estimates(a_d, a_k, torque), a_d @ a_d + a_k @ a_k)
    for flaw in (NAN, np.inf, 1e200):
        assert np.isnan(checks.size_of_estimates(a_d, a_k, np.r_[torque, flaw]))
    assert np.isnan(checks.size_of_estimates(np.r_[a_d, NAN], a_k, torque))
    assert np.isinf(checks.size_of_estimates(a_d, np.r_[a_k, np.inf], torque))


def test_checks_of_a_loop(rng, laid):
    """Each against the same in numpy; NaN exceeds no bound."""
    limits = np.full(7, 2.0)
    for _ in range(50):
        x = 1.3 * rng.standard_normal(7)
        beyond = np.flatnonzero(np.abs(x) > limits)
        assert checks.first_beyond(laid(x), limits) == (beyond[0] if beyond.size else -1)
        before, out = 2.0 * rng.standard_normal(7), filled(7)
        changed = checks.limit_torque(laid(x), limits, before, np.full(7, 50.0), 0.01, out)
        last = np.clip(before, -2.0, 2.0)
        kept = np.clip(np.clip(x, last - 0.5, last + 0.5), -2.0, 2.0)
        assert np.array_equal(out, kept) and changed is not np.array_equal(x, kept)
        v, brake = 3.0 * rng.standard_normal(7), rng.uniform(1.0, 20.0, 7)
        way = np.maximum(1.5 * np.abs(v) / 30.0, v * v / (2.0 * brake))
        near = np.where(v > 0.0, x + way > 2.0, x - way < -2.0)
        near = np.flatnonzero(near & (np.abs(v) > 0.01))
        found = checks.first_near_stop(laid(x), laid(v), -limits, limits, brake, 30.0)
        assert found == (near[0] if near.size else -1)
    assert checks.first_beyond(np.full(7, NAN), limits) == -1


NUMBERS = st.floats(width=64) | st.sampled_from([NAN, np.inf, -np.inf, 1e300, -2000.0, 0.0])


@settings(deadline=None)
@given(NUMBERS, NUMBERS, st.floats(0.0, np.inf, exclude_min=True), st.floats(0.0, np.inf))
def test_no_history_takes_a_torque_out_of_its_limit(torque, before, limit, rate):
    arrays = (np.array([each]) for each in (torque, limit, before, rate))
    out, dt = filled(1), 1e-3
    checks.limit_torque(*arrays, dt, out)
    assert abs(out[0]) <= limit
    if abs(before) <= min(limit, 1e300) and np.isfinite(rate) and not np.isnan(torque):
        assert abs(out[0] - before) <= rate * dt * (1.0 + 1e-9) + 1e-12 * abs(before)


SHORT = {  # of each a part of its arrays, one of which is too short
    "descend": lambda z: adaptation.descend(z(3), z(2), z(3, 3), 0.1, z(3)),
    "fit rate": lambda z: adaptation.fit_rate(
        z(2, 2), z(3, 2), z(2), z(3, 3), z(2), 1.0, z(1), z(2)
    ),
    "bodies": lambda z: adaptation.follow_geodesic_of_bodies(z(20), z(10), 0.1, 1.0, z(20)),
    "posture": lambda z: laws.posture_offset(z(6), z(4, 7), z(7)),
    "reference": lambda z: laws.reference(z(3), z(2), z(3), z(3), z(3), 1.0, 1.0, z(3), z(3)),
    "right inverse": lambda z: linear_algebra.right_inverse(z(3, 7), z(3, 3), z(2), z(7), z(7)),
    "place": lambda z: models.place(z(2), 1, z(3, 2), z(3), z(3)),
    "polarise": lambda z: models.polarise(z(7), z(6), z(7), z(7)),
    "limits": lambda z: checks.exceeds(z(7), z(6)),
}


@pytest.mark.parametrize("name", SHORT)
def test_a_kernel_refuses_arrays_whose_sizes_do_not_fit(name):
    """Instead of reading or writing outside of them."""
    with pytest.raises(ArrayError, match="sizes or kinds that do not fit"):
        SHORT[name](lambda *shape: np.zeros(shape))
