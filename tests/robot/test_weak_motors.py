"""A load that the motors cannot hold causes a warning, and its run says so."""

import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits
from pinadapt.robot.motors import overloaded
from tests.support.chains import catalogue_robot


def test_a_load_that_the_motors_cannot_hold_causes_a_warning_before_the_run():
    robot = catalogue_robot("ur5")
    heavy = robot.changed(payload=pa.Payload(mass=40.0))
    assert overloaded(robot, effort_limits(robot.model)) is None
    told = overloaded(heavy, effort_limits(heavy.model))
    assert "shoulder_lift_joint (" in told and "elbow_joint (" in told and "N m" in told
    assert "shoulder_pan_joint" not in told  # its axis is vertical
    controller = pa.make_controller(robot)
    path = pa.trajectories.Hold(heavy.position(heavy.q0))
    words = "cannot hold the true robot at its home pose: shoulder_lift_joint"
    with pytest.warns(UserWarning, match=words):
        rollout = pa.simulate(heavy, controller, path, duration=0.5)
    assert "motors were at their limit" in rollout.verdict
