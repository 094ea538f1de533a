"""Singularities, torque limits, the box of kinematic estimates, and the watch on M_hat."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt.models.right_inverse import RightInverse
from pinadapt.models.typical_motion import felt_mass
from tests.support.chains import catalogue_robot as load
from tests.support.chains import robot_of, seeded, seeds
from tests.support.differences import derivative
from tests.support.drives import rate_of, stepped
from tests.support.loops import motion_at_home

pytestmark = pytest.mark.slow

SHAPES = [(2, 2), (3, 3), (2, 3), (3, 7), (6, 7), (6, 6), (1, 2)]


def jacobian(rng, shape, smallest):
    """Return a random matrix with a given smallest singular value."""
    U, sigma, V = np.linalg.svd(rng.standard_normal(shape), full_matrices=False)
    sigma[-1] = smallest
    return U @ np.diag(sigma) @ V


# --- the right inverse ---


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@given(seed=seeds, log=st.floats(-8.0, 0.0))
@settings(seeded, max_examples=25)
def test_the_inverse_is_bounded_and_its_damping_known(shape, seed, log):
    rng = np.random.default_rng(seed)
    s_0 = 0.1
    J = jacobian(rng, shape, 10.0**log)
    inverse = RightInverse(J, s_0)
    least = np.linalg.svd(J, compute_uv=False).min()
    rounding = 1e-13 * np.linalg.norm(J) ** 2
    assert inverse.conditioning**2 <= least**2 * (1 + 1e-9) + rounding
    assert inverse.conditioning**2 >= least**2 / shape[0] * (1 - 1e-9) - rounding
    (mu_2,) = set(inverse.damping)
    assert (mu_2 > 0.0) == (inverse.conditioning < s_0)
    J_plus = np.stack([inverse.solve(e, np.zeros(shape[1])) for e in np.eye(shape[0])], axis=1)
    assert np.linalg.norm(J_plus, 2) <= (1 + 1e-6) / s_0
    u = rng.standard_normal(shape[0])
    psi = rng.standard_normal(shape[1])
    missed = u - J @ inverse.solve(u, psi)
    share = mu_2 / (least**2 + mu_2)
    assert np.linalg.norm(missed) <= share * np.linalg.norm(u - J @ psi) + 1e-9
    expected = mu_2 * np.linalg.solve(J @ J.T + mu_2 * np.eye(shape[0]), u - J @ psi)
    assert np.allclose(missed, expected)


def conflicting(rng, smallest):
    """A Jacobian (6, 7) of two levels; the second keeps ``smallest`` beside the first."""
    J = jacobian(rng, (3, 7), 0.5)
    own = jacobian(rng, (3, 7), 0.5)
    free = np.linalg.svd(J)[2][3:]
    own[2] = rng.standard_normal(3) @ J + smallest * free[3]
    own[:2] = free[:2] + 0.1 * rng.standard_normal((2, 7))
    return np.concatenate([J, own])


def test_a_level_is_met_exactly_whatever_those_behind_it_ask():
    rng = np.random.default_rng(5)
    s_0 = 0.2
    u = rng.standard_normal(6)
    psi = rng.standard_normal(7)
    for smallest in (0.1, 1e-3, 0.0):
        J = conflicting(rng, smallest)
        order = np.array([1, 4, 0, 3, 5, 2])  # rows of the levels need not be together
        levels = np.repeat([0.0, 1.0], 3)[order]
        inverse = RightInverse(J[order], s_0, levels=levels)
        r = inverse.solve(u[order], psi)
        assert np.allclose(J[:3] @ r, u[:3], atol=1e-9)
        mu_2 = inverse.damping[levels == 1.0][0]
        assert not inverse.damping[levels == 0.0].any() and 0.0 < mu_2 < s_0**2
        fed = inverse.feedback(np.ones(7), 20.0 * u[order], *np.zeros((3, 6)), np.zeros((6, 7)))[0]
        assert np.array_equal(fed == 20.0 * u[order], levels == 0.0)
        # the second one is nearest in what the first leaves: Siciliano and Slotine's recursion
        N = np.eye(7) - np.linalg.pinv(J[:3]) @ J[:3]
        first = psi + np.linalg.pinv(J[:3]) @ (u[:3] - J[:3] @ psi)
        B = J[3:] @ N
        least = B.T @ np.linalg.solve(B @ B.T + mu_2 * np.eye(3), u[3:] - J[3:] @ first)
        assert np.allclose(r, first + least, atol=1e-8)
        alike = RightInverse(J, s_0).solve(u, psi)
        assert np.abs(J[:3] @ alike - u[:3]).max() > 1e-3
    easy = np.linalg.qr(rng.standard_normal((7, 6)))[0].T
    ours = RightInverse(easy, s_0, levels=np.repeat([0.0, 1.0], 3))
    assert np.array_equal(ours.solve(u, psi), RightInverse(easy, s_0).solve(u, psi))


@pytest.mark.parametrize("first", [0.5, 0.1, 1e-3])  # smallest singular value of the first level
@pytest.mark.parametrize("smallest", [0.15, 0.03, 1e-3])
def test_the_rate_of_a_solution_with_priorities_is_its_derivative(smallest, first):
    rng = np.random.default_rng(6)
    s_0 = 0.2
    J = conflicting(rng, smallest)
    Jdot = rng.standard_normal((6, 7))
    U, sigma, V = np.linalg.svd(J[:3], full_matrices=False)
    J[:3] = U @ np.diag([*sigma[:2], first]) @ V
    u, ud = 20.0 * rng.standard_normal((2, 3))
    psi, psid = rng.standard_normal((2, 7))
    w, wd = rng.standard_normal((2, 3))
    A, A_rate = J[:3], Jdot[:3]  # constraints come before all tasks
    task = J[3:]
    task_rate = Jdot[3:]
    levels = np.array([1.0, 0.0, 0.0])

    def inverse(t):
        found = RightInverse(task + t * task_rate, s_0, (A + t * A_rate, A_rate), levels)
        found.moving(w + t * wd, wd)
        return found

    def fed(t):
        return inverse(t).feedback(np.ones(7), u + t * ud, ud, *np.zeros((2, 3)), task_rate)

    def at(t):
        return inverse(t).solve(fed(t)[0], psi + t * psid)

    u_0, ud_0 = fed(0.0)
    r, rate = inverse(0.0).solve_with_rate(u_0, psi, ud_0, psid, task_rate)
    assert np.allclose(r, at(0.0), rtol=1e-12)
    assert np.allclose(derivative(at, h=1e-6), rate, rtol=1e-4, atol=1e-4 * np.abs(rate).max())
    if first == 0.5:
        r, _ = inverse(0.0).keeping(np.full(7, 1e3), r, rate, 500.0 * psi, psid, task_rate)
        assert np.allclose(A @ r, w, atol=1e-9)  # no damping there


@pytest.mark.parametrize("smallest", [0.5, 0.15, 0.03, 1e-3, 1e-6])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_solution_has_an_exact_rate_and_keeps_speed_limits_smoothly(shape, smallest):
    """Null motion and sum are shortened, with exact rates; slow ones are the same to the bit.

    The damping varies too; the passivity-based law uses the exact derivative of q_r.
    """
    rng, s_0, (m, n) = np.random.default_rng(4), 0.2, shape
    J = jacobian(rng, shape, smallest)
    Jdot = rng.standard_normal(shape)
    inverse = RightInverse(J, s_0)
    speeds = rng.uniform(0.5, 2.0, n)
    u, ud, psi, psid = (rng.standard_normal(k) for k in (m, m, n, n))
    if inverse.unique:
        psi = psid = None
    seen = set()
    still = np.zeros(n)

    def kept(inverse, u, psi, ud, psid, Jdot):
        u, ud = inverse.feedback(speeds, u, ud, np.zeros(m), np.zeros(m), Jdot)
        free = inverse.solve_with_rate(u, psi, ud, psid, Jdot)
        return free, inverse.keeping(speeds, *free, psi, psid, Jdot)

    for size in (1e-3, 0.1, 0.3, 1.0, 3.0, 30.0):

        def given(t, size=size):
            return size * (u + t * ud), None if psi is None else size * (psi + t * psid)

        def at(t, given=given):
            there = RightInverse(J + t * Jdot, s_0)
            none = None if psi is None else still
            return kept(there, *given(t), np.zeros(m), none, np.zeros(shape))[1][0]

        moving = (size * ud, None if psi is None else size * psid, Jdot)
        (free, free_rate), (r, rate) = kept(inverse, *given(0.0), *moving)
        assert np.abs(r / speeds).max() < 1.06 and np.array_equal(r, at(0.0))
        numerical = derivative(at, h=1e-6)
        assert np.allclose(numerical, rate, rtol=1e-4, atol=1e-4 * np.abs(rate).max())
        if size == 1e-3:
            assert r is free and rate is free_rate
        seen.add(r is free)
    assert seen == {True, False}
    null = kept(inverse, np.zeros(m), None if psi is None else 1e3 * psi, *moving)[1][0]
    assert np.abs(null / speeds).max() < 0.55


def test_damping_brings_the_arm_back_from_beyond_its_reach():
    robot = load("ur5")
    far = [0.36, 0.0, 0.0]
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8), law="adaptive-inverse-dynamics", gamma_d=0.8, dt=2e-3
    )
    path = pa.trajectories.Waypoints([np.zeros(3), far, np.zeros(3)], 1.5)
    path = path.starting_at(robot.position(robot.q0))
    rollout = pa.simulate(robot, controller.limited(None), path, duration=3.5)
    assert rollout.diverged is None
    assert rollout.distance.max() > 0.02  # out of reach indeed
    assert rollout.distance[-1] < 2e-3
    least = rollout.min_singular_J_hat
    assert least.min() < 0.3 * least[0]


# --- torque limits ---


def test_estimates_do_not_wind_up_while_motors_saturate():
    """With weak motors from 15 cm off the path."""
    robot = load("ur5")
    true = robot.changed(
        tool_translation=[0.02, -0.03, 0.08], payload=pa.Payload(1.0, [0.0, 0.0, 0.05])
    )
    hold = np.abs(pin.rnea(true.model, true.model.createData(), true.q0, np.zeros(6), np.zeros(6)))
    limits = 1.3 * np.maximum(hold, 0.3 * hold.max())
    believed = robot.changed(inertial_scale=0.8)
    felt = felt_mass(believed)
    gains = {"Kp": 400.0 * felt, "Kv": 40.0 * felt, "gamma_d": 0.76, "gamma_k": 0.013, "R_k": 193.0}
    controller = pa.make_controller(
        believed,
        law="adaptive-jacobian",
        limits=pa.Limits(torque=limits, guards=False),
        dt=2e-3,
        **{"alpha": 5.0, "lambda_": 10.0, "posture": 4.0, **gains},
    )
    start = true.position(true.q0) + np.array([0.1, 0.05, 0.1])
    path = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz").starting_at(start).as_given()
    engine = pa.Engine(substeps=1, torque_limits=False)
    rollout = pa.simulate(true, controller, path, duration=2.5, engine=engine)
    assert rollout.diverged is None
    assert 0.01 < rollout.summary()["saturated"] < 0.5
    assert (np.abs(rollout.tau) <= limits).all()
    assert (rollout.saturated == (np.abs(rollout.tau) == limits).any(axis=1)).all()
    travel = np.linalg.norm(rollout.a_d - rollout.a_d[0], axis=1).max()
    assert travel < 2.0 * np.linalg.norm(rollout.a_d[0])  # without the rest a hundred times as far
    assert rollout.distance[-1] < 0.01 * rollout.distance[0] + 5e-3


def moving(law):
    """Return a UR5's controller with the first sample, in motion, and what is desired."""
    robot = robot_of(law, "ur5")
    controller = pa.make_controller(
        robot, law=law, adaptation="gradient", limits=pa.Limits(torque=False)
    )
    measurement = pa.plants.PinocchioPlant(robot).measurement(robot.q0, np.linspace(0.1, 0.4, 6))
    return controller, measurement, motion_at_home(robot).at(0.1)


@pytest.mark.parametrize("law", pa.laws.LAWS)
def test_a_saturated_sample_does_not_adapt_the_dynamics(law):
    controller, measurement, desired = moving(law)
    state = controller.init(measurement)
    signals = controller.observe(state, measurement, desired).replaced(a=np.full(6, 0.3))
    free, drives = controller.respond(state, signals)
    tight = controller.limited(0.5 * np.abs(free))
    clipped, rest = tight.respond(state, signals)
    assert np.allclose(clipped, 0.5 * free)
    tracking = controller.law.adapts and not controller.law.learns_from_torque
    assert drives.dynamic.gradient.any() == tracking
    assert not rest.dynamic.gradient.any()
    assert rest.dynamic.gradient.shape == state.a_d.shape
    after = tight.step(state, measurement, desired, 1e-3)[1]
    assert np.array_equal(after.a_d, state.a_d)
    assert controller.limits.torque is None  # the copy did not change it


# --- the box ---


def nearest(x, metric, low, high):
    """Return the point of a box nearest to x, the best over all sets of entries at a wall."""
    candidates = []
    for walls in product(("low", "high", "free"), repeat=x.size):
        free = np.array([wall == "free" for wall in walls])
        y = np.where([wall == "low" for wall in walls], low, high)
        if not np.isfinite(y[~free]).all():
            continue
        pull = metric[np.ix_(free, ~free)] @ (y - x)[~free]
        y[free] = x[free] - np.linalg.solve(metric[np.ix_(free, free)], pull)
        if (y >= low).all() and (y <= high).all():
            candidates.append(y)
    return min(candidates, key=lambda y: (y - x) @ metric @ (y - x))


@pytest.mark.parametrize("diagonal", [True, False])
@given(seed=seeds)
@settings(seeded, max_examples=25)
def test_projection_is_the_nearest_point_in_the_metric_and_v_only_improves(diagonal, seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3, 3))
    Gamma = np.diag(rng.uniform(0.1, 3.0, 3)) if diagonal else A @ A.T + 0.1 * np.eye(3)
    low = -rng.uniform(0.1, 1.0, 3)
    high = rng.uniform(0.1, 1.0, 3)
    inner = pa.adaptation.Gradient(Gamma, 3)
    boxed = pa.adaptation.BoxProjection(inner, low, high)
    g = 5.0 * rng.standard_normal(3)
    metric = np.linalg.inv(Gamma)
    a = np.where(rng.uniform(size=3) < 0.5, low, rng.uniform(low, high))  # often at a wall
    moved = stepped(boxed, a, g, 0.5)
    free = stepped(inner, a, g, 0.5)
    assert (moved >= low).all() and (moved <= high).all()
    assert np.allclose(moved, nearest(free, metric, low, high), atol=1e-7)
    rate = rate_of(boxed, a, g)
    free_rate = rate_of(inner, a, g)
    scale = np.abs(free_rate).max()
    inward = np.where(a <= low, 0.0, -np.inf)
    expected = nearest(free_rate / scale, metric, inward, np.full(3, np.inf))
    assert np.allclose(rate / scale, expected, atol=1e-7)
    a_true = rng.uniform(low, high)
    assert (a - a_true) @ metric @ (rate - free_rate) <= 1e-9 * scale
    assert (
        boxed.storage(pa.adaptation.Estimate(moved), a_true)
        <= inner.storage(pa.adaptation.Estimate(free), a_true) + 1e-12
    )
    assert np.array_equal(
        rate_of(boxed, np.zeros(3), g), rate_of(inner, np.zeros(3), g)
    )  # inside it is the inner one


def test_estimates_stay_in_their_box():
    """The tool is 8 cm off; a box of 3 cm holds the estimate at its wall, in both modes."""
    robot = load("ur5")
    true = robot.changed(tool_translation=[0.0, 0.0, 0.08])
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 1.0, "yz").starting_at(true.position(true.q0))
    for engine in (pa.Engine(substeps=1), pa.Engine(continuous=True)):
        runs = {}
        for box in (0.03, False):
            controller = pa.make_controller(
                robot, adaptation="natural", limits=pa.Limits(box=box), gamma_k=0.5, dt=2e-3
            )
            runs[box] = pa.simulate(true, controller, path, duration=0.15, engine=engine)
            assert runs[box].diverged is None
        low = controller.kinematics.initial - 0.03
        high = controller.kinematics.initial + 0.03
        outside = (
            2e-3 if engine.continuous else 1e-12
        )  # an integrator's step passes the wall by a little
        assert (runs[0.03].a_k >= low - outside).all() and (runs[0.03].a_k <= high + outside).all()
        assert np.abs(runs[False].a_k - controller.kinematics.initial).max() > 0.05
