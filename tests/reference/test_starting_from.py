"""Motions that begin where the robot is: approaches as slow as its limits ask for."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits, velocity_limits
from pinadapt.reference import joint_motion, starting_from
from pinadapt.trajectories import Hold
from tests.support.chains import catalogue_robot
from tests.support.differences import derivative


def resting(robot):
    """Return a measurement of a robot at rest at home."""
    return pa.plants.PinocchioPlant(robot).measure()


def circle(robot, by=0.0):
    """Return a circle of 10 cm in 3 s that starts beside home."""
    path = pa.trajectories.Circle(np.zeros(robot.task.size), 0.1, 3.0)
    return path.starting_at(robot.position(robot.q0) + by)


@pytest.mark.parametrize(
    ("name", "by"),
    [("ur5", -0.1), ("panda", 0.3), ("scara", 0.1)],
)
def test_an_approach_keeps_the_limits(name, by):
    """The way of one robot with the exact model, computed again at its own speed."""
    robot = catalogue_robot(name)
    point = robot.position(robot.q0)
    point[0] += by
    approach = starting_from(Hold(point), robot, resting(robot))
    assert 0.3 <= approach.duration < 5.0
    s = np.linspace(0.0, approach.duration, 201)
    joints = joint_motion(approach, robot, s)
    assert joints.off.max() < 0.1
    assert (np.abs(joints.v) <= 1.01 * np.minimum(0.75, 0.8 * velocity_limits(robot.model))).all()
    torque = np.array(
        [
            pin.rnea(robot.model, robot.model.createData(), q, v, a)
            for q, v, a in zip(joints.q, joints.v, joints.a, strict=True)
        ]
    )
    assert (
        np.abs(torque)
        <= np.maximum(0.51, 0.11 + np.abs(joints.still / effort_limits(robot.model)))
        * effort_limits(robot.model)
    ).all()


@pytest.mark.parametrize("task", ["xyz", "joint"])
def test_the_motion_of_the_joints_is_that_of_the_task(task):
    robot = catalogue_robot("panda", task=task)
    motion = (
        circle(robot).from_rest()
        if task == "xyz"
        else pa.trajectories.Sinusoid(robot.home_angles + 0.1, 0.1, 2.0)
    )
    s = np.linspace(0.0, 3.0, 601)
    joints = joint_motion(motion, robot, s)
    assert joints.off.max() < 1e-2
    data = robot.model.createData()
    for k in (60, 250, 470):
        now, q, v, a = motion.at(s[k]), joints.q[k], joints.v[k], joints.a[k]
        assert np.allclose(robot.position(q), now.x_d, atol=1e-5)
        xd = robot.task.motion(robot.model, data, robot.frame_id, q, v)[1]
        assert np.allclose(xd, now.xd_d, atol=2e-4)
        # torque at another rate of the path's time
        r = 0.7
        torque = pin.rnea(robot.model, data, q, r * v, r * r * a)
        parts = joints.still[k] + r * r * joints.curve[k]
        assert np.allclose(parts, torque, atol=1e-9)
        slope = derivative(lambda h, k=k: np.array([np.interp(s[k] + h, s, x) for x in joints.v.T]))
        assert np.allclose(a, slope, atol=0.05 * np.abs(joints.a).max())


def test_a_run_begins_where_the_robot_is_and_at_rest():
    robot = catalogue_robot("panda")
    true = robot.changed(tool_translation=[0.03, -0.02, 0.08])
    controller = pa.make_controller(robot.changed(inertial_scale=0.7), adaptation="natural")
    for motion in (circle(true), circle(true, by=0.05), Hold(true.position(true.q0) + 0.1)):
        rollout = pa.simulate(true, controller, motion, duration=0.2)
        assert np.allclose(rollout.x_d[0], rollout.x[0], atol=1e-12)
        assert np.linalg.norm(np.diff(rollout.x_d[:3], axis=0)) < 1e-6
        at_speed = pa.simulate(true, controller, motion.as_given(), duration=0.01)
        assert np.array_equal(at_speed.x_d[0], motion.at(0.0).x_d)
        gravity = np.abs(
            pin.computeGeneralizedGravity(true.model, true.model.createData(), true.q0)
        )
        beyond = [(np.abs(run.tau) - gravity).max() for run in (rollout, at_speed)]
        assert beyond[0] < beyond[1]
