"""Every kernel against an independent numpy formula, on any memory layout, with NaN."""

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt import _compiled
from pinadapt.adaptation import box_projection, natural
from pinadapt.adaptation.box_projection import BoxProjection
from pinadapt.adaptation.gradient import Gradient
from pinadapt.adaptation.natural import Natural
from pinadapt.controller import controller, filters
from pinadapt.exceptions import DivergedError
from pinadapt.laws import estimated_velocity, inertia
from pinadapt.models import frame_kinematics, inertial_model, lumped_basis, right_inverse
from pinadapt.models.right_inverse import RightInverse

_compiled.compile_all()
LAYOUTS = {
    "C": np.ascontiguousarray,
    "F": np.asfortranarray,
    "strided": lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
}
NAN = float("nan")


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.fixture(params=LAYOUTS)
def laid(request):
    return LAYOUTS[request.param]


def filled(*shape):
    return np.full(shape, NAN)


def close(a, b):
    return np.allclose(a, b, rtol=1e-12, atol=1e-12)


def test_all_kernels_are_machine_code_once_a_controller_is_made():
    code = (
        "import sys, pinadapt as pa; from pinadapt import _compiled\n"
        "from pinadapt.adaptation import natural\n"
        "assert 'numba' not in sys.modules and _compiled._waiting\n"
        "pa.make_controller(pa.load('planar_2r'))\n"
        "assert not _compiled._waiting and natural._follow_geodesic.signatures\n"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=300).returncode == 0


def test_kernels_have_one_specialisation_each():
    for module in (
        natural,
        box_projection,
        controller,
        filters,
        estimated_velocity,
        inertia,
        right_inverse,
        inertial_model,
        frame_kinematics,
        lumped_basis,
    ):
        kernels = [thing for thing in vars(module).values() if hasattr(thing, "py_func")]
        assert kernels
        for kernel in kernels:
            assert len(kernel.signatures) == 1 and kernel.__doc__


def cones():
    robot = pa.load("panda")
    bodies = pa.make_controller(robot)
    lmi = np.array([[[1.0, 0], [0, 0]], [[0.0, 1], [1, 0]], [[-1.0, 0], [0, 1]]])
    return {
        "bodies": (bodies.adaptation_d.cone, bodies.dynamics.initial),
        "planar": (pa.MatrixInequality(lmi), np.array([3.34, 1.2, 0.97])),
        "offset": (pa.MatrixInequality(lmi, offset=0.3 * np.eye(2)), np.array([3.34, 1.2, 0.97])),
    }


@pytest.mark.parametrize("which", ["bodies", "planar", "offset"])
@pytest.mark.parametrize("size", [1e-6, 3e-3, 1.0, 1e3])
def test_geodesic(which, size, rng):
    cone, a = cones()[which]
    adaptation, g, dt = Natural(0.7, cone), size * rng.standard_normal(a.size), 1e-2
    P, L, h = cone.matrices(a), cone.covectors(g), 0.7 * dt
    change = P @ L @ P
    length = h * np.sqrt(sum(np.trace(ell @ c) for ell, c in zip(L, change, strict=True)))
    if length > 0.02:
        h *= 0.02 / length
    if length > 0.003:
        change = change - 0.5 * h * P @ L @ change
    after = adaptation.advance(a, g, dt)
    assert close(after, a - h * cone.components(change)) and cone.contains(after)
    assert np.abs(after - a).max() > 0.0
    assert close(adaptation.advance(np.repeat(a, 2)[::2], g, dt), after)
    g[0] = NAN
    assert np.isnan(adaptation.advance(a, g, dt)).any()


@pytest.mark.parametrize("shape", [(2, 2), (2, 5), (3, 3), (3, 7), (6, 6), (6, 7)])
def test_right_inverse(shape, rng, laid):
    m, n = shape
    J = laid(rng.standard_normal(shape))
    u, psi = rng.standard_normal(m), rng.standard_normal(n)
    s = np.trace(np.linalg.inv(J @ J.T)) ** -0.5
    for threshold in (0.0, 0.5 * s, 3.0 * s):
        inverse = RightInverse(J, threshold)
        mu_2 = 0.5 * (threshold**2 - s**2) if s < threshold else 0.0
        J_plus = J.T @ np.linalg.inv(J @ J.T + mu_2 * np.eye(m))
        assert np.isclose(inverse.smallest, s) and np.isclose(inverse.damping, mu_2)
        assert np.allclose(
            inverse.solve(u, psi), J_plus @ u + psi - J_plus @ J @ psi, rtol=1e-9, atol=1e-9
        )
    for flawed in (np.where(np.eye(m, n) > 0, NAN, J), np.zeros(shape)):
        with pytest.raises(DivergedError):
            RightInverse(flawed, 0.0)
    with pytest.raises(DivergedError):
        RightInverse(np.full(shape, NAN), 0.1)


@pytest.mark.parametrize("n", [1, 2, 6, 7])
def test_solve_definite(n, rng, laid):
    root, w = rng.standard_normal((n, n)), rng.standard_normal(n)
    M, x = laid(root @ root.T + 0.1 * np.eye(n)), filled(n)
    assert inertia._solve_definite(M, w, x) and close(M @ x, w)
    indefinite, unknown = M - 1e3 * np.eye(n), M.copy()
    unknown[-1, 0] = NAN
    for flawed in (indefinite, unknown):
        assert not inertia._solve_definite(flawed, w, x)


@pytest.mark.parametrize(("m", "m_p", "p"), [(2, 2, 2), (3, 3, 3), (6, 3, 5), (3, 3, 0)])
def test_law_algebra(m, m_p, p, rng, laid):
    K_v, K_P, R_k = (laid(rng.standard_normal((k, k))) for k in (m, m, m_p))
    Y_k, W_k = laid(rng.standard_normal((m, p))), laid(rng.standard_normal((m_p, p)))
    dx, dxd, xdd, Jdot_v = rng.standard_normal((4, m))
    a_k, rate, y = rng.standard_normal(p), rng.standard_normal(p), rng.standard_normal(m_p)
    g_k = filled(p)
    estimated_velocity._kinematic_gradient(K_P, dx, 5.0, dxd, Y_k, W_k, R_k, a_k, y, g_k)
    assert close(g_k, W_k.T @ R_k @ (W_k @ a_k - y) - Y_k.T @ (K_P @ dx + 5.0 * dxd))
    J, force = laid(rng.standard_normal((m, 7))), filled(7)
    estimated_velocity._error_force(J, dxd, 5.0, dx, force)
    assert close(force, J.T @ (dxd + 5.0 * dx))
    (offset, qd), G, v = rng.standard_normal((2, 7)), laid(rng.standard_normal((m, m))), filled(7)
    u, psi = xdd - K_v @ dxd - K_P @ dx - (Jdot_v + Y_k @ rate), -8.0 * qd - 16.0 * offset
    estimated_velocity._commanded_acceleration(
        xdd, K_v, dxd, K_P, dx, Jdot_v, Y_k, rate, J, G, qd, offset, 4.0, v
    )
    assert np.allclose(v, psi + J.T @ G @ (u - J @ psi), rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize(("m", "k"), [(2, 1), (3, 3), (3, 1)])
def test_velocity_algebra(m, k, rng, laid):
    R, B, w = (
        laid(rng.standard_normal((m, 3))),
        laid(rng.standard_normal((3, k))),
        rng.standard_normal(3),
    )
    Y = np.zeros((6, k + 2))
    frame_kinematics._velocity_regressor(R, w, B, Y[:, 1 : k + 1])
    expected = np.zeros((6, k + 2))
    expected[:m, 1 : k + 1] = R @ pin.skew(w) @ B
    assert close(Y, expected)


def test_columns(rng, laid):
    Y, columns, base = laid(rng.standard_normal((3, 30))), np.array([2, 7, 29]), filled(3, 5)
    lumped_basis._take_columns(Y, columns, base[:, 1:4])
    assert np.array_equal(base[:, 1:4], Y[:, columns]) and np.isnan(base[:, [0, 4]]).all()


def test_filters(rng, laid):
    W, Y = laid(rng.standard_normal((3, 5))), laid(rng.standard_normal((3, 5)))
    (xi, y, xd_hat), (z, v), a_k = (
        rng.standard_normal((3, 3)),
        rng.standard_normal((2, 7)),
        rng.standard_normal(5),
    )
    after = filled(3, 5), filled(3), filled(7)
    filters._advance(W, Y, a_k, xi, y, xd_hat, 0.1, z, v, 0.2, *after)
    y_0 = xd_hat - Y @ a_k
    assert (
        close(after[0], 0.9 * W + 0.1 * Y)
        and close(after[1], xi + 0.1 * (y + y_0))
        and close(after[2], 0.8 * z + 0.2 * v)
    )


def test_squares(rng):
    a_d, a_k, torque = rng.standard_normal(70), np.zeros(0), rng.standard_normal(7)
    assert close(controller._squares(a_d, a_k, torque), (a_d @ a_d, torque @ torque))
    for place in range(2):
        arrays = [a_d.copy(), torque.copy()]
        arrays[place][-1] = NAN
        assert np.isnan(controller._squares(arrays[0], a_k, arrays[1])[place])


@pytest.mark.parametrize("lightest", [1.0, 1e-9, -2.0])
def test_ballast(lightest, rng):
    pi, ballast = rng.standard_normal(30), rng.standard_normal(30)
    pi[::10] = [3.0, lightest, 4.0]
    tens = filled(3, 10)
    c = inertial_model._take(pi, ballast, tens)
    assert c == (1.0 - lightest if lightest < 1e-6 else 0.0)
    assert close(tens.ravel(), pi + c * ballast)


def test_descent_in_a_box(rng):
    root = rng.standard_normal((3, 3))
    Gamma, a, g, after = root @ root.T + np.eye(3), np.zeros(3), rng.standard_normal(3), filled(3)
    wide, narrow = np.full(3, 10.0), np.full(3, 1e-3)
    assert box_projection._descend(a, g, Gamma, 0.1, -wide, wide, after)
    assert close(after, -0.1 * Gamma @ g)
    assert not box_projection._descend(a, g, Gamma, 0.1, -narrow, narrow, after)
    boxed = BoxProjection(Gradient(0.5, 3), -narrow, narrow)
    assert np.array_equal(boxed.advance(a, g, 0.1), np.clip(-0.05 * g, -narrow, narrow))
    assert not box_projection._descend(a, g * NAN, Gamma, 0.1, -wide, wide, after)


@pytest.mark.parametrize("field", ["q", "v", "x"])
@pytest.mark.parametrize("task", ["xyz", "pose"])
def test_a_nan_is_named_and_leaves_the_state_alone(field, task):
    robot = pa.load("panda", task=task)
    control = pa.make_controller(robot)
    v = np.full(7, 0.1)
    measurement = pa.PinocchioPlant(robot).measurement(robot.q0, v)
    m = robot.task.size
    desired = pa.Desired(measurement.x, np.zeros(m), np.zeros(m))
    state = control.init(measurement)
    before = [np.array(part) for part in state]
    broken = getattr(measurement, field).copy()
    broken[1] = NAN
    with pytest.raises(pa.MeasurementError, match=f"'{field}'"):
        control.step(state, measurement._replace(**{field: broken}), desired, 1e-3)
    with pytest.raises(pa.InputError, match="desired"):
        control.step(state, measurement, desired._replace(xdd_d=np.full(m, NAN)), 1e-3)
    assert all(np.array_equal(a, b) for a, b in zip(before, state, strict=True))


def test_numbers_that_are_not_floats():
    robot = pa.load("panda")
    control = pa.make_controller(robot)
    x = robot.position(robot.q0)
    measurement = pa.Measurement(0.0, robot.q0, np.ones(7), x)
    desired = pa.Desired(x, np.zeros(3), np.ones(3))
    state = control.init(measurement)
    torque, after = control.step(state, measurement, desired, 1e-3)
    whole = pa.Desired(x, np.zeros(3, dtype=int), np.ones(3, dtype=int))
    frozen = np.ones(7)
    frozen.flags.writeable = False
    for v in (np.ones(7, dtype=np.float32), frozen):
        same, too = control.step(state, measurement._replace(v=v), whole, 1e-3)
        assert np.array_equal(torque, same) and np.array_equal(after.a_d, too.a_d)


def test_wrong_sizes_never_reach_a_kernel():
    robot = pa.load("panda")
    control, other = (
        pa.make_controller(robot),
        pa.make_controller(robot, kinematic=["tool:length"], dynamic="payload"),
    )
    x = robot.position(robot.q0)
    measurement = pa.Measurement(0.0, robot.q0, np.zeros(7), x)
    desired = pa.Desired(x, np.zeros(3), np.zeros(3))
    state = control.init(measurement)
    for flawed in (desired._replace(xdd_d=np.zeros(2)), desired._replace(xdd_d=np.zeros(4))):
        with pytest.raises(pa.InputError, match="desired"):
            control.step(state, measurement, flawed, 1e-3)
    with pytest.raises(pa.InputError, match="state"):
        control.step(other.init(measurement), measurement, desired, 1e-3)
