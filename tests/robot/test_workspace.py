"""Home poses and circles that a robot can follow."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import (
    configuration_from_angles,
    effort_limits,
    position_limits,
    velocity_limits,
)
from pinadapt.robot.home import singular_values
from pinadapt.robot.workspace import find_circle, find_swing
from tests.support.chains import catalogue_robot
from tests.support.followed import followed
from tests.support.paths import ARM4

ROBOTS = [
    "planar_2r",
    "scara",
    "kinova",
    "solo8_fl_leg",
    "allegro_left_thumb",
]


def point(robot):
    """Return the position (3) of the frame at home."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    return data.oMf[robot.frame_id].translation.copy()


@pytest.mark.parametrize("name", ROBOTS)
def test_the_circle_can_be_followed_with_a_longer_tool_too(name):
    robot = catalogue_robot(name)
    circle = find_circle(robot)
    assert 0.05 * robot.reach < circle.radius <= 0.1 * robot.reach
    lower, upper = position_limits(robot.model)
    task = robot.model, [robot.frame_id], robot.task.rows
    at_home = singular_values(*task, [robot.q0])[0, -1]
    for axis in np.eye(3):
        true = robot.changed(tool_translation=0.05 * robot.reach * axis)
        configurations, speeds = followed(true, circle, point(true))
        angles = np.array(
            [pin.difference(robot.model, pin.neutral(robot.model), q) for q in configurations]
        )
        limited = np.isfinite(lower)
        room = np.minimum(angles - lower, upper - angles)[:, limited] / (upper - lower)[limited]
        assert room.min(initial=1.0) > 0.04
        least = singular_values(*task, configurations[::10])[:, -1].min()
        assert least > 0.48 * at_home
        assert np.abs(speeds).max() < 1.65


def test_slower_joints_take_longer():
    robot = catalogue_robot("ur5")
    model = robot.model.copy()
    model.velocityLimit = np.full(6, 0.1)
    slow = pa.reachable_circle(replace(robot, model=model))
    fast = pa.reachable_circle(robot)
    assert (slow.radius, slow.plane) == (fast.radius, fast.plane)
    assert np.abs(followed(robot, slow, point(robot))[1]).max() < 0.1 < 0.5 * slow.period


# --- home poses ---


def test_the_searched_home_beats_random_poses_inside_the_limits():
    robot = pa.load(ARM4, frame="tip")
    rng = np.random.default_rng(7)
    lower, upper = position_limits(robot.model)

    def quality(angles):
        q = robot.at(angles).q0
        room = np.min(np.minimum(angles - lower, upper - angles) / (upper - lower))
        found = singular_values(robot.model, [robot.frame_id], robot.task.rows, [q])
        return found[0, -1] * min(1.0, room / 0.2)

    others = [quality(rng.uniform(lower, upper)) for _ in range(100)]
    assert quality(robot.home_angles) > max(others)


@pytest.mark.parametrize("name", ["panda", "scara"])
def test_the_sines_of_the_joints_keep_all_limits(name):
    robot = pa.load(name, task="joint")
    swing = find_swing(robot)
    model = robot.model
    assert np.abs(swing.amplitude).min() > 0.02 and len(set(swing.period)) == model.nv
    lower, upper = position_limits(model)
    for t in np.linspace(0.0, 12.0, 300):
        desired = swing.at(t)
        assert (desired.x_d > lower).all() and (desired.x_d < upper).all()
        assert (np.abs(desired.xd_d) < velocity_limits(model)).all()
        q = configuration_from_angles(model, desired.x_d)
        torque = pin.rnea(model, model.createData(), q, desired.xd_d, desired.xdd_d)
        assert (np.abs(torque) < effort_limits(model)).all()
    start = swing.at(0.0)
    assert np.allclose(start.x_d, robot.home_angles, atol=1e-9) and np.allclose(start.xd_d, 0.0)
