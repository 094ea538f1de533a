"""The prediction error of the torque under constraints, and memories and friction that use it."""

from itertools import islice

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.standing import Sway
from pinadapt.filters import FilteredRegressor
from pinadapt.models.joint_effects import JointEffects
from tests.constraints.test_grasp import holding
from tests.constraints.test_loops import delta, five_bar, gripper
from tests.constraints.test_standing import TRUNK, standing


def a1():
    return standing("a1", task="xyz")


def talos():
    return standing("talos")


def prediction_error(true, dt):
    """Return the largest |W a - y| at the true parameters a, and the largest |y|, sampled."""
    controller = pa.make_controller(true, unknown=pa.Unknown(friction=False, armature=False))
    x = true.position(true.q0)
    path = pa.trajectories.Sinusoid(x, 0.02 * np.ones(x.size), 0.5 + 0.1 * np.arange(x.size))
    a_d = controller.dynamics.value(true)
    plant = pa.plants.PinocchioPlant(true, substeps=4)
    errors = []
    torques = []
    for sample in islice(pa.run(plant, controller, path, dt=dt), round(0.05 / dt)):
        s = controller.observe(sample.state, sample.measurement, sample.desired)
        errors.append(np.abs(s.filtered_torque.error(a_d)).max())
        torques.append(np.abs(s.filtered_torque.y).max())
    return max(errors), max(torques)


@pytest.mark.parametrize("make", [gripper, five_bar, delta, a1])
def test_no_force_of_a_constraint_is_in_the_prediction(make):
    """The error is that of sampling, which falls with the square of the period."""
    true = make().changed(friction=pa.Friction(), armature=0.0)
    (coarse, _), (fine, torque) = (prediction_error(true, dt) for dt in (2e-3, 1e-3))
    assert fine < 1e-4 * torque and fine < 0.35 * coarse


@pytest.mark.parametrize("make", [a1, talos, five_bar, delta, holding])
def test_rows_and_their_projection_have_the_rates_of_differences(make):
    robot = make()
    constraints = robot.constrained
    stands = np.arange(4) != 1 if make is a1 else None
    rng = np.random.default_rng(3)
    h = 1e-6
    n = robot.model.nv
    q = robot.q0 + 0.1 * rng.standard_normal(n)
    v = rng.standard_normal(n)
    (A, A_rate), (P, P_rate) = constraints.at(q, v), constraints.free(q, v, stands)
    before, after = (
        (constraints.at(way, v)[0], constraints.free(way, v, stands)[0])
        for way in (q - h * v, q + h * v)
    )
    for rate, old, new in zip((A_rate, P_rate), before, after, strict=True):
        assert np.allclose(rate, (new - old) / (2.0 * h), atol=1e-6)
    assert np.abs(P @ A[constraints.holding(stands)].T).max() < 1e-12 and np.allclose(P @ P, P)


def test_filters_begin_anew_where_a_foot_is_lifted():
    robot = standing("a1")
    controller = pa.make_controller(robot, unknown=TRUNK)
    filters = FilteredRegressor(controller.dynamics, 30.0, constraints=robot.constrained)
    q = robot.q0
    v = np.zeros(18)
    tau = np.ones(18)
    state = filters.step(filters.observe(filters.init(q, v), q, v), tau, 1e-2)
    stays = filters.observe(state, q, v)
    lifted = filters.observe(state, q, v, stands=np.array([True, True, False, True]))
    assert np.abs(stays.W).max() > 0.1 and np.abs(stays.y).max() > 0.1
    assert not lifted.W.any() and not lifted.y.any()
    y = filters.step(lifted, tau, 1e-2).y
    assert np.allclose(y[12:15], -np.expm1(-0.3))  # a free leg shows its torques


def test_a_free_base_has_no_friction_and_no_rotors():
    robot = standing("a1").changed(coulomb=3.0, armature=0.1)
    assert np.array_equal(robot.friction.coulomb, 3.0 * robot.motors)
    assert np.array_equal(robot.model.armature, 0.1 * robot.motors)
    effects = JointEffects(robot)
    assert effects.size == 3 * 12
    assert not any(name.startswith("base") for name in effects.names)
    state = robot.q0, np.ones(18), np.ones(18)
    Y, _ = effects.added(effects.known, *state, 1.0, np.zeros((18, 0)), np.zeros(18))
    assert not Y[:6].any() and np.linalg.matrix_rank(Y[6:]) == 12


@pytest.mark.slow
def test_a_load_is_found_in_spite_of_friction_in_the_joints():
    """In MuJoCo; friction of 2 % of the efforts that the controller does not know."""
    robot = standing("a1")
    high = robot.q0[2]
    efforts = 0.02 * robot.model.effortLimit * robot.motors
    true = robot.changed(
        payload=pa.Payload(5.0, [0.2 * high, 0.08 * high, 0.32 * high]),
        friction=pa.Friction(coulomb=efforts, viscous=0.5 * efforts),
    )
    unknown = pa.Unknown(bodies="payload", friction=True, armature=False)
    controller = pa.make_controller(robot, unknown=unknown, dt=2e-3)
    run = pa.simulate(true, controller, Sway(robot), duration=1.4, engine="mujoco")
    assert run.distance[-150:].max() < 1e-4
    assert run.a_d[-1, 0] == pytest.approx(true.model.inertias[6].mass, rel=0.01)
