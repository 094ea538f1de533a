"""The torque without accelerations: momentum regressors and the filtered regressor."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given

import pinadapt as pa
from pinadapt.models.joint_effects import without_joint_effects
from pinadapt.models.regressor import inertial_parameters
from tests.support.chains import catalogue_robot, chains, each_size, random_state, seeded
from tests.support.differences import derivative
from tests.support.loops import motion_at_home
from tests.support.paper import BASIS

pytestmark = pytest.mark.slow

ROBOTS = ["planar_2r", "scara", "ur5", "panda", "kinova", "talos_arm"]


def check_momentum(model):
    """Y_M pi = M v by CRBA and Y_0 pi = g - C^T v by the Coriolis matrix, to rounding."""
    rng = np.random.default_rng(3)
    model = model.copy()
    model.armature = np.zeros(model.nv)
    data = model.createData()
    pi = inertial_parameters(model)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
    v = rng.standard_normal(model.nv)
    regressor = pa.models.Regressor(model)
    Y_M, Y_0 = regressor.momentum(q, v)
    M = pin.crba(model, data, q)
    C = pin.computeCoriolisMatrix(model, data, q, v)
    g = pin.computeGeneralizedGravity(model, data, q)
    assert Y_M.shape == Y_0.shape == (model.nv, pi.size)
    sizes = np.abs(M).sum() * np.abs(v).max(), np.abs(C).sum() + np.abs(g).sum()
    assert np.abs(Y_M @ pi - M @ v).max() <= 1e-14 * sizes[0]
    assert np.abs(Y_0 @ pi - (g - C.T @ v)).max() <= 1e-13 * sizes[1]
    for other in (copy.deepcopy(regressor), pickle.loads(pickle.dumps(regressor))):
        assert np.array_equal(other.momentum(q, v), (Y_M, Y_0))


@pytest.mark.parametrize("name", ROBOTS)
def test_momentum_of_robots(name):
    check_momentum(catalogue_robot(name).model)


@each_size()
@given(robot=chains)
@seeded
def test_momentum_of_random_chains(robot):
    check_momentum(robot.model)


def test_momentum_of_a_tree_with_a_floating_base():
    check_momentum(pa.load(pin.buildSampleModelHumanoid(), task="joint", base="free").model)


def dynamics_of(name):
    """Return (robot, dynamics) of every kind of parameters for a robot."""
    robot = catalogue_robot(name).changed(viscous=0.3, coulomb=0.2, armature=0.1)
    bare = without_joint_effects(robot)
    inertial = [pa.models.BodyDynamics(bare, "all"), pa.models.BodyDynamics(bare, "payload")]
    inertial.append(pa.models.LumpedDynamics(bare, [robot.joint_names[-1]]))
    if name == "planar_2r":
        inertial.append(pa.models.BasisDynamics(bare, BASIS))
    for block in inertial:
        for kinds in ("all", ["viscous"], ["armature", "coulomb"], "none"):
            yield robot, pa.models.StackedDynamics(block, pa.models.JointEffects(robot, kinds))
    yield catalogue_robot(name), pa.models.BodyDynamics(catalogue_robot(name), "payload")


@pytest.mark.parametrize("name", ["planar_2r", "scara", "kinova"])
def test_momentum_form_of_every_kind_of_dynamics(name):
    rng = np.random.default_rng(2)
    for robot, dynamics in dynamics_of(name):
        model = robot.model
        q, v, a = random_state(robot, rng)
        a_d = dynamics.value(robot)
        dynamics.load(a_d + rng.standard_normal(a_d.size))  # the loaded estimate does not matter
        tau = pin.rnea(model, model.createData(), q, v, a) + robot.friction.torque(v)

        def momentum(t, model=model, q=q, v=v, a=a, a_d=a_d, dynamics=dynamics):
            at = pin.integrate(model, q, t * v + 0.5 * t * t * a)
            now = dynamics.momentum(at, v + t * a)
            return now.Y_M @ a_d + now.p_0

        now = dynamics.momentum(q, v)
        assert now.Y_M.shape == now.Y_0.shape == (model.nv, dynamics.size)
        found = derivative(momentum) + now.Y_0 @ a_d + now.tau_0
        assert np.allclose(found, tau, atol=1e-8 * (1.0 + np.abs(tau).max()))


def recorded(name, dt, control=None, **truth):
    """Return a robot, parameters for it, and a rollout in which each torque is held for dt."""
    robot = catalogue_robot(name).changed(**truth)
    controller = pa.make_controller(
        robot, unknown=pa.Unknown(friction=True, armature=True), adaptation="none", **control or {}
    )
    rollout = pa.simulate(
        robot, controller, motion_at_home(robot), duration=0.15, engine=pa.Engine(dt=dt, substeps=8)
    )
    return robot, controller.dynamics, rollout


def along(filters, run):
    """Return W (N, n, p) and y (N, n) of a rollout of N samples."""
    state = filters.init(run.q[0], run.v[0])
    found = []
    for q, v, tau, dt in zip(run.q, run.v, run.tau, np.append(np.diff(run.t), 0.0), strict=True):
        found.append(filters.observe(state, q, v))
        state = filters.step(found[-1], tau, float(dt))
    return np.array([now.W for now in found]), np.array([now.y for now in found])


def mismatch(name, dt, **truth):
    """Return |W a - y| along a sampled motion relative to |y|, at its largest."""
    robot, dynamics, run = recorded(name, dt, **truth)
    W, y = along(pa.filters.FilteredRegressor(dynamics, 30.0), run)
    assert not W[0].any() and not y[0].any()
    return np.abs(W @ dynamics.value(robot) - y).max() / np.abs(y).max()


@pytest.mark.parametrize("name", ["scara", "kinova"])
def test_filtered_regressor_predicts_the_filtered_torque(name):
    """W a = y from the first sample on, with an error that falls with the square of the period."""
    truth = {"payload": pa.Payload(0.3, [0.0, 0.0, 0.02]), "viscous": 0.2}
    coarse = mismatch(name, 2e-3, **truth)
    fine = mismatch(name, 1e-3, **truth)
    assert fine < 2e-5
    assert fine < 0.3 * coarse
    # Coulomb friction may change its sign within a period, which samples do not show
    assert mismatch(name, 1e-3, coulomb=0.1, **truth) < 2e-4


def test_filtered_regressor_predicts_the_torque_of_declared_late_motors():
    """W a = y with the torque that the motors apply, of which only the commands are known."""
    late = pa.robot.Actuators(delay=[0.0, 5e-3], bandwidth=[60.0, np.inf])
    robot = catalogue_robot("planar_2r")
    controller = pa.make_controller(robot, unknown=pa.Unknown(friction=True), adaptation="none")
    engine = pa.Engine(dt=2e-3, actuators=late)
    run = pa.simulate(robot, controller, pa.reachable_circle(robot), duration=0.4, engine=engine)
    dynamics = controller.dynamics
    motors = pa.robot.motors.LateTorque(late.of(robot))
    errors = []
    for believed in (motors, None):
        filters = pa.filters.FilteredRegressor(dynamics, 30.0, believed)
        W, y = along(filters, run)
        errors.append(np.abs(W @ dynamics.value(robot) - y).max() / np.abs(y).max())
    assert errors[0] < 1e-4 and errors[1] > 1e-2


def test_filters_are_pure_and_take_a_measured_torque():
    _, dynamics, run = recorded("ur5", 1e-3)
    filters = pa.filters.FilteredRegressor(dynamics, 30.0)
    measured = commanded = filters.init(run.q[0], run.v[0])
    for k in range(51):
        q, v, tau, before = run.q[k], run.v[k], run.tau[k - 1] if k else None, measured
        seen = filters.observe(before, q, v, tau)
        told = filters.observe(commanded, q, v)
        measured = filters.step(seen, np.ones(6), 1e-3)  # not what the motors did
        commanded = filters.step(told, run.tau[k], 1e-3)
    assert np.allclose(seen.y, told.y, rtol=1e-12, atol=1e-12)
    again = filters.observe(before, q, v, tau)
    assert np.array_equal(again.W, seen.W) and np.array_equal(again.y, seen.y)
