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
    check_kinematics(pa.models.FrameKinematics(robot, unknown_choices(robot)[choice]))


@each_size()
@given(robot=chains)
@seeded
def test_identities_on_random_chains(robot):
    for unknown in unknown_choices(robot):
        check_kinematics(pa.models.FrameKinematics(robot, unknown))


@pytest.mark.parametrize("name", [*ROBOTS, "pose"])
def test_those_of_the_nominal_robot_are_pinocchios(name):
    robot = catalogue_robot("kinova", task="pose") if name == "pose" else catalogue_robot(name)
    kinematics = pa.models.FrameKinematics(robot, ["lengths"])
    q, v, _ = random_state(robot, np.random.default_rng(1))
    kinematics.update(kinematics.initial, q, v)
    data = robot.model.createData()
    J = pin.computeFrameJacobian(robot.model, data, q, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)
    assert np.allclose(kinematics.J, J[robot.task.rows], atol=1e-12)
    off = robot.task.error(kinematics.x_hat, robot.position(q))
    assert np.allclose(off, 0.0, atol=1e-12)
