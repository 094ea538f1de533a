"""Every dynamic regressor against RNEA, CRBA and finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given

import pinadapt as pa
from pinadapt.models.regressor import Regressor, inertial_parameters
from tests.support.chains import catalogue_robot, chains, each_size, random_state, seeded
from tests.support.differences import derivative

ROBOTS = ["planar_2r", "scara", "ur5", "panda", "kinova", "tiago_arm", "talos_arm"]


def check_identities(robot):
    """Y pi = rnea; the Slotine-Li form with the Christoffel matrix; dM/dt - 2 C skew."""
    rng = np.random.default_rng(5)
    model = robot.model.copy()
    data = robot.model.createData()
    model.armature = np.zeros(model.nv)
    Y = Regressor(model)
    pi = inertial_parameters(model)
    q, v, a = random_state(robot, rng)
    v_r, a_r = rng.standard_normal((2, model.nv))
    scale = 1.0 + np.abs(pin.rnea(model, data, q, v, a)).max()
    assert Y(q, v, a).shape == Y.slotine_li(q, v, v_r, a_r).shape == (model.nv, 10 * model.nv)
    assert np.allclose(Y(q, v, a) @ pi, pin.rnea(model, data, q, v, a), atol=1e-11 * scale)
    C = pin.computeCoriolisMatrix(model, data, q, v)
    M = pin.crba(model, data, q)
    g = pin.computeGeneralizedGravity(model, data, q)
    slotine_li = Y.slotine_li(q, v, v_r, a_r)
    assert np.allclose(slotine_li @ pi, M @ a_r + C @ v_r + g, atol=1e-10 * scale)
    assert np.allclose(Y.slotine_li(q, v, v, a), Y(q, v, a), atol=1e-10 * scale)
    # The C behind the regressor, column by column, makes dM/dt - 2 C skew-symmetric.
    zero = np.zeros(model.nv)
    rest = Y.slotine_li(q, v, zero, zero) @ pi
    C_Y = np.stack([Y.slotine_li(q, v, e, zero) @ pi - rest for e in np.eye(model.nv)], axis=1)
    Mdot = derivative(lambda t: pin.crba(model, data, pin.integrate(model, q, t * v)))
    skew = Mdot - 2.0 * C_Y
    assert np.allclose(skew, -skew.T, atol=1e-7 * scale)


@pytest.mark.parametrize("name", ROBOTS)
def test_identities_on_robots(name):
    check_identities(catalogue_robot(name))


@each_size()
@given(robot=chains)
@seeded
def test_identities_on_random_chains(robot):
    check_identities(robot)


@pytest.mark.parametrize("masses", ["zero", "negative", "tiny"])
def test_estimates_with_zero_or_negative_masses_are_evaluated_exactly(masses):
    robot = catalogue_robot("ur5")
    dynamics = pa.models.BodyDynamics(robot, "all")
    rng = np.random.default_rng(1)
    a_hat = dynamics.initial + 0.1 * rng.standard_normal(dynamics.size)
    a_hat[::10] = {"zero": 0.0, "negative": -1.0, "tiny": 1e-12}[masses]
    q, v, a = random_state(robot, rng)
    dynamics.load(a_hat)
    expected = dynamics.regressor(q, v, a) @ a_hat
    assert np.allclose(dynamics.torque(q, v, a), expected, atol=1e-9)
    zero = np.zeros(6)
    columns = [
        (dynamics.regressor(q, zero, e) - dynamics.regressor(q, zero, zero)) @ a_hat
        for e in np.eye(6)
    ]
    assert np.allclose(dynamics.mass_matrix(q), np.stack(columns, axis=1), atol=1e-9)
