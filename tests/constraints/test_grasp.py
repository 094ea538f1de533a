"""Two arms that hold one object: its rows, V, its inertia found, and the chosen squeeze."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.trajectories import Circle, PoseTrajectory, Swing
from tests.support.loops import energy_along

FRAMES = "left_gripper_base_link", "right_gripper_base_link"
OBJECT = pa.Payload(2.0, (0.1, 0.05, 0.1), (0.02, 0.0, 0.02, 0.0, 0.0, 0.02))
UNKNOWN = pa.Unknown(bodies="payload", friction=False, armature=False)
FINGERS = [f"{hand}_gripper_{side}_finger_joint" for hand in "lr" for side in "lr"]
SQUEEZE = 20.0  # [N]


@cache
def holding():
    """Both arms of Baxter, the object on the left one, whose gripper is the task."""
    grasp = pa.Loop(*FRAMES, rows=(0, 1, 2, 3, 4, 5), closed=False, squeeze=SQUEEZE)
    left = [-1.03, -0.12, 0.0, 2.15, 0.23, 0.2, 1.96]
    right = [1.03, -0.12, 0.0, 2.15, -0.23, 0.2, -1.96]
    robot = pa.load(
        "baxter",
        frame=FRAMES[0],
        task="pose",
        locked=["head_pan", *FINGERS],
        loops=[grasp],
        q0=left + right,
    )
    return robot.changed(friction=pa.Friction(), armature=0.0)


def path(robot, radius):
    motion = PoseTrajectory(Circle(np.zeros(3), radius, 3.0), Swing((1.0, 1.0, 1.0), 0.15, 2.0))
    return motion.starting_at(robot.position(robot.q0)).from_rest()


def relative(robot, q):
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    left, right = (data.oMf[robot.model.getFrameId(name)] for name in FRAMES)
    return left.actInv(right)


def test_the_rows_of_a_grasp_are_those_of_one_body():
    robot = holding()
    h = 1e-6
    rng = np.random.default_rng(0)
    q = robot.q0 + 0.2 * rng.standard_normal(robot.model.nv)
    v = rng.standard_normal(robot.model.nv)
    A, _ = robot.constrained.at(q, v)
    v -= np.linalg.pinv(A) @ (A @ v)
    apart = pin.log6(relative(robot, q).actInv(relative(robot, q + h * v))).vector
    assert np.abs(apart).max() < 1e-10  # a way of h, to second order


@pytest.mark.slow
def test_lyapunov_equality_of_two_arms_with_an_object():
    robot = holding()
    true = robot.changed(payload=OBJECT)
    controller = pa.make_controller(robot, unknown=UNKNOWN, limits=pa.Limits(guards=False))
    energy = energy_along(true, controller, path(true, 0.02), seconds=4e-3, dt=1e-4)
    assert energy.mismatch(after=10) <= 1e-6


@pytest.mark.slow
def test_an_object_is_found_and_squeezed():
    robot = holding()
    true = robot.changed(payload=OBJECT)
    controller = pa.make_controller(robot, unknown=UNKNOWN, dt=4e-3)
    rollout = pa.simulate(true, controller, path(true, 0.05), duration=1.8)
    assert rollout.distance.max() < 4e-3 and rollout.distance[-100:].max() < 1e-4
    body = robot.carriers[0] + 1
    found, truth = (each.model.inertias[body].mass for each in (rollout.learned(), true))
    assert found == pytest.approx(truth, rel=0.05)
    # what the arms do to the object, by the true robot
    model, (q, v, tau) = true.model, (part[-1] for part in (rollout.q, rollout.v, rollout.tau))
    data, (A, rate) = model.createData(), true.constrained.at(q, v)
    M = pin.crba(model, data, q)
    rest = pin.nonLinearEffects(model, data, q, v)
    saddle = np.block([[M, -A.T], [A, np.zeros((6, 6))]])
    force = np.linalg.solve(saddle, np.append(tau - rest, -rate @ v))[model.nv :][:3]
    way = relative(robot, q)
    n = way.translation
    assert force @ n / np.linalg.norm(n) == pytest.approx(SQUEEZE, abs=1.0)
    assert np.abs(pin.log6(relative(robot, robot.q0).actInv(way)).vector).max() < 1e-3


def test_grasps_that_are_none_are_refused():
    for wrong in ({"squeeze": 1.0}, {"squeeze": 1.0, "closed": False, "rows": (0, 1)}):
        with pytest.raises(pa.RobotError, match="squeeze"):
            pa.Loop(*FRAMES, **wrong)
    with pytest.raises(pa.RobotError, match="given twice"):
        pa.load("baxter", loops=[pa.Loop(*FRAMES)] * 2)
    with pytest.raises(pa.RobotError, match="0 to 5"):
        pa.Loop(*FRAMES, rows=(6,))
