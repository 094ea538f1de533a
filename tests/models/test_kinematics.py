"""Every kinematic regressor against Pinocchio and finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given

import pinadapt as pa
from tests.support.chains import (
    catalogue_robot,
    chains,
    each_size,
    random_state,
    seeded,
)
from tests.support.identities import check_kinematics, unknown_choices

ROBOTS = ["planar_2r", "scara", "panda", "tiago_arm"]


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("choice", range(4))
def test_identities_on_robots(name, choice):
    robot = catalogue_robot(name)
    check_kinematics(robot, unknown_choices(robot)[choice])


@each_size()
@given(robot=chains)
@seeded
def test_identities_on_random_chains(robot):
    for unknown in unknown_choices(robot):
        check_kinematics(robot, unknown)


@pytest.mark.parametrize("name", ROBOTS)
def test_jacobian_of_the_nominal_robot_is_that_of_pinocchio(name):
    robot = catalogue_robot(name)
    kinematics = pa.models.FrameKinematics(robot, ["lengths"])
    q, v, _ = random_state(robot, np.random.default_rng(1))
    kinematics.update(kinematics.initial, q, v)
    data = robot.model.createData()
    J = pin.computeFrameJacobian(robot.model, data, q, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)[
        robot.task.rows
    ]
    assert np.allclose(kinematics.J, J, atol=1e-12)
    assert np.allclose(kinematics.x_hat, robot.position(q), atol=1e-12)


def test_parameters_of_a_changed_robot():
    robot = catalogue_robot("panda")
    kinematics = pa.models.FrameKinematics(robot, ["tool", "panda_joint4"])
    true = robot.changed(
        tool_translation=[0.01, 0.02, 0.03], link_translation={"panda_joint4": [0.0, 0.0, 0.01]}
    )
    q, v, _ = random_state(robot, np.random.default_rng(3))
    kinematics.update(kinematics.value(true), q, v)
    assert np.allclose(kinematics.x_hat, true.position(q), atol=1e-12)
    other = robot.changed(link_translation={"panda_joint6": [0.01, 0.0, 0.0]})
    assert kinematics.value(other) is None  # other placements differ too
