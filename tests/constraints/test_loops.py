"""Joints that follow others and loops: torques of the motors, and V whatever the forces are."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.controller.constraint_forces import ConstraintForces
from pinadapt.description.catalogue import example_path, robots_folder
from tests.support.loops import energy_along

RIGID = pa.Unknown(friction=False, armature=False)
DELTA = robots_folder() / "delta" / "delta.xml"
MOVE = [0.3, -0.2, 0.1]  # of its motors [rad]
# A four-bar linkage in an oblique plane that a column turns; a tendon drives the crank.
FOUR_BAR = """<mujoco><compiler angle="radian"/>
  <worldbody>
    <body name="column"><joint name="yaw" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
      <body name="crank" euler="0.3 0.8 1.2"><joint name="crank" axis="0 0 1"/>
        <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
        <body name="coupler" pos="0.2 0 0" euler="0 0 -1"><joint name="pin" axis="0 0 1"/>
          <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body>
      <body name="rocker" pos="0.02 0.3 0.01" euler="0.3 0.8 0.1">
        <joint name="rocker" axis="0 0 1" ref="0.2"/>
        <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body>
    <body name="handle" mocap="true"/>
  </worldbody>
  <equality>
    <connect body1="coupler" body2="rocker" anchor="0.25 0 0"/>
    <weld body1="crank" active="false"/>
    <weld body1="handle" body2="coupler"/>
  </equality>
  <tendon><fixed name="belt"><joint joint="crank" coef="2"/></fixed></tendon>
  <actuator><motor joint="yaw"/><motor tendon="belt"/></actuator>
</mujoco>"""
ELBOWS = ["left_elbow", "right_elbow"]


def gripper():
    """A Panda with its two fingers, one of which follows the other."""
    return pa.load(example_path("panda"), task="joint")


def five_bar(**loop):
    return pa.load(
        robots_folder() / "five_bar" / "five_bar.urdf",
        task="joint",
        loops=[pa.Loop("left_tip", "right_tip", **loop)],
        passive=ELBOWS,
        q0=[2.0, -1.2, 1.1, 1.2],
        gravity=[0.0, -9.81, 0.0],
    )


def delta():
    return pa.load(DELTA, task="joint")


def test_a_gripper_has_the_torques_of_pinocchios_mimic_model():
    robot = gripper()
    names = robot.joint_names
    assert names[-2:] == ["panda_finger_joint1", "panda_finger_joint2"]
    assert robot.motors.tolist() == [True] * 8 + [False]
    assert robot.task.labels == tuple(names[:-1])
    mimic = pin.buildModelFromUrdf(str(example_path("panda")), mimic=True)
    assert mimic.nv == 8
    rng = np.random.default_rng(0)
    G = np.vstack([np.eye(8), np.eye(8)[-1]])
    forces = ConstraintForces(robot)
    for _ in range(5):
        u, ud, udd = 0.3 * rng.standard_normal((3, 8))
        tau = pin.rnea(robot.model, robot.model.createData(), G @ u, G @ ud, G @ udd)
        found = forces.solve(G @ u, tau).torque
        expected = pin.rnea(mimic, mimic.createData(), u, ud, udd)
        assert np.allclose(found[:8], expected, atol=1e-9) and found[8] == 0.0


@pytest.mark.parametrize("make", [five_bar, delta])
def test_a_loop_is_closed_at_home(make):
    robot = make()
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    for loop, at in robot.constrained.placed:
        assert np.abs(loop.error(data, at, robot.home_angles)).max() < 1e-9


def test_rows_that_follow_from_others_are_left_out():
    assert [loop.rows for loop in five_bar().constraints] == [(0, 1)]
    with pytest.raises(pa.RobotError, match="2 motors cannot move independently"):
        five_bar(rows=(0, 1, 2, 3, 4, 5))


def test_loops_of_mjcf_are_those_of_mujoco(tmp_path):
    path = tmp_path / "four_bar.xml"
    path.write_text(FOUR_BAR)
    with pytest.warns(UserWarning, match="1 kinematic loops closed by <equality> are opened"):
        pa.load(path, frame="crank", task="joint")
    bar = pa.load(path, task="joint")
    assert bar.task.labels == ("yaw", "crank")
    assert pa.load(path, frame="coupler", task="xy").constraints == bar.constraints
    assert delta().task.labels == ("motor_1", "motor_2", "motor_3")
    for file, robot, move in ((path, bar, [1.5, 0.3]), (DELTA, delta(), MOVE)):
        model = mujoco.MjModel.from_xml_path(str(file))
        data = mujoco.MjData(model)
        home = robot.position(robot.q0)
        data.eq_active[2:] = 0  # the weld to the handle
        for share in (0.0, 1.0):
            data.qpos[:] = robot.configuration(home + share * np.array(move))
            mujoco.mj_forward(model, data)
            rows = slice(data.ne)
            assert np.abs(data.efc_pos[rows]).max() < 1e-9
            theirs = data.efc_J.reshape(-1, model.nv)[rows]
            A, _ = robot.constrained.at(data.qpos, np.zeros(model.nv))
            assert np.linalg.matrix_rank(theirs, tol=1e-6) == len(A)
            spanned = np.linalg.pinv(A) @ A
            assert np.allclose(theirs @ spanned, theirs, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "adaptation"),
    [(gripper, "natural-memory"), (five_bar, "natural"), (delta, "natural-memory")],
)
def test_lyapunov_equality_under_constraints(make, adaptation):
    """Differences of V are further off while a memory fills; half the period: a thirteenth."""
    robot = make()
    options = {"unknown": RIGID, "gamma_d": 20.0, "adaptation": adaptation}
    controller = pa.make_controller(robot.changed(inertial_scale=0.8), **options)
    x = robot.position(robot.q0)
    path = pa.trajectories.Sinusoid(x, 0.02 * np.ones(x.size), 1.0 + 0.1 * np.arange(x.size))
    energy = energy_along(robot, controller, path, seconds=2.6e-3, dt=5e-5)
    assert energy.mismatch(after=40) <= 1e-7


@pytest.mark.slow
def test_the_platform_of_a_delta_follows_with_wrong_inertias():
    robot = pa.load(DELTA, frame="tool")
    path = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0).starting_at(robot.position(robot.q0))
    controller = pa.make_controller(robot.changed(inertial_scale=0.7), unknown=RIGID, dt=4e-3)
    rollout = pa.simulate(robot, controller, path, duration=0.9)
    assert rollout.distance[-75:].max() < 1e-4  # 2.2 mm without adaptation


@pytest.mark.slow
def test_joints_under_constraints_follow_with_wrong_inertias():
    robot = five_bar()
    model = robot.changed(inertial_scale=0.7)
    x = robot.position(robot.q0)
    size = np.array(
        [0.2 if "motor" in label or label.endswith("7") else 0.01 for label in robot.task.labels]
    )
    path = pa.trajectories.Sinusoid(x, size, 2.0 + 0.1 * np.arange(x.size))
    ends = []
    for adaptation in ("none", None):
        controller = pa.make_controller(
            model, unknown=RIGID, adaptation=adaptation, limits=pa.Limits(guards=False), dt=4e-3
        )
        rollout = pa.simulate(robot, controller, path, duration=0.9)
        ends.append(np.abs(rollout.distance[-75:]).max())
    assert ends[1] < 0.1 * ends[0]
