"""Every dynamic regressor against RNEA, CRBA and finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given

import pinadapt as pa
from pinadapt.models.basis import identifiable
from pinadapt.models.regressor import Regressor, inertial_parameters
from tests.support.chains import catalogue_robot, chains, each_size, random_state, seeded
from tests.support.differences import derivative
from tests.support.paper import BASIS

ROBOTS = ["planar_2r", "scara", "ur5", "panda", "kinova", "tiago_arm", "talos_arm"]


def check_identities(robot):
    """Y pi = rnea; the Slotine-Li form with the Christoffel matrix; dM/dt - 2 C skew."""
    rng = np.random.default_rng(5)
    model, data = robot.model.copy(), robot.model.createData()
    model.armature = np.zeros(model.nv)
    Y, pi = Regressor(model), inertial_parameters(model)
    q, v, a = random_state(robot, rng)
    v_r, a_r = rng.standard_normal((2, model.nv))
    scale = 1.0 + np.abs(pin.rnea(model, data, q, v, a)).max()
    assert Y(q, v, a).shape == Y.slotine_li(q, v, v_r, a_r).shape == (model.nv, 10 * model.nv)
    assert np.allclose(Y(q, v, a) @ pi, pin.rnea(model, data, q, v, a), atol=1e-11 * scale)
    C = pin.computeCoriolisMatrix(model, data, q, v)
    M, g = pin.crba(model, data, q), pin.computeGeneralizedGravity(model, data, q)
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


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("unknown", ["all", "payload", "none", "one"])
def test_torque_and_mass_matrix_are_affine_in_the_estimate(name, unknown):
    robot = catalogue_robot(name)
    dynamics = pa.models.BodyDynamics(robot, robot.joint_names[0] if unknown == "one" else unknown)
    rng = np.random.default_rng(0)
    q, v, a = random_state(robot, rng)
    data = robot.model.createData()
    assert np.allclose(
        dynamics.torque(q, v, a), pin.rnea(robot.model, data, q, v, a)
    )  # armature included
    assert np.allclose(dynamics.mass_matrix(q), pin.crba(robot.model, data, q))
    a_hat = dynamics.initial + rng.standard_normal(dynamics.size)  # unphysical on purpose
    known = dynamics.torque(q, v, a) - dynamics.regressor(q, v, a) @ dynamics.initial
    M0 = dynamics.mass_matrix(q)
    dynamics.load(a_hat)
    assert np.allclose(
        dynamics.torque(q, v, a), dynamics.regressor(q, v, a) @ a_hat + known, atol=1e-9
    )
    zero = np.zeros(robot.model.nv)
    for i, e in enumerate(np.eye(robot.model.nv)):
        change = (dynamics.regressor(q, zero, e) - dynamics.regressor(q, zero, zero)) @ (
            a_hat - dynamics.initial
        )
        assert np.allclose(dynamics.mass_matrix(q)[:, i] - M0[:, i], change, atol=1e-9)
    Y_r, torque = dynamics.slotine_li(q, v, v, a)
    assert np.allclose(Y_r, dynamics.regressor(q, v, a), atol=1e-10)
    assert np.allclose(torque, dynamics.torque(q, v, a), atol=1e-9)


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


def test_basis_of_wang_and_xie():
    robot = catalogue_robot("planar_2r")
    dynamics = pa.models.BasisDynamics(robot, BASIS)
    assert np.allclose(dynamics.initial, [3.34, 1.2, 0.97], atol=1e-9)
    a1, a2, a3 = a_hat = np.array([4.0, 0.5, 0.5])
    dynamics.load(a_hat)
    q, (v1, v2) = np.array([0.4, -1.1]), (0.7, -0.3)
    c, s = np.cos(q[1]), np.sin(q[1])
    M = np.array([[a1 + 2 * a2 * c, a3 + a2 * c], [a3 + a2 * c, a3]])
    h = np.array([-a2 * s * (2 * v1 * v2 + v2 * v2), a2 * s * v1 * v1])
    assert np.allclose(dynamics.mass_matrix(q), M, atol=1e-12)
    v, a = np.array([v1, v2]), np.array([0.2, 1.3])
    assert np.allclose(dynamics.torque(q, v, a), M @ a + h, atol=1e-12)


def puma():
    """Return a robot with the Denavit-Hartenberg parameters of a PUMA 560, under a ceiling."""
    model, parent = pin.Model(), 0
    rows = [  # a [m], alpha [rad], d [m] of the link before each joint
        (0.0, np.pi, 0.0),
        (0.0, -np.pi / 2, 0.2435),
        (0.4318, 0.0, -0.0934),
        (-0.0203, np.pi / 2, 0.4331),
        (0.0, -np.pi / 2, 0.0),
        (0.0, np.pi / 2, 0.0),
    ]
    for i, (a, alpha, d) in enumerate(rows, 1):
        turn = pin.SE3(pin.exp3(np.array([alpha, 0.0, 0.0])), np.array([a, 0.0, 0.0]))
        placement = turn * pin.SE3(np.eye(3), np.array([0.0, 0.0, d]))
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint{i}")
        body = pin.Inertia(1.0 / i, np.full(3, 0.02), np.diag([0.02, 0.03, 0.03]) / i)
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", parent, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    return pa.load(model, frame="tip", q0=[0.1, -0.8, 0.4, 0.2, 0.9, 0.1])


@pytest.mark.parametrize(
    ("name", "count"),
    [("planar_2r", 4), ("solo8_fl_leg", 6), ("ur5", 36), ("panda", 43), ("kinova", 36)],
)
def test_number_of_identifiable_parameters_is_that_of_the_literature(name, count):
    check_count(catalogue_robot(name), count)


def test_number_of_identifiable_parameters_of_a_puma():
    check_count(puma(), 36)


def check_count(robot, count):
    """The number of base parameters is the textbook's, in any units of the parameters."""
    B = np.eye(10 * robot.model.nv)
    units = 10.0 ** np.random.default_rng(0).integers(-6, 6, len(B))
    for basis in (B, B * units):
        assert identifiable(Regressor(robot.model), basis, robot) == count
