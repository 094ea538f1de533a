"""The table of the catalogue, and limbs of larger robots."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt._output import read_toml
from pinadapt.description.catalogue import robots_folder
from pinadapt.tasks.frame import TASKS
from tests.support.chains import catalogue_robot
from tests.support.loops import check_holds_home

ROWS = read_toml(robots_folder() / "catalogue.toml")
KEYS = {"urdf", "loader", "first", "frame", "joints", "tip", "task", "q0", "about"}


def test_rows_have_known_keys_a_frame_and_a_remark():
    for name, row in ROWS.items():
        assert set(row) <= KEYS, name
        assert row["frame"] and row["about"] and row.get("task", "xyz") in TASKS, name
        assert not {"urdf", "loader"} <= set(row), name


def test_no_chain_is_listed_twice():
    chains = [
        (row.get("loader", row.get("urdf", name)), row.get("first"), row["frame"])
        for name, row in ROWS.items()
    ]
    assert len(set(chains)) == len(chains) == len(pa.catalogue())
    assert len({row["about"] for row in ROWS.values()}) == len(ROWS)


def test_chains_have_the_stated_number_of_joints():
    entries = pa.catalogue().values()
    counted = {entry.name: len(entry.limb(entry.load()[0])[1]) for entry in entries}
    assert counted == {entry.name: entry.joints for entry in entries}


def test_loaders_exist():
    from example_robot_data.robots_loader import ROBOTS

    assert {entry.origin for entry in pa.catalogue().values() if entry.path is None} <= set(ROBOTS)


LIMBS = [  # name, joints, first and last of them
    ("ur3", 6, "shoulder_pan_joint", "wrist_3_joint"),
    ("asr_twodof", 2, "J1", "J2"),
    ("double_pendulum_simple", 2, "joint1", "joint2"),
    ("so100", 5, "shoulder_pan", "wrist_roll"),
    ("talos_left_arm", 7, "arm_left_1_joint", "arm_left_7_joint"),
    ("icub_right_leg", 6, "r_hip_pitch", "r_ankle_roll"),
    ("human_left_arm", 8, "left_clavicle_joint_X", "left_wrist_X"),
    ("pr2_right_arm", 7, "r_shoulder_pan_joint", "r_wrist_roll_joint"),
    ("bolt_fr_leg", 3, "FR_HAA", "FR_KFE"),
    ("hyq_rh_leg", 3, "rh_haa_joint", "rh_kfe_joint"),
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


def test_ur3_is_not_the_ur5():
    upper_arms = [
        catalogue_robot(name).model.jointPlacements[3].translation[2] for name in ("ur3", "ur5")
    ]
    assert np.allclose(upper_arms, [0.24365, 0.425], atol=1e-4)  # [m], the manufacturer's


def test_a_tip_is_at_the_stated_position():
    robot, row = catalogue_robot("double_pendulum"), ROWS["double_pendulum"]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.q0)
    assert robot.frame == "link2_tip"
    assert np.allclose(
        robot.position(robot.q0), data.oMi[2].act(np.array(row["tip"]))[1:], atol=1e-12
    )


def test_limbs_of_one_robot_share_its_description_but_not_their_models():
    left, right = pa.load("solo12_fl_leg"), pa.load("solo12_fr_leg")
    before = right.model.copy()
    left.model.inertias[1] = pin.Inertia.FromSphere(5.0, 0.1)
    assert right.model == before
    assert pa.load("solo12_fl_leg").model != left.model


def test_home_poses_of_limbs_are_set_joint_by_joint(monkeypatch):
    angles = catalogue_robot("talos_left_arm").home_angles + 0.01 * np.arange(7)
    entry = replace(pa.catalogue()["talos_left_arm"], q0=tuple(angles))
    monkeypatch.setitem(pa.catalogue(), "talos_left_arm", entry)
    assert np.allclose(pa.load("talos_left_arm").home_angles, angles, atol=1e-12)


def test_mimic_joints_of_the_catalogue_are_refused():
    with pytest.raises(pa.RobotError, match="mimic"):
        pa.load("panda", frame="panda_rightfinger")


@pytest.mark.parametrize(("name", "axes"), [("solo8_fl_leg", [0, 2]), ("quadruped_fl_leg", [1, 2])])
def test_planar_tasks_are_rows_of_the_position(name, axes):
    robot = catalogue_robot(name)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    assert np.array_equal(robot.position(robot.q0), data.oMf[robot.frame_id].translation[axes])
