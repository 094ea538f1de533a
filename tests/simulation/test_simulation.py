"""The closed loop: both modes, noise, limits, divergence, and what a controller must not do."""

from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits
from tests.support.chains import catalogue_robot as load
from tests.support.chains import robot_of
from tests.support.loops import circle_at_home as circle
from tests.support.loops import motion_at_home, run
from tests.support.snapshots import snapshot, unchanged

pytestmark = pytest.mark.slow

# --- modes, noise, delay, limits ---


def test_torque_limits_clip():
    hard = {"law": "adaptive-inverse-dynamics", "Kp": 4e4, "Kv": 400.0}
    without = {
        "control": {**hard, "limits": pa.Limits(torque=False)},
        "engine": pa.Engine(torque_limits=False),
    }
    free = run("ur5", sensors=pa.Sensors(noise={"v": 0.3}), **without)
    clipped = run("ur5", control=hard, sensors=pa.Sensors(noise={"v": 0.3}))
    limits = effort_limits(load("ur5").model)
    assert (np.abs(free.tau).max(axis=0) > limits).any()
    assert (np.abs(clipped.tau) <= limits).all()
    assert (clipped.tau == limits).any() and (clipped.tau == -limits).any()


def test_continuous_and_sampled_agree_as_the_period_shrinks():
    """Under an adaptation without a memory, which looks at intervals of its own."""
    rates = {"gamma_d": 1.0, "gamma_joint": 1.0}  # slow enough for Runge-Kutta
    control = {"dt": 1e-3, "adaptation": "natural", **rates}
    reference = run(
        "planar_2r", control=control, duration=0.2, engine=pa.Engine(continuous=True)
    ).x[-1]
    errors = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        rollout = run("planar_2r", control=control, duration=0.2 + dt, engine=pa.Engine(dt=dt))
        assert np.isclose(rollout.t[-1], 0.2)
        errors.append(np.linalg.norm(rollout.x[-1] - reference))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert (ratios > 1.7).all() and (ratios < 2.3).all()  # first order in dt
    assert errors[-1] < 1e-4


# --- the controller ---


@cache  # none of it is written to
def controlled(name, law, adaptation="natural"):
    """Return a controller a few steps into its work, its state, measurement and desired motion."""
    robot = robot_of(law, name)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8), law=law, adaptation=adaptation
    )
    plant = pa.plants.PinocchioPlant(robot)
    desired = motion_at_home(robot).at(0.1)
    rng = np.random.default_rng(5)
    v = 0.3 * rng.standard_normal(plant.nv)
    q = plant.integrate(robot.q0, 0.05 * rng.standard_normal(plant.nv))
    measurement = plant.measurement(q, v)
    state = controller.init(measurement)
    for _ in range(3):
        state = controller.step(state, measurement, desired, 1e-3)[1]
    return controller, state, measurement, desired


@pytest.mark.parametrize(
    ("law", "adaptation"),
    [(law, "natural") for law in pa.laws.LAWS] + [("separation", "gradient"), ("craig", "none")],
)
def test_step_is_pure(law, adaptation):
    controller, state, measurement, desired = controlled("scara", law, adaptation)
    given = state, measurement, desired
    before = [snapshot(record) for record in given]
    tau, after = controller.step(state, measurement, desired, 1e-3)
    kept = snapshot(after)
    controller.step(after, measurement, desired, 1e-3)
    again, state_again = controller.step(state, measurement, desired, 1e-3)
    assert np.array_equal(tau, again) and unchanged(state_again, kept) and unchanged(after, kept)
    assert all(unchanged(record, old) for record, old in zip(given, before, strict=True))


FRAME_LAWS = {name: law for name, law in pa.laws.LAWS.items() if not law.joint_space}


@pytest.mark.parametrize("name", FRAME_LAWS)
def test_an_unmeasured_task_velocity_is_the_estimated_one(name):
    robot = load("ur5")
    controller = pa.make_controller(robot.changed(tool_translation=[0.02, 0.0, 0.05]), law=name)
    measurement = pa.plants.PinocchioPlant(robot).measurement(robot.q0, np.linspace(0.1, 0.3, 6))
    state = controller.init(measurement)
    desired = circle(robot).at(0.0)
    xd_hat = controller.observe(state, measurement, desired).xd_hat
    torques = [
        controller.step(state, measurement._replace(xd=xd), desired, 1e-3)[0]
        for xd in (None, xd_hat, measurement.xd)
    ]
    assert torques[0].tobytes() == torques[1].tobytes()
    assert np.array_equal(torques[0], torques[2]) != FRAME_LAWS[name].needs_task_velocity


# --- divergence ---
