"""What a controller does against noise of its sensors, and nothing where there is none."""

import math

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.tuning.preflight import sensor_findings
from tests.support.chains import catalogue_robot
from tests.support.drives import along
from tests.support.loops import with_tool_and_load

pytestmark = pytest.mark.slow

COUNT = 2.0 * np.pi / 2**17  # [rad], of an encoder of 17 bits


def made(**options):
    """Return a UR5's controller."""
    return pa.make_controller(catalogue_robot("ur5"), **options)


# --- the leak ---


def test_a_leak_alone_returns_to_the_start():
    a = pa.models.BodyDynamics(catalogue_robot("ur5")).initial
    leak = pa.adaptation.Leak(pa.adaptation.Gradient(1.0, a.size), 0.5)
    off = leak.init(a).with_value(1.3 * a)
    quiet = along(np.zeros(a.size))
    after = leak.step(off, quiet, 0.7)
    assert np.allclose(after.value, a + 0.3 * a * math.exp(-0.5 * 0.7), rtol=1e-12)
    for _ in range(100):
        after = leak.step(after, quiet, 0.5)
    assert np.allclose(after.value, a, rtol=1e-9, atol=1e-12)


# --- the regressor free of noise ---


def driven(lambda_s, noise):
    """Return the mean of Y^T s (p) of an arm at rest whose v is white noise.

    Each draw goes with its opposite, which leaves of the mean what is even in the noise.
    """
    robot = catalogue_robot("ur5")
    controller = made(
        lambda_s=lambda_s,
        unknown=pa.Unknown(friction=False, armature=False),
        limits=pa.Limits(guards=False, torque=False),
    )
    controller = pa.Controller(
        controller.law,
        controller.kinematics,
        controller.dynamics,
        adaptation_k=controller.adaptation_k,
        adaptation_d=controller.adaptation_d,
    )
    plant = pa.plants.PinocchioPlant(robot)
    still = np.zeros(3)
    desired = pa.Desired(robot.position(robot.q0), still, still)
    mean = 0.0
    count = 200
    for sign in (1.0, -1.0):
        rng = np.random.default_rng(0)
        state = controller.init(plant.measure(), adapting=False)
        for k in range(count):
            sample = plant.measurement(robot.q0, sign * noise * rng.standard_normal(6), 1e-3 * k)
            _, drives = controller.respond(state, controller.observe(state, sample, desired))
            if k >= count // 4:  # when the low pass has settled
                mean = mean + drives.dynamic.gradient / (2.0 * (count - count // 4))
            state = controller.step(state, sample, desired, 1e-3)[1]
    return mean


def test_white_noise_at_rest_drives_estimates_only_through_the_plain_regressor():
    """E[Y^T s] = -alpha sigma^2 ... of the plain law; an eighth of it is left below lambda_s."""
    plain = driven(math.inf, 0.1)
    free = driven(40.0, 0.1)
    moments = np.arange(60) % 10 < 4  # mass and first moments: what of the mean is not gravity
    assert np.linalg.norm(plain) > 1e-2
    assert np.linalg.norm(free) < 0.125 * np.linalg.norm(plain)
    assert np.linalg.norm(free[moments]) < 0.5 * np.linalg.norm(plain[moments])
    doubled = driven(math.inf, 0.2)
    assert np.linalg.norm(doubled) == pytest.approx(4.0 * np.linalg.norm(plain), rel=0.05)


# --- all of it ---


def test_an_arm_with_differenced_encoders_is_held():
    """Of 16 bits at 500 Hz: the noise of the velocity is that of 17 bits at 1 kHz."""
    robot = catalogue_robot("ur5")
    true = with_tool_and_load(robot).changed(viscous=0.3, coulomb=0.5)
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0, "yz").starting_at(true.position(true.q0))
    count = {"sensors": pa.Sensors(encoder=2.0 * COUNT)}
    controller = pa.make_controller(robot, dt=2e-3, **count)
    rollout = pa.simulate(true, controller, path, record_every=10, duration=3.0, **count)
    norms = np.linalg.norm(rollout.a_d, axis=1)
    assert rollout.diverged is None
    assert rollout.distance[rollout.t > 2.0].max() < 5e-4
    late = norms[rollout.t > 2.0]
    assert late.max() < 1.05 * norms[rollout.t < 2.0].max() and np.ptp(late) < 0.1 * late.mean()


def test_sensors_that_are_worse_than_declared_are_found_before_a_run():
    controller = pa.make_controller(catalogue_robot("ur5"))
    coarse = pa.Sensors(encoder=2.0 * np.pi / 2**12, camera=pa.Camera(rate=30.0)).quality(6, 1e-3)
    (words,) = (str(finding) for finding in sensor_findings(controller, coarse))
    assert "velocity noise" in words
    assert sensor_findings(controller, controller.senses.quality) == []
