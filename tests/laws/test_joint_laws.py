"""Laws of joint space: the task-space laws on a joint task, each with its V and dV/dt."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description import robots_folder
from pinadapt.scenario import Scenario
from tests.support.chains import catalogue_robot, mixed_robot
from tests.support.joint_motions import joint_robot, loaded, swinging
from tests.support.loops import energy_along

pytestmark = pytest.mark.slow

ADAPTIVE = ["slotine-li", "craig", "spong-ortega"]
ROBOTS = ["planar_2r", "panda", "mixed"]
# Craig's law needs M_hat invertible, Spong and Ortega's M + M_0 - M_hat: they get low rates.
RATES = {"slotine-li": 1e-4, "craig": 1e-6, "spong-ortega": 1e-6}  # test_contract.py: natural


# --- the proofs ---


@pytest.mark.parametrize("name", ["planar_2r", "mixed"])
@pytest.mark.parametrize("law", ADAPTIVE)
def test_equality_along_the_trajectory_under_gamma(law, name):
    robot = joint_robot(name)
    believed = robot.changed(inertial_scale=0.8)
    controller = pa.make_controller(believed, law=law, adaptation="gradient", gamma_d=RATES[law])
    energy = energy_along(loaded(robot), controller, swinging(robot), seconds=0.006)
    assert energy.mismatch() <= 1e-4
    assert np.abs(energy.rate).max() > 1e-4
    assert (energy.rate <= 0.0).all()
    assert energy.largest_rise() <= 1e-12


def test_friction_only_adds_to_the_dissipation():
    robot = joint_robot("mixed")
    true = loaded(robot).changed(viscous=0.3, coulomb=0.0)
    believed = robot.changed(inertial_scale=0.8)
    controller = pa.make_controller(
        believed,
        law="slotine-li",
        unknown=pa.Unknown(friction="viscous", armature=False),
        gamma_d=1.0,
        gamma_joint=1.0,
    )
    energy = energy_along(true, controller, swinging(robot), seconds=0.006)
    assert energy.mismatch() <= 1e-4 and (energy.rate <= 0.0).all()


# --- the published forms ---


def state_of(robot, rng):
    q = pin.integrate(robot.model, robot.q0, rng.uniform(-0.3, 0.3, robot.model.nv))
    v = rng.standard_normal(robot.model.nv)
    x_d = robot.task.of(q) + 0.1 * rng.standard_normal(robot.model.nv)
    return q, v, pa.Desired(x_d, *rng.standard_normal((2, robot.model.nv)))


def bilinear(model, q, u, w):
    """Return C(q, u) w by polarisation of the inverse dynamics without gravity."""
    weightless = model.copy()
    weightless.gravity.linear = np.zeros(3)
    weightless.armature = np.zeros(model.nv)
    rest = np.zeros(model.nv)
    f = [pin.rnea(weightless, weightless.createData(), q, s, rest) for s in (u + w, u, w)]
    return 0.5 * (f[0] - f[1] - f[2])


@pytest.mark.parametrize("name", ROBOTS)
def test_torques_and_gradients_are_the_published_ones(name):
    robot, rng = joint_robot(name), np.random.default_rng(5)
    model, data, n = robot.model, robot.model.createData(), robot.model.nv
    q, v, desired = state_of(robot, rng)
    e, ed = robot.task.error(robot.task.of(q), desired.x_d), v - desired.xd_d
    M, g = pin.crba(model, data, q), pin.rnea(model, data, q, np.zeros(n), np.zeros(n))
    h = pin.nonLinearEffects(model, data, q, v)
    K, w = np.diag(rng.uniform(5.0, 10.0, n)), 7.0
    measurement = pa.Measurement(0.0, q, v, a=rng.standard_normal(n))

    def respond(law, **gains):
        controller = pa.make_controller(robot, law=law, limits=pa.Limits(torque=False), **gains)
        state = controller.init(measurement)
        s = controller.observe(state, measurement, desired)
        torque, drives = controller.respond(state, s)
        Y = controller.dynamics.regressor(q, v, measurement.a)
        return torque, drives.dynamic.gradient, Y

    s, a_r = ed + w * e, desired.xdd_d - w * ed
    v_r = v - s
    torque, gradient, _ = respond("slotine-li", Kv=K, alpha=w)
    assert np.allclose(torque, M @ a_r + bilinear(model, q, v, v_r) + g - K @ s, atol=1e-10)
    regressor = pa.models.BodyDynamics(robot).slotine_li(q, v, v_r, a_r)[0]
    assert np.allclose(gradient, regressor.T @ s, atol=1e-10)

    u = desired.xdd_d - 2.0 * w * ed - w * w * e
    gains = {"Kv": 2.0 * w, "Kp": w * w, "alpha": w / 4.0}
    assert np.allclose(respond("computed-torque", **gains)[0], M @ u + h, atol=1e-9)
    for law in (
        "craig",
        "spong-ortega",
    ):  # M_hat = M_0 here, and e = ed + alpha e for the default Q
        torque, gradient, Y = respond(law, **gains)
        assert np.allclose(torque, M @ u + h, atol=1e-9)
        assert np.allclose(gradient, Y.T @ np.linalg.solve(M, ed + w / 4.0 * e), atol=1e-8)


def test_a_continuous_joint_goes_the_short_way():
    robot = mixed_robot("joint")
    task, x = robot.task, robot.home_angles
    assert robot.model.nq == 5 and task.size == task.coordinates == 4
    assert np.allclose(task.of(robot.q0), x)
    far = x + np.array([0.0, 6.0, 0.0, 0.0])
    assert np.allclose(task.error(far, x), [0.0, 6.0 - 2.0 * np.pi, 0.0, 0.0])
    q = pin.integrate(robot.model, robot.q0, np.array([0.1, 5.0, -0.2, 0.3]))
    assert np.allclose(
        task.error(task.of(q), x), pin.difference(robot.model, robot.q0, q), atol=1e-12
    )


# --- at work ---


@pytest.mark.parametrize("law", ["slotine-li", "spong-ortega"])
def test_an_unknown_load_is_tracked(law):
    robot = catalogue_robot("panda", task="joint")
    # M_0 must not be far below M: from a belief that is too light, the improved law's wrist is lost
    believed = robot.changed(inertial_scale=1.3 if law == "spong-ortega" else 0.8)
    path = pa.trajectories.Sinusoid(robot.home_angles, 0.2, 2.0)
    runs = [
        pa.simulate(
            loaded(robot),
            pa.make_controller(believed, law=law, adaptation=kind, dt=4e-3),
            path,
            duration=3.0,
        )
        for kind in ("natural", "none")
    ]
    adapted, unadapted = (run.summary()["max_error_last"] for run in runs)
    assert runs[0].diverged is None
    assert adapted < 0.2 * unadapted and adapted < np.radians(0.5)


def test_the_two_link_arm_of_slotine_and_li():
    """Example 9.3 of *Applied Nonlinear Control*, in numbers of an independent simulation."""
    scenario = robots_folder() / "two_link" / "slotine_li_1991.toml"
    rollout = Scenario.read(scenario, ["controller.dt=2e-3"]).run()
    rms = np.degrees(np.sqrt(np.mean(rollout.error**2, axis=0)))
    assert np.allclose(rms, [0.693, 0.333], atol=5e-4)
    assert np.allclose(rollout.a_d[-1], [0.173, 0.661, 1.759, 1.320], atol=6e-4)
    largest = np.degrees(np.abs(rollout.error).max(axis=0))
    assert np.allclose(largest, [3.25, 1.29], atol=6e-3)
