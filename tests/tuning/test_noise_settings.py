"""What a controller does against noise of its sensors, and nothing where there is none."""

import math

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.drives import along

pytestmark = pytest.mark.slow

COUNT = 2.0 * np.pi / 2**17  # [rad], of an encoder of 17 bits


def made(**options):
    """Return a UR5's controller."""
    return pa.make_controller(catalogue_robot("ur5"), **options)


# --- how much of it ---


# --- the leak ---


def test_a_leak_alone_returns_to_the_start():
    a = pa.models.BodyDynamics(catalogue_robot("ur5")).initial
    leak = pa.adaptation.Leak(pa.adaptation.Gradient(1.0, a.size), 0.5)
    off, quiet = leak.init(a).with_value(1.3 * a), along(np.zeros(a.size))
    after = leak.step(off, quiet, 0.7)
    assert np.allclose(after.value, a + 0.3 * a * math.exp(-0.5 * 0.7), rtol=1e-12)
    for _ in range(100):
        after = leak.step(after, quiet, 0.5)
    assert np.allclose(after.value, a, rtol=1e-9, atol=1e-12)


def test_small_steps_of_a_leak_follow_its_rate():
    robot = catalogue_robot("ur5")
    a, cone = pa.models.BodyDynamics(robot).initial, pa.adaptation.BodyInequality(robot.joint_names)
    leak = pa.adaptation.Leak(pa.adaptation.Natural(5.0, cone), 0.5)
    drive = along(np.random.default_rng(4).standard_normal(a.size))
    estimate = leak.init(a).with_value(1.2 * a)
    rate = leak.rate(estimate, drive)
    steps = {h: leak.step(estimate, drive, h).value - estimate.value for h in (1e-4, 5e-5)}
    misses = [np.abs(step / h - rate.value).max() for h, step in steps.items()]
    assert misses[0] < 1e-2 * np.abs(rate.value).max()
    assert misses[1] < 0.55 * misses[0]  # first order in h
    assert not rate.memory[0].any()


# --- the regressor free of noise ---


def driven(lambda_s, noise, count=200, seed=0):
    """Return the mean of Y^T s (p) of an arm at rest whose v is white noise.

    Each draw goes with its opposite, which leaves of the mean what is even in the noise.
    """
    robot = catalogue_robot("ur5")
    controller = made(
        unknown=pa.Unknown(friction=False, armature=False),
        limits=pa.Limits(guards=False, torque=False),
        adaptation="natural",
        lambda_s=lambda_s,
    )
    plant, still = pa.plants.PinocchioPlant(robot), np.zeros(3)
    desired, mean = pa.Desired(robot.position(robot.q0), still, still), 0.0
    for sign in (1.0, -1.0):
        rng = np.random.default_rng(seed)
        state = controller.init(plant.measure(), adapting=False)
        for k in range(count):
            sample = plant.measurement(robot.q0, sign * noise * rng.standard_normal(6), 1e-3 * k)
            _, drives = controller.respond(state, controller.observe(state, sample, desired))
            if k >= count // 4:  # when the low pass has settled
                mean = mean + drives.dynamic.gradient / (2.0 * (count - count // 4))
            state = controller.step(state, sample, desired, 1e-3)[1]
    return mean
