"""References in joint space."""

from dataclasses import replace

import numpy as np

from pinadapt.scenario.scenario import trajectory_of
from pinadapt.tasks.task import JointTask
from tests.support.chains import catalogue_robot


def motion(**reference):
    """Return the motion of a reference for the joints of the scara, and the robot."""
    robot = catalogue_robot("scara")
    robot = replace(robot, task=JointTask.of_joints(robot.model))
    return trajectory_of(reference, robot), robot


def test_a_sinusoid_starts_at_home_and_at_rest():
    path, robot = motion(kind="sinusoid", amplitude=0.2, period=2.0)
    assert np.allclose(path.at(0.0).x_d, robot.home_angles)
    assert np.allclose(path.at(0.0).xd_d, 0.0)
    assert np.allclose(path.at(1.0).x_d, robot.home_angles + 0.4)


def test_a_fourier_series_starts_at_home_unless_its_center_is_given():
    rows = {"cosine": [[0.1, -0.025]] * 4, "sine": [[0.2, -0.1]] * 4, "period": 5.0}
    path, robot = motion(kind="fourier", **rows)
    assert np.allclose(path.at(0.0).x_d, robot.home_angles)
    assert np.allclose(path.at(0.0).xd_d, 0.0) and np.allclose(path.at(0.0).xdd_d, 0.0)
    placed, _ = motion(kind="fourier", center=[0.1, 0.2, 0.0, 0.4], **rows)
    assert np.allclose(placed.at(0.0).x_d, [0.175, 0.275, 0.075, 0.475])
