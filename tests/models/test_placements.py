"""Positions with every placement of the chain a little off, to first order."""

from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.calibration import wrong_arm
from pinadapt.models.linear_kinematics import GEOMETRY, FrameKinematics
from tests.support.chains import catalogue_robot, mixed_robot, random_robot, random_state
from tests.support.differences import derivative
from tests.support.identities import check_kinematics
from tests.support.loops import energy_along

UNKNOWN = pa.Unknown(geometry=True, friction=False, armature=False)


@pytest.mark.parametrize(
    "robot",
    [catalogue_robot("scara"), catalogue_robot("planar_2r"), mixed_robot(), random_robot(4, 5)],
    ids=lambda robot: robot.name,
)
def test_identities(robot):
    """Every quantity against finite differences, and at no displacement the described ones."""
    kinematics = FrameKinematics(robot, GEOMETRY)
    check_kinematics(kinematics)
    q, v, _ = random_state(robot, np.random.default_rng(5))
    kinematics.update(0.0 * kinematics.initial, q, v)
    assert np.allclose(kinematics.p_hat, robot.position(q), atol=1e-12)


@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_the_columns_are_the_derivatives_by_the_placements(name):
    """And what is left of a wrong arm is of second order, within its bound."""
    robot = catalogue_robot(name)
    rng = np.random.default_rng(1)
    kinematics = FrameKinematics(robot, GEOMETRY)
    q, v, _ = random_state(robot, rng)
    kinematics.update(kinematics.initial, q, v)

    def moved(a_k):
        model = robot.model.copy()
        kinematics.write(model, a_k)
        assert np.allclose(kinematics.read(model, a_k), a_k, atol=1e-12)
        return replace(robot, model=model).position(q)

    for k, own in enumerate(np.eye(kinematics.size)):
        slope = derivative(lambda h, own=own: moved(h * own))
        assert np.allclose(kinematics.X_k[:, k], slope, atol=1e-10), kinematics.names[k]
    a = kinematics.sizes * rng.standard_normal(kinematics.size)
    units = np.array(kinematics.units)
    for share in (0.1, 0.01):
        left = np.linalg.norm(moved(share * a) - kinematics.p_hat - share * kinematics.X_k @ a)
        turns, shifts = (np.abs(share * a[units == unit]).sum() for unit in ("rad", "m"))
        assert 0.0 < left < 0.5 * turns**2 * 1.5 * robot.reach + turns * shifts


def test_parameters_of_a_robot_exist_without_turns():
    robot = catalogue_robot("ur5")
    kinematics = FrameKinematics(robot, GEOMETRY)
    longer = robot.changed(
        tool_translation=[0.03, -0.02, 0.08],
        link_translation={"elbow_joint": [0.01, 0.02, -0.01], "wrist_2_joint": [0.0, 0.01, 0.02]},
    )
    a_k = kinematics.value(longer)
    rng = np.random.default_rng(2)
    q, v, _ = random_state(robot, rng)
    kinematics.update(a_k, q, v)
    assert kinematics.x_hat == pytest.approx(longer.position(q), abs=1e-12)
    assert kinematics.value(wrong_arm(robot, rng)) is None
    # 27 of a calibration, less the position of the base and two shifts along three parallel axes
    assert pa.models.base_parameters(kinematics, robot).size == 27 - 3 - 2


def test_lyapunov_equality_with_unknown_placements():
    """For shifts the position is exactly linear, and so is V's rate exactly that of the proof."""
    robot = catalogue_robot("ur5")
    shifted = {"shoulder_pan_joint": [0.03, 0.02, -0.04]}
    true = robot.changed(tool_translation=[0.03, -0.02, 0.08], link_translation=shifted)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.7),
        unknown=UNKNOWN,
        adaptation="natural",
        limits=pa.Limits(box=False),
        gamma_d=5.0,
    )
    circle = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0)
    path = circle.starting_at(robot.position(robot.q0) + np.full(3, 0.01)).as_given()
    energy = energy_along(true, controller, path, seconds=0.006)
    assert energy.mismatch() < 1e-3


def test_a_turned_arm_is_followed_and_its_geometry_learned():
    """2 degrees and 2 mm off everywhere: what is left is the remainder of second order."""
    robot = catalogue_robot("ur5")
    true = wrong_arm(robot, np.random.default_rng(1))
    controller = pa.make_controller(robot, unknown=UNKNOWN, adaptation="natural", dt=4e-3)
    path = pa.reachable_circle(robot).starting_at(true.position(true.q0))
    rollout = pa.simulate(true, controller, path, duration=1.0)
    kinematics = controller.kinematics
    left = []
    for k in (25, -1):
        kinematics.update(rollout.a_k[k], rollout.q[k], rollout.v[k])
        left.append(np.linalg.norm(kinematics.x_hat - rollout.x[k]))
    assert left[0] > 1e-3 and left[1] < 2e-4
    learned = rollout.learned()
    assert np.linalg.norm(learned.position(true.q0) - true.position(true.q0)) < 5e-3
    assert rollout.parameters().units["elbow_joint.turn_x"] == "rad"
