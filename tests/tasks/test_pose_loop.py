"""Closed loops of pose tasks, their scenarios and outputs, and what is refused."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.tasks.frame import TASKS, matrix
from tests.support.chains import catalogue_robot
from tests.support.recorded import LOAD, TOOL

pytestmark = pytest.mark.slow

POSE = TASKS["pose"]


def pose_robot():
    return catalogue_robot("panda", task="pose")


def circle(robot):
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.1, 3.0, "yz"),
        pa.trajectories.Swing((0.0, 0.0, 1.0), 0.3, 2.0),
    )
    return path.starting_at(robot.position(robot.q0)).as_given()


# --- convergence ---


def test_errors_of_position_and_orientation_vanish_with_true_parameters():
    robot = pose_robot()
    angle = 2.5
    start = POSE.moved(robot.position(robot.q0), np.array([0.02, -0.01, 0.03, 0.0, 0.0, 0.0]))
    tool_z = matrix(start[3:])[:, 2]
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.05, 3.0, "yz"),
        pa.trajectories.Swing([0.0, 1.0, 1.0], 0.2, 2.0),
    )
    there = POSE.moved(start, np.concatenate([np.zeros(3), angle * tool_z]))
    path = path.starting_at(there).as_given()
    controller = pa.make_controller(
        robot, law="resolved-acceleration", unknown=pa.Unknown(tool=False)
    )
    rollout = pa.simulate(
        robot, controller, path, duration=1.4, engine=pa.Engine(dt=4e-3, continuous=True)
    )
    assert np.isclose(rollout.angle[0], angle) and np.isclose(
        rollout.distance[0], np.linalg.norm([0.02, -0.01, 0.03])
    )
    assert rollout.distance[-1] < 1e-6 and rollout.angle[-1] < 1e-6


def test_panda_learns_tool_and_load_and_tracks_its_pose():
    robot = pose_robot()
    true = robot.changed(tool_translation=TOOL, payload=LOAD)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.7), law="adaptive-jacobian", dt=2e-3
    )
    rollout = pa.simulate(true, controller, circle(true), duration=3.5, record_every=10)
    summary = rollout.summary()
    assert summary["diverged"] is None
    assert summary["max_error_last"] < 1e-3
    assert summary["max_angle_last"] < np.radians(0.2)
    assert rollout.min_eig_M_hat.min() > 0.0


# --- the controller's manners ---


def sample(robot, x=None):
    return pa.Measurement(
        0.0, robot.q0, np.zeros(robot.model.nv), robot.position(robot.q0) if x is None else x
    )


def test_either_sign_of_the_measured_quaternion_gives_the_same_torque():
    robot = pose_robot()
    controller = pa.make_controller(robot, adaptation="natural")
    desired = circle(robot).at(0.2)
    x = robot.position(robot.q0)
    state = controller.init(sample(robot))
    torques = [
        controller.step(state, sample(robot, x * [1, 1, 1, *[s] * 4]), desired, 1e-3)[0]
        for s in (1, -1)
    ]
    assert np.allclose(*torques, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("bad", [np.zeros(4), np.full(4, 0.6), np.array([np.nan, 0.0, 0.0, 1.0])])
def test_an_invalid_quaternion_raises_an_error_and_leaves_the_state(bad):
    robot = pose_robot()
    controller = pa.make_controller(robot, adaptation="natural")
    desired = circle(robot).at(0.2)
    x = np.concatenate([robot.position(robot.q0)[:3], bad])
    with pytest.raises(pa.PinadaptError, match="x"):
        controller.init(sample(robot, x))
    state = controller.init(sample(robot))
    before = state.flat()
    with pytest.raises(pa.MeasurementError, match="'x'"):
        controller.step(state, sample(robot, x), desired, 1e-3)
    with pytest.raises(pa.InputError, match="desired"):
        controller.step(state, sample(robot), desired._replace(x_d=x), 1e-3)
    assert np.array_equal(state.flat(), before)


def test_a_tracker_needs_no_angular_velocity():
    robot = pose_robot()
    controller = pa.make_controller(robot, law="adaptive-inverse-dynamics-velocity")
    desired = circle(robot).at(0.2)
    v = np.linspace(-0.3, 0.4, 7)
    seen = pa.plants.PinocchioPlant(robot).measurement(robot.q0, v)
    x = seen.x
    xd = seen.xd
    state = controller.init(pa.Measurement(0.0, robot.q0, v, x, xd=xd))
    blind = np.concatenate([xd[:3], np.full(3, 9.0)])
    torques = [
        controller.step(state, pa.Measurement(0.0, robot.q0, v, x, xd=rate), desired, 1e-3)[0]
        for rate in (xd, blind)
    ]
    assert np.array_equal(*torques)


# --- scenarios and outputs ---


def test_noise_of_a_trackers_angles_has_the_stated_deviation():
    robot = pose_robot()
    noise = pa.Sensors(noise={"angle": 0.02})
    sensors = pa.plants.SimulatedSensors(robot, 1e-3, noise, seed=3)
    true = pa.plants.PinocchioPlant(robot).measure()
    seen = [sensors.measure(true).x for _ in range(1000)]
    errors = np.array([POSE.error(x, true.x) for x in seen])
    assert not errors[:, :3].any() and np.isclose(np.std(errors[:, 3:]), 0.02, rtol=0.1)
    assert np.allclose([np.linalg.norm(x[3:]) for x in seen], 1.0)
