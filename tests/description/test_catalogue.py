"""The table of the catalogue, and limbs of larger robots."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt._output import read_toml
from pinadapt.description.catalogue import robots_folder
from pinadapt.description.description import _from_catalogue
from tests.support.chains import catalogue_robot
from tests.support.loops import check_holds_home

ROWS = read_toml(robots_folder() / "catalogue.toml")


def test_chains_have_the_stated_number_of_joints():
    entries = pa.catalogue().values()
    counted = {}
    for entry in entries:
        model = _from_catalogue(entry.name).model
        counted[entry.name] = len(entry.limb(model)[1])
    assert counted == {entry.name: entry.joints for entry in entries}


LIMBS = [  # name, joints, first and last of them
    ("double_pendulum_simple", 2, "joint1", "joint2"),
    ("icub_right_leg", 6, "r_hip_pitch", "r_ankle_roll"),
    ("human_left_arm", 8, "left_clavicle_joint_X", "left_wrist_X"),
    ("solo8_fl_leg", 2, "FL_HFE", "FL_KFE"),
    ("allegro_right_index", 4, "joint_0.0", "joint_3.0"),
]


@pytest.mark.parametrize(("name", "joints", "first", "last"), LIMBS)
def test_a_limb_of_a_larger_robot_loads_and_tracks(name, joints, first, last):
    robot = catalogue_robot(name)
    assert (len(robot.joint_names), robot.joint_names[0], robot.joint_names[-1]) == (
        joints,
        first,
        last,
    )
    check_holds_home(robot)


def test_a_tip_is_at_the_stated_position():
    robot = catalogue_robot("double_pendulum")
    row = ROWS["double_pendulum"]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.q0)
    assert robot.frame == "link2_tip"
    assert np.allclose(
        robot.position(robot.q0), data.oMi[2].act(np.array(row["tip"]))[1:], atol=1e-12
    )
