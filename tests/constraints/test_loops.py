"""Joints that follow others and loops: torques of the motors, and V whatever the forces are."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.controller.constraint_forces import ConstraintForces
from pinadapt.description.catalogue import example_path, robots_folder
from tests.support.loops import energy_along

RIGID = pa.Unknown(friction=False, armature=False)
LOOP = pa.Loop("left_tip", "right_tip", rows=(0, 1))
ELBOWS = ["left_elbow", "right_elbow"]


def gripper():
    """A Panda with its two fingers, one of which follows the other."""
    return pa.load(example_path("panda"), task="joint")


def five_bar():
    return pa.load(
        robots_folder() / "five_bar" / "five_bar.urdf",
        task="joint",
        loops=[LOOP],
        passive=ELBOWS,
        q0=[2.0, -1.2, 1.1, 1.2],
        gravity=[0.0, -9.81, 0.0],
    )


def test_a_gripper_has_the_torques_of_pinocchios_mimic_model():
    robot = gripper()
    names = robot.joint_names
    assert names[-2:] == ["panda_finger_joint1", "panda_finger_joint2"]
    assert robot.motors.tolist() == [True] * 8 + [False]
    assert robot.task.labels == tuple(names[:-1])
    mimic = pin.buildModelFromUrdf(str(example_path("panda")), mimic=True)
    assert mimic.nv == 8
    rng, G = np.random.default_rng(0), np.vstack([np.eye(8), np.eye(8)[-1]])
    forces = ConstraintForces(robot, None)
    for _ in range(5):
        u, ud, udd = 0.3 * rng.standard_normal((3, 8))
        tau = pin.rnea(robot.model, robot.model.createData(), G @ u, G @ ud, G @ udd)
        found = forces.torque(G @ u, tau)
        expected = pin.rnea(mimic, mimic.createData(), u, ud, udd)
        assert np.allclose(found[:8], expected, atol=1e-9) and found[8] == 0.0


def test_a_loop_is_closed_at_home_and_its_rows_are_those_of_differences():
    robot = five_bar()
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    a, b = (data.oMf[robot.model.getFrameId(name)] for name in ("left_tip", "right_tip"))
    assert np.allclose(a.translation, b.translation, atol=1e-9)
    v, h = np.random.default_rng(1).standard_normal(4), 1e-6
    constraints = robot.constrained
    before, after = (constraints.at(robot.q0 + sign * h * v, v)[0] for sign in (-1.0, 1.0))
    assert np.allclose(constraints.at(robot.q0, v)[1], (after - before) / (2.0 * h), atol=1e-6)


@pytest.mark.parametrize("make", [gripper, five_bar])
def test_lyapunov_equality_under_constraints(make):
    robot = make()
    options = {"unknown": RIGID, "gamma_d": 20.0, "limits": pa.Limits(guards=False)}
    controller = pa.make_controller(robot.changed(inertial_scale=0.8), **options)
    x = robot.position(robot.q0)
    path = pa.trajectories.Sinusoid(x, 0.02 * np.ones(x.size), 1.0 + 0.1 * np.arange(x.size))
    energy = energy_along(robot, controller, path, seconds=8e-3, dt=2e-4)
    assert energy.mismatch(after=5) <= 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("make", [gripper, five_bar])
def test_joints_under_constraints_follow_with_wrong_inertias(make):
    robot = make()
    model, x = robot.changed(inertial_scale=0.7), robot.position(robot.q0)
    size = np.array(
        [0.2 if label.endswith(("motor", "7")) else 0.01 for label in robot.task.labels]
    )
    path = pa.trajectories.Sinusoid(x, size, 2.0 + 0.1 * np.arange(x.size))
    ends = []
    for adaptation in ("none", "natural"):
        controller = pa.make_controller(
            model, unknown=RIGID, adaptation=adaptation, limits=pa.Limits(guards=False)
        )
        rollout = pa.simulate(robot, controller, path, duration=5.0, progress=False)
        ends.append(np.abs(rollout.distance[-500:]).max())
    assert ends[1] < 0.1 * ends[0]
