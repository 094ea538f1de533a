"""Effects of the joints, as a log chooses them."""

from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.effects import torque_of_everything, torques_of_everything
from tests.support.recorded import motion

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("shortened")]


@cache
def log_of_friction(name="ur5", noise=0.2, duration=8.0, **friction):
    """Return the log of a robot with these effects, and the robot."""
    described = catalogue_robot(name)
    n = described.model.nv
    usual = {"viscous": np.full(n, 0.5), "coulomb": np.full(n, 0.8)}
    spread = {key: one_joint(n, *part) for key, part in friction.items() if key != "shafts"}
    shafts = {"shafts": friction["shafts"]} if "shafts" in friction else {}
    if "breakaway" in spread:
        spread["breakaway"] += 1.0
    if "threshold" in spread:
        spread["threshold"] += 0.01
    true = described.changed(inertial_scale=1.1, friction=pa.Friction(**usual, **spread, **shafts))
    t, q, v, a = motion(name, duration=duration, dt=16e-3)
    rng = np.random.default_rng(0)
    tau = torques_of_everything(true, q, v, a)
    tau += noise * rng.standard_normal(tau.shape)
    return pa.Log(t, q, tau, v, tuple(described.joint_names)), true


def one_joint(n, joint, value):
    found = np.zeros(n)
    found[joint] = value
    return found


EFFECTS = {
    "offset": (1, 3.0),
    "threshold": (0, 0.09),
    "breakaway": (2, -0.9),
    "gear_friction": (1, 0.2),
    "shafts": (pa.robot.Shaft((4, 5), 1, 0.05, 2.0, 2.0),),
}
WORDS = {
    "shoulder_lift_joint.offset",
    "elbow_joint: other friction near rest, up to 0.1 rad/s",
    "shoulder_lift_joint.gear_friction",
    "a motor that turns with wrist_2_joint+wrist_3_joint",
}


def test_effects_are_found_and_predict_the_held_out_torques():
    log, true = log_of_friction(noise=0.05, **EFFECTS)
    robot = catalogue_robot("ur5")
    found = pa.identify(log, robot)
    plain = pa.identify(log, robot, unknown=["bodies", "friction"])
    assert {gain.words for gain in found.effects.gains} >= WORDS
    assert all(gain.share > 2.0 * gain.deviation for gain in found.effects.gains)
    assert len(found.effects.friction.shafts) == 1  # others would have negative friction
    left, without = (
        np.sqrt(np.mean(part.torque_errors.learned_held_out**2)) for part in (found, plain)
    )
    assert left < 0.8 * without and plain.effects is None
    assert all(part in str(found) for part in WORDS)
    # the learned robot has the effects, and a controller can be made for it
    q = log.q[350]
    v = log.v[350]
    a = np.zeros(6)
    controller = pa.make_controller(found.robot, unknown=found.unknown)
    assert controller.dynamics.names == found.dynamic.names
    controller.dynamics.load(controller.dynamics.initial)
    expected = torque_of_everything(true, q, v, a)
    assert np.abs(controller.dynamics.torque(q, v, a) - expected).max() < 1.0


def test_no_effect_is_found_where_there_is_none():
    log, _ = log_of_friction()
    found = pa.identify(log, catalogue_robot("ur5"))
    assert len(found.effects.gains) <= 1  # of about a hundred, at two standard errors
    assert (found.effects.friction.breakaway == 1.0).sum() >= 5
    assert found.effects.friction.shafts == ()
