"""By how much the joints of a rollout exceed the limits of their description."""

import json
import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.rollout.limit_excess import DrivenMotion, LimitExcess, motion_of_reference
from tests.support.chains import catalogue_robot as load
from tests.support.loops import circle_at_home, run

JOINTS = ("hinge", "slide", "wheel")
NONE = {"position": 0.0, "velocity": 0.0, "effort": 0.0}


def arm(limits=True):
    """Return a revolute, a prismatic and a continuous joint, with or without limits."""
    model, parent = pin.Model(), 0
    model.name = "arm"
    kinds = (pin.JointModelRY(), pin.JointModelPX(), pin.JointModelRUBZ())
    for name, joint in zip(JOINTS, kinds, strict=True):
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.1])), name)
        body = pin.Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.2, 0.1, 0.0]))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.BODY))
    robot = pa.load(model, frame="tip", task="joint", q0=np.zeros(3))
    if limits:
        robot.model.lowerPositionLimit = np.array([-0.5, 0.0, -1.01, -1.01])
        robot.model.upperPositionLimit = np.array([1.0, 0.3, 1.01, 1.01])
        robot.model.velocityLimit = np.array([2.0, 0.5, 3.0])
        robot.model.effortLimit = np.array([10.0, 20.0, 30.0])
    return robot


def excess(robot, q, v, tau, desired=None):
    """Return the excess of a given motion, one row per sample."""
    rows = (np.array(part, dtype=float).reshape(-1, 3) for part in (q, v, tau))
    return LimitExcess.of(robot, DrivenMotion(*rows), desired)


MOTION = {
    "q": [[0.9, -0.1, 50.0], [1.25, 0.2, -70.0], [-0.6, 0.31, 0.0]],
    "v": [[-2.5, 0.4, 2.0], [2.25, -0.75, 2.9], [0.0, 0.5, 3.0]],
    "tau": [[9.0, 19.0, -31.0], [10.0, -20.0, 29.0], [-9.9, 4.0, 30.5]],
}


def test_the_largest_excess_of_each_joint_is_exact():
    plant = excess(arm(), **MOTION).plant
    assert np.allclose(plant.position, [0.25, 0.1, 0.0], rtol=1e-12)  # a wheel has no end
    assert np.allclose(plant.velocity, [0.5, 0.25, 0.0], rtol=1e-12)
    assert np.allclose(plant.effort, [0.0, 0.0, 1.0], rtol=1e-12)  # at the limit is within it


def test_only_joints_beyond_a_limit_are_shown_with_their_units():
    q, v, tau = ([row, row] for row in ([1.25, 0.2, 9.0], [0.0, 0.75, 0.0], [0.0, 24.5, 0.0]))
    limits = excess(arm(), q, v, tau)
    assert limits.verdict() == "exceeded at 2 (plant) of 3 joints" and limits.exceeded
    assert list(limits.rows()) == [
        ("hinge", "14.32 deg", "-", "-", "plant"),
        ("slide", "-", "250 mm/s", "4.5 N", "plant"),
    ]
    text = str(limits)
    assert "14.32 deg" in text and "250 mm/s" in text and "wheel" not in text
    assert limits.summary() == {
        "plant": {
            "hinge": {**NONE, "position": 0.25},
            "slide": {"position": 0.0, "velocity": 0.25, "effort": 4.5},
            "wheel": NONE,
        },
        "reference": None,
    }


def test_a_motion_within_its_limits_keeps_them():
    limits = excess(arm(), [0.9, 0.3, 9.0], [2.0, 0.5, 3.0], [10.0, 20.0, 30.0])
    assert not limits.exceeded and limits.verdict() == "kept" and "kept" in str(limits)
    assert limits.summary()["plant"] == dict.fromkeys(JOINTS, NONE)


@pytest.mark.parametrize("absent", [0.0, np.inf, 1.8e308, np.finfo(float).max])
def test_descriptions_without_limits(absent):
    robot = arm(limits=False)
    model = robot.model
    model.velocityLimit = model.effortLimit = np.full(3, absent)
    model.lowerPositionLimit = np.array([-absent, -absent, -1.01, -1.01])
    model.upperPositionLimit = np.array([absent, absent, 1.01, 1.01])
    limits = excess(robot, **MOTION)
    assert not limits.exceeded and not limits.stated
    assert limits.verdict() == "none in the description"


def test_numbers_that_are_not_finite_do_not_count():
    motion = {name: [*rows, [np.nan, np.inf, -np.inf]] for name, rows in MOTION.items()}
    assert np.array_equal(excess(arm(), **motion).plant, excess(arm(), **MOTION).plant)
    nothing = excess(arm(), [], [], [])
    assert not nothing.exceeded and np.array(nothing.plant).shape == (3, 3)


# --- of a run ---


def far_hinge():
    """Return an arm without and with friction, and a joint motion beyond its limits."""
    robot = arm()
    swing = pa.trajectories.Sinusoid([1.0, 0.15, 0.0], [0.4, 0.05, 3.0], 1.2, [0.0, 0.0, 0.0])
    return robot, robot.changed(viscous=1.5, coulomb=0.4, armature=0.2), swing.as_given()


def test_the_reference_of_joints_is_compared_with_its_exact_torques():
    robot, true, swing = far_hinge()
    rollout = pa.simulate(
        true, pa.make_controller(robot, adaptation="natural"), swing, duration=1.2
    )
    reference, rate = rollout.limits.reference, 2 * np.pi / 1.2
    assert np.isclose(reference.position[0], 0.4, rtol=1e-4) and not reference.position[1:].any()
    assert np.allclose(reference.velocity, [0.4 * rate - 2.0, 0.0, 3.0 * rate - 3.0])
    motion = motion_of_reference(true, rollout.evaluation.samples)
    plant = pa.plants.PinocchioPlant(true)
    for k in (0, 500, 900):
        desired = swing.at(rollout.t[k])
        q = true.at(desired.x_d).q0
        a = plant.acceleration_at(q, desired.xd_d, motion.tau[k])
        assert np.allclose(a, desired.xdd_d, atol=1e-9)
    beyond = np.abs(motion.tau).max(axis=0) - true.model.effortLimit
    assert np.allclose(reference.effort, np.maximum(beyond, 0.0))


def test_a_rollout_reports_the_excess_of_the_true_robot(tmp_path):
    robot, true, swing = far_hinge()
    free = pa.make_controller(robot, adaptation="natural", limits=pa.Limits(torque=False))
    rollout = pa.simulate(true, free, swing, duration=0.4, engine=pa.Engine(torque_limits=False))
    plant = rollout.limits.plant
    assert np.isclose(plant.position[0], max(rollout.q[:, 0].max() - 1.0, 0.0)) > 0.0
    speeds = np.abs(rollout.v).max(axis=0) - true.model.velocityLimit
    assert np.allclose(plant.velocity, np.maximum(speeds, 0.0)) and plant.velocity.any()
    torques = np.abs(rollout.tau).max(axis=0) - true.model.effortLimit
    assert np.allclose(plant.effort, np.maximum(torques, 0.0)) and plant.effort.any()
    clipped = pa.simulate(
        true, pa.make_controller(robot, adaptation="natural"), swing, duration=0.4
    )
    assert not clipped.limits.plant.effort.any() and clipped.limits.reference.effort.any()
    rollout.save(tmp_path)
    saved = json.loads((tmp_path / "summary.json").read_text())["limits"]
    assert saved == rollout.limits.summary() and set(saved["plant"]) == set(JOINTS)
    assert str(rollout.limits) in str(rollout) and "exceeded at" in str(rollout)


def test_a_reference_of_the_frame_has_no_joint_motion():
    robot = load("ur5")
    rollout = pa.simulate(
        robot, pa.make_controller(robot, adaptation="natural"), circle_at_home(robot), duration=0.02
    )
    assert rollout.limits.reference is None and rollout.summary()["limits"]["reference"] is None
    assert rollout.limits.verdict() == "kept" and str(rollout.limits) not in str(rollout)
    assert any(line.split() == ["joint", "limits", "kept"] for line in str(rollout).splitlines())


def test_limits_can_be_pickled():
    rollout = run(duration=0.01)
    copy = pickle.loads(pickle.dumps(rollout))
    assert copy.limits.summary() == rollout.limits.summary() and str(copy) == str(rollout)
