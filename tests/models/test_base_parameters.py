"""Base parameters: their number, their names, and the torque that they reproduce."""

import numpy as np
import pinocchio as pin
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
    assert (found.size, kinematics.size, kinematics.base()) == (base, of, base)
    along_the_first_axis = f"{robot.joint_names[1]}_z"
    assert set(found.without_effect) == {"base_x", "base_y", "base_z", along_the_first_axis}


def planar_3r():
    """Return an arm of three revolute joints in the vertical plane, links of 0.4, 0.3 and 0.2 m."""
    model = pin.Model()
    parent, step = 0, pin.SE3.Identity()
    for i, length in enumerate((0.4, 0.3, 0.2)):
        parent = model.addJoint(parent, pin.JointModelRY(), step, f"joint{i + 1}")
        body = pin.Inertia.FromSphere(1.0, 0.05)
        step = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
        model.appendBodyToJoint(parent, body, pin.SE3(np.eye(3), 0.5 * step.translation))
    model.addFrame(pin.Frame("tip", parent, 0, step, pin.FrameType.BODY))
    return pa.load(model, frame="tip", task="xz")


def test_planar_arm_of_three_links_has_six_lengths_and_nine_inertial_parameters():
    """A link's length along itself and across it; an inertia and two moments a body."""
    robot = planar_3r()
    kinematics = pa.models.FrameKinematics(robot, ["base", *robot.joint_names[1:], "tool"])
    found = pa.models.base_parameters(kinematics, robot)
    assert (found.size, kinematics.size) == (6, 12)
    assert all(name.endswith(("_x", "_z")) for name in found.names)
    assert pa.models.base_parameters(pa.models.BodyDynamics(robot), robot).size == 3 * 3


@pytest.mark.parametrize("name", ["panda", "ur5", "scara", "kinova"])
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
        assert np.allclose(Y[:, base.chosen] @ base.values(a), Y @ a, rtol=1e-7, atol=1e-7)
