"""Plants: the interface that a loop needs, and the integration of the motion."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import pinadapt as pa
from pinadapt.plants.pinocchio_plant import FittedMidpoint
from pinadapt.zoo.experiment import zoo_case
from tests.support.chains import catalogue_robot as load
from tests.support.chains import random_state
from tests.support.effects import torque_of_everything, with_everything

# --- a plant of one's own ---


class Pendulum(pa.plants.Plant):
    """A point mass on a rod, integrated by a library, as a user might write it."""

    nv, mass, length = 1, 1.3, 0.7

    def reset(self):
        self.t = 0.0
        self.state = np.array([0.4, 0.0])

    def measure(self):
        q, v = self.state
        return pa.Measurement(self.t, np.array([q]), np.array([v]), np.array([q]))

    def step(self, torque, dt):
        inertia = self.mass * self.length**2
        weight = 9.81 * self.mass * self.length

        def slope(_, y):
            return [y[1], (torque[0] - weight * np.sin(y[0])) / inertia]

        self.state = solve_ivp(slope, (0.0, dt), self.state, rtol=1e-9, atol=1e-12).y[:, -1]
        self.t += dt


class Feedback:
    """A controller with the interface that a loop needs; its state counts the steps."""

    def init(self, measurement):
        return 0

    def step(self, state, measurement, desired, dt):
        return 40.0 * (desired.x_d - measurement.q) - 8.0 * measurement.v, state + 1


def test_a_loop_runs_on_a_custom_plant():
    plant = Pendulum()
    path = pa.trajectories.Hold([0.4])
    samples = list(pa.run(plant, Feedback(), path, dt=4e-3, duration=3.0))
    assert len(samples) == 750 and samples[-1].state == 749
    assert np.allclose([sample.t for sample in samples], 4e-3 * np.arange(750))
    weight = 9.81 * Pendulum.mass * Pendulum.length
    q = samples[-1].measurement.q[0]
    assert np.isclose(40.0 * (0.4 - q), weight * np.sin(q), atol=1e-4)  # the balance of torques
    again = next(pa.run(plant, Feedback(), path, dt=2e-3))
    assert again.t == 0.0 and again.truth.q[0] == 0.4  # a run resets its plant


# --- integration ---


@pytest.mark.parametrize("name", ["scara", "kinova"])
def test_the_integrator_is_of_second_order(name):
    motor = pa.robot.Shaft((0, 1), viscous=0.5)
    robot = load(name).changed(friction=pa.Friction(viscous=0.5, shafts=(motor,)))
    q, v, _ = random_state(robot, np.random.default_rng(0))
    model = robot.model
    tau = np.linspace(2.0, 1.0, robot.model.nv)
    ends = []
    for count in (20, 40, 80):
        step = FittedMidpoint(robot)
        state = (q, v)
        for _ in range(count):
            state = step(*state, tau, 0.05 / count)
        ends.append(np.concatenate([pin.difference(model, q, state[0]), state[1]]))
    ratio = np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2])
    assert ratio > 0.9 * 2**2


def wheel(inertia):
    """Return one joint without gravity, of a given inertia about its axis."""
    model = pin.Model()
    body = pin.Inertia(1.0, np.zeros(3), inertia * np.eye(3))
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "axle")
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    task = pa.tasks.JointTask.of_joints(model)
    return pa.Robot("wheel", model, "universe", task, np.zeros(1), pa.Friction().of(model))


@pytest.mark.parametrize("h", [1e-4, 1e-2, 1.0, 100.0])
def test_viscous_friction_on_one_joint_is_exact_for_any_step(h):
    inertia, viscous, tau, start = 0.2, 3.0, 0.6, 5.0
    q, v = FittedMidpoint(wheel(inertia).changed(viscous=viscous))(
        np.zeros(1), np.array([start]), np.array([tau]), h
    )
    rest = tau / viscous
    left = np.exp(-h * viscous / inertia)
    assert np.isclose(v[0], rest + (start - rest) * left, rtol=1e-9)
    path = rest * h + (start - rest) * (1.0 - left) * inertia / viscous
    assert np.isclose(q[0], path, rtol=1e-9)


@pytest.mark.parametrize("inertia", [1e-1, 1e-4, 1e-7])
def test_a_joint_in_stiction_creeps_at_the_velocity_of_the_torque_balance(inertia):
    """For any inertia: explicit methods diverge if the friction is stiff."""
    step = FittedMidpoint(wheel(inertia).changed(coulomb=0.5))
    q = np.zeros(1)
    v = np.zeros(1)
    for _ in range(200):
        q, v = step(q, v, np.array([0.2]), 1e-2)
    assert np.isclose(v[0], 0.01 * np.arctanh(0.2 / 0.5), rtol=1e-6)


@pytest.mark.slow
def test_integration_errors_are_below_a_hundredth_of_the_tracking_error():
    """One step per period against 32."""
    case = zoo_case("panda")
    controller = pa.make_controller(
        case.estimated,
        law="adaptive-jacobian",
        unknown=pa.Unknown(friction=True, armature=False),
        posture=4.0,
    )
    plants = [
        pa.plants.PinocchioPlant(case.true, substeps=1),
        pa.plants.PinocchioPlant(case.true, substeps=32),
    ]
    paths = []
    for plant in plants:
        loop = pa.run(plant, controller, case.motion, duration=0.2)
        paths.append(np.array([(s.truth.x, s.desired.x_d) for s in loop]))
    coarse, fine = paths
    tracking = np.linalg.norm(fine[-100:, 0] - fine[-100:, 1], axis=1).max()
    assert np.linalg.norm(coarse[:, 0] - fine[:, 0], axis=1).max() < 0.01 * tracking


@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_offsets_loads_stribeck_and_shafts_act_as_their_equation_says(name):
    """The acceleration under a torque solves the equation of motion."""
    rng = np.random.default_rng(2)
    robot = with_everything(load(name), rng)
    plant = pa.plants.PinocchioPlant(robot)
    fitted = FittedMidpoint(robot)
    for _ in range(5):
        q, v, _ = random_state(robot, rng)
        tau = rng.standard_normal(robot.model.nv)
        a = plant.acceleration_at(q, v, tau)
        assert np.allclose(torque_of_everything(robot, q, v, a), tau, atol=1e-8)
        h = 1e-7
        assert np.allclose((fitted(q, v, tau, h)[1] - v) / h, a, rtol=2e-3, atol=1e-3)
        assert np.allclose(plant.mass_matrix(q) @ a, tau - plant_rest(robot, q, v), atol=1e-7)


def plant_rest(robot, q, v):
    """Return the torque at acceleration zero."""
    return torque_of_everything(robot, q, v, np.zeros(len(v)))


def test_motors_apply_what_their_limits_allow():
    plant = pa.plants.PinocchioPlant(load("ur5"), torque_limits=2.0)
    asked = np.array([0.5, 3.0, -3.0, np.inf, -np.inf, np.nan])
    allowed = np.array([0.5, 2.0, -2.0, 2.0, -2.0, np.nan])
    assert np.array_equal(plant.motors(asked), allowed, equal_nan=True)
