"""Pose tasks: position and orientation, and the two-row tasks beside them."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt.models import FrameKinematics
from pinadapt.tasks.frame import TASKS, matrix, quaternion, rotation_between, rotation_drift, turned
from tests.support.chains import catalogue_robot, chains, each_size, seeded, seeds
from tests.support.differences import derivative
from tests.support.identities import check_kinematics, unknown_choices
from tests.support.loops import energy_along, with_tool_and_load

pytestmark = pytest.mark.slow

POSE = TASKS["pose"]
LAWS = [
    "adaptive-inverse-dynamics",
    "adaptive-inverse-dynamics-velocity",
    "adaptive-jacobian",
    "adaptive-inverse-dynamics-improved",
]
vectors = seeds.map(lambda seed: np.random.default_rng(seed).standard_normal((4, 3)))


def pose_robot(name):
    return catalogue_robot(name, task="pose")


def swinging(start, by=(0.0,) * 6):
    """Return a circle whose tool swings, beside a starting pose by an error (6)."""
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz"),
        pa.trajectories.Swing([0.3, -1.0, 0.5], 0.4, 1.5, phase=0.3),
    )
    return path.starting_at(POSE.moved(start, np.array(by)))


# --- rotations ---


@given(vectors, st.floats(0.0, 3.1))
@seeded
def test_error_is_the_logarithm_in_world_axes(some, angle):
    phi = angle * some[0] / np.linalg.norm(some[0])
    R_d = pin.exp3(some[1])
    R = pin.exp3(phi) @ R_d
    for sign in (1.0, -1.0):  # a quaternion and its negative are the same rotation
        assert np.allclose(rotation_between(sign * quaternion(R), quaternion(R_d)), phi, atol=1e-12)
    assert np.allclose(
        rotation_between(quaternion(R), quaternion(R_d)), pin.log3(R @ R_d.T), atol=1e-9
    )
    assert np.allclose(matrix(turned(quaternion(R_d), phi)), R, atol=1e-14)


@given(vectors, st.floats(0.0, 3.0))
@seeded
def test_drift_is_the_rate_of_the_error_less_the_difference_of_velocities(some, angle):
    phi = angle * some[0] / np.linalg.norm(some[0])
    omega, omega_d = some[2:]
    q_d = quaternion(pin.exp3(some[1]))
    q = turned(q_d, phi)
    rate = derivative(
        lambda t: np.array(rotation_between(turned(q, t * omega), turned(q_d, t * omega_d)))
    )
    drift = np.array(rotation_drift(phi, omega, omega_d))
    assert np.allclose(omega - omega_d + drift, rate, atol=1e-7)
    assert abs(phi @ drift) < 1e-14  # on which dV/dt rests


def test_rotation_vectors_are_accurate_up_to_half_a_turn():
    q_d = quaternion(pin.exp3(np.array([0.3, 0.2, -0.4])))
    for angle in (np.pi - 1e-9, np.pi):
        phi = np.array(rotation_between(turned(q_d, np.array([0.0, angle, 0.0])), q_d))
        assert np.isclose(np.linalg.norm(phi), angle, atol=1e-12)
    assert rotation_between(q_d, q_d).tolist() == [0.0, 0.0, 0.0]


# --- kinematics ---


@pytest.mark.parametrize(("name", "task"), [("ur5", "pose"), ("kinova", "pose"), ("panda", "xz")])
def test_identities_on_robots(name, task):
    robot = replace(catalogue_robot(name), task=TASKS[task])
    for unknown in unknown_choices(robot):
        check_kinematics(FrameKinematics(robot, unknown))


@each_size()
@given(robot=chains)
@seeded
def test_identities_on_random_chains(robot):
    robot = replace(robot, task=POSE)
    check_kinematics(FrameKinematics(robot, [*robot.joint_names[1:], "tool"]))


# --- the proofs ---


def loop(name, law):
    """Return truth, controller and a rotating reference that starts half a radian off."""
    robot = pose_robot(name)
    true = with_tool_and_load(robot)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.7),
        law=law,
        gamma_d=0.02 if law.endswith("improved") else 1.0,
        # what passes the filters is small in so short a run: with this weight it counts
        R_k=np.diag([30.0, 50.0, 80.0]) * (1.0 if law.endswith("velocity") else 1e5),
    )
    return (
        true,
        controller,
        swinging(true.position(true.q0), np.array([0.01, -0.01, 0.02, 0.3, -0.35, 0.2])),
    )


@pytest.mark.parametrize(("law", "name"), [*((law, "panda") for law in LAWS), (LAWS[0], "ur5")])
def test_equality_along_the_trajectory(law, name):
    true, controller, path = loop(name, law)
    energy = energy_along(true, controller, path, seconds=0.0015, dt=1e-4)
    energy.check(within=1e-6)
    # The curvature of rotations is there to be seen.
    assert (
        np.linalg.norm(energy.delta, axis=1).min() > 0.05
        and np.linalg.norm(energy.dx[-1, 3:]) > 0.2
    )
