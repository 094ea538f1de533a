"""Rotor inertia and friction: regressor, adaptation, and robots whose URDF has rotors."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt.models.joint_effects import KINDS, coefficients
from tests.support.chains import catalogue_robot, chains, each_size, random_state, seeded, seeds
from tests.support.drives import stepped
from tests.support.effects import torque_of_everything, with_everything
from tests.support.loops import circle_beside, energy_along


def stacked(robot, friction=True):
    return pa.make_controller(
        robot, adaptation="natural", unknown=pa.Unknown(friction=friction, armature=True)
    ).dynamics


def inverse_dynamics(robot, q, v, a):
    return pin.rnea(robot.model, robot.model.createData(), q, v, a) + robot.friction.torque(v)


@each_size(seed=0, unknown=KINDS)
@given(
    robot=chains,
    seed=seeds,
    unknown=st.sampled_from([("viscous",), ("armature", "coulomb"), "all", KINDS]),
)
@seeded
def test_effects_of_random_chains(robot, seed, unknown):
    rng = np.random.default_rng(seed)
    true = with_everything(robot, rng)
    bodies = pa.models.BodyDynamics(robot.changed(armature=0.0, viscous=0.0, coulomb=0.0))
    effects = pa.models.JointEffects(true, unknown)
    dynamics = pa.models.StackedDynamics(bodies, effects)
    n = robot.model.nv
    shafts = len(true.friction.shafts)
    if unknown == KINDS:
        assert effects.size == 6 * n + 3 * shafts and effects.signed == 2 * n
    a_d = dynamics.value(true)
    for _ in range(3):
        dynamics.load(a_d)
        q, v, a = random_state(robot, rng)
        tau = torque_of_everything(true, q, v, a)
        Y = dynamics.regressor(q, v, a)
        near = {"rtol": 1e-9, "atol": 1e-10 * np.abs(tau).max()}
        np.testing.assert_allclose(dynamics.torque(q, v, a), tau, **near)
        if unknown == KINDS:
            np.testing.assert_allclose(Y @ a_d, tau, **near)
        Y_r, feedforward = dynamics.slotine_li(q, v, v, a)
        np.testing.assert_allclose(Y_r, Y, atol=1e-9 * np.abs(Y).max())
        np.testing.assert_allclose(feedforward, tau, **near)
        rest = dynamics.torque(q, v, np.zeros(n))
        np.testing.assert_allclose(dynamics.mass_matrix(q) @ a, tau - rest, rtol=1e-7, atol=1e-9)
        now = dynamics.momentum(q, v)
        momentum = dynamics.mass_matrix(q) @ v
        np.testing.assert_allclose(now.Y_M @ a_d + now.p_0, momentum, rtol=1e-7, atol=1e-9)
        dynamics.load(1.3 * a_d)
        np.testing.assert_allclose(dynamics.torque(q, v, a), tau + 0.3 * Y @ a_d, **near)
    back = dynamics.robot(a_d, true)
    np.testing.assert_allclose(torque_of_everything(back, q, v, a), tau, **near)


def test_known_friction_is_compensated_and_unknown_friction_starts_positive():
    robot = catalogue_robot("ur5")
    known = robot.changed(viscous=1.0, coulomb=0.5)
    dynamics = pa.make_controller(
        known, adaptation="natural", unknown=pa.Unknown(friction=False, armature=False)
    ).dynamics
    dynamics.load(dynamics.initial)
    q, v, a = random_state(robot, np.random.default_rng(0))
    np.testing.assert_allclose(
        dynamics.torque(q, v, a), inverse_dynamics(known, q, v, a), atol=1e-10
    )
    assert dynamics.size == 60 and dynamics.value(robot) is None
    assert (stacked(robot).initial[-18:] > 0.0).all()
    np.testing.assert_array_equal(coefficients(known)[1:3], [[1.0] * 6, [0.5] * 6])


@pytest.mark.parametrize(
    "law", ["adaptive-inverse-dynamics", "adaptive-inverse-dynamics-velocity", "adaptive-jacobian"]
)
@pytest.mark.parametrize("name", ["scara", "panda"])
def test_lyapunov_equality_with_friction(law, name):
    """dV/dt = dissipation with unknown rotors and friction, which dissipates in the joints."""
    robot = catalogue_robot(name)
    true = robot.changed(
        armature=0.05, viscous=0.4, coulomb=0.3, tool_translation=[0.02, 0.0, 0.05]
    )
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8),
        law=law,
        unknown=pa.Unknown(friction=True, armature=True),
        gamma_d=2.0,
        gamma_joint=2.0,
    )
    path = circle_beside(true, "xy", by=(0.01, -0.01, 0.01))
    energy = energy_along(true, controller, path, seconds=0.0162, dt=6e-4)
    energy.check(after=17)  # at low speeds tanh is too steep for finite differences


def test_exponentiated_gradient_keeps_estimates_positive():
    adaptation = pa.adaptation.ExponentiatedGradient(10.0, [1.0, 2.0, 30.0])
    rng = np.random.default_rng(0)
    a = np.array([1e-3, 1.0, 100.0])
    for _ in range(200):
        after = stepped(adaptation, a, 1e4 * rng.standard_normal(3), 1e-2)
        assert (after > 0.0).all() and (np.abs(np.log(after / a)) <= 0.02 + 1e-12).all()
        a = after
    with pytest.raises(pa.ParameterError, match="positive"):
        adaptation.init(np.array([0.0, 1.0, 1.0]))
