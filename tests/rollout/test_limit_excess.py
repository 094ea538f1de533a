"""By how much the joints of a rollout exceed the limits of their description."""

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.rollout.limit_excess import LimitExcess, reference_motion

JOINTS = ("hinge", "slide", "wheel")


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
    return LimitExcess.of(robot, tuple(rows), desired)


MOTION = {
    "q": [[0.9, -0.1, 50.0], [1.25, 0.2, -70.0], [-0.6, 0.31, 0.0]],
    "v": [[-2.5, 0.4, 2.0], [2.25, -0.75, 2.9], [0.0, 0.5, 3.0]],
    "tau": [[9.0, 19.0, -31.0], [10.0, -20.0, 29.0], [-9.9, 4.0, 30.5]],
}


def test_the_largest_excess_of_each_joint_is_exact():
    found = excess(arm(), **MOTION)
    position, velocity, effort = found.plant.T
    assert np.allclose(position, [0.25, 0.1, 0.0], rtol=1e-12)  # a wheel has no end
    assert np.allclose(velocity, [0.5, 0.25, 0.0], rtol=1e-12)
    assert np.allclose(effort, [0.0, 0.0, 1.0], rtol=1e-12)  # at the limit is within it
    assert str(found).startswith("beyond limits: hinge position by 14.32 deg, hinge velocity by ")
    assert str(found).endswith("and 2 more") and found.summary()["reference"] is None


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
    (position, velocity, effort), rate = rollout.limits.reference.T, 2 * np.pi / 1.2
    assert np.isclose(position[0], 0.4, rtol=1e-4) and not position[1:].any()
    assert np.allclose(velocity, [0.4 * rate - 2.0, 0.0, 3.0 * rate - 3.0])
    _, _, torques = reference_motion(true, [s.desired for s in rollout.evaluation.samples])
    plant = pa.plants.PinocchioPlant(true)
    for k in (0, 500, 900):
        desired = swing.at(rollout.t[k])
        q = true.at(desired.x_d).q0
        a = plant.acceleration_at(q, desired.xd_d, torques[k])
        assert np.allclose(a, desired.xdd_d, atol=1e-9)
    beyond = np.abs(torques).max(axis=0) - true.model.effortLimit
    assert np.allclose(effort, np.maximum(beyond, 0.0))
