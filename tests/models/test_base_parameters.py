"""Base parameters: their number, their names, and the torque that they reproduce."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot, random_state


@pytest.mark.parametrize(
    ("name", "base"), [("ur5", 36), ("panda", 43), ("kinova", 36), ("planar_2r", 4)]
)
def test_number_of_inertial_base_parameters_is_the_known_one(name, base):
    robot = catalogue_robot(name)
    assert pa.models.base_parameters(pa.models.BodyDynamics(robot), robot).size == base


@pytest.mark.parametrize(("name", "base", "of"), [("ur5", 12, 21), ("panda", 14, 24)])
def test_number_of_identifiable_translations_is_the_known_one(name, base, of):
    robot = catalogue_robot(name)
    kinematics = pa.models.FrameKinematics(robot, ["base", *robot.joint_names[1:], "tool"])
    found = pa.models.base_parameters(kinematics, robot)
    assert (found.size, kinematics.size) == (base, of)
    along_the_first_axis = f"{robot.joint_names[1]}_z"
    assert set(found.without_effect) == {"base_x", "base_y", "base_z", along_the_first_axis}


@pytest.mark.parametrize("name", ["panda", "scara"])
def test_base_parameters_reproduce_the_torque(name):
    robot = catalogue_robot(name)
    dynamics = pa.models.StackedDynamics(
        pa.models.BodyDynamics(robot), pa.models.JointEffects(robot)
    )
    base = pa.models.base_parameters(dynamics, robot)
    inertial = pa.models.base_parameters(dynamics.inertial, robot)
    # rotors of the first joint, and on some arms of the second, cannot be told from inertias
    assert inertial.size + 2 * robot.model.nv <= base.size <= inertial.size + dynamics.joints.size
    rng = np.random.default_rng(7)
    for _ in range(5):
        Y = dynamics.regressor(*random_state(robot, rng))
        a = rng.standard_normal(dynamics.size)
        assert np.allclose(Y[:, base.chosen] @ base.regrouping @ a, Y @ a, rtol=1e-7, atol=1e-7)
