"""Robots written as MJCF move in MuJoCo as in Pinocchio; effects of joints survive a URDF."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import angles_from_configuration
from tests.support.chains import catalogue_robot, random_state

mujoco = pytest.importorskip("mujoco")


@pytest.mark.parametrize("name", ["panda", "scara", "kinova"])
def test_accelerations_and_frames_are_those_of_the_robot(name):
    rng = np.random.default_rng(4)
    described = catalogue_robot(name)
    n = described.model.nv
    friction = pa.Friction(rng.uniform(0.1, 1.0, n), rng.uniform(0.1, 1.0, n))
    robot = described.changed(armature=rng.uniform(0.01, 0.2, n), friction=friction)
    model = mujoco.MjModel.from_xml_string(robot.mjcf())
    data = mujoco.MjData(model)
    np.testing.assert_allclose(model.jnt_actfrcrange[:, 1], robot.model.effortLimit)
    np.testing.assert_allclose(model.dof_frictionloss, friction.coulomb)
    np.testing.assert_allclose(model.dof_damping, friction.viscous)
    model.dof_frictionloss[:] = 0.0  # MuJoCo's constraints are soft, compared by number alone
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    smooth = replace(friction, coulomb=np.zeros(n))
    plant = pa.plants.PinocchioPlant(robot.changed(friction=smooth))
    for _ in range(3):
        q, v, tau = random_state(robot, rng)
        data.qpos[:] = angles_from_configuration(robot.model, q)
        data.qvel[:], data.qfrc_applied[:] = v, tau
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(
            data.qacc, plant.acceleration_at(q, v, tau), rtol=1e-5, atol=1e-5
        )
        site = data.site(robot.frame).xpos
        np.testing.assert_allclose(site, robot.placement(q).translation, atol=1e-8)


def test_a_tree_has_the_mass_matrix_of_the_robot():
    described = catalogue_robot("solo8_fl_leg").drawn.whole
    robot = pa.load(described, task="joint")
    model = mujoco.MjModel.from_xml_string(robot.mjcf())
    data = mujoco.MjData(model)
    M = np.zeros((robot.model.nv, robot.model.nv))
    data.qpos[:] = robot.q0
    mujoco.mj_forward(model, data)
    for row, unit in zip(M, np.eye(len(M)), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    expected = pin.crba(robot.model, robot.model.createData(), robot.q0)
    np.testing.assert_allclose(M, expected, atol=1e-8)
