"""Actuators that are declared: gains, rates and the check before a run follow from them."""

import warnings
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.laws.law import Feedback
from pinadapt.robot import Actuators
from pinadapt.tuning.defaults import elastic_mode, feedback_lag
from pinadapt.tuning.preflight import LinearisedJoints, preflight
from tests.support.chains import catalogue_robot, robot_of

DT = 1e-3


def made(robot, actuators=None, **options):
    return pa.make_controller(robot, limits=pa.Limits(actuators=actuators), **options)


@cache
def one_joint(**changes):
    """Return a robot of one joint."""
    robot = catalogue_robot("planar_2r")
    locked = pa.load("planar_2r", locked=[robot.joint_names[1]], frame=robot.frame, task="joint")
    return locked.changed(**changes)


@cache
def of_one_joint():
    """Return a controller of a robot of one joint."""
    return made(one_joint(), adaptation="natural")


def radius_of(controller, actuators, K_P, K_D, dt=DT):
    """Return the spectral radius that the check has for a joint's gains, without its margin."""
    motion = controller.motion
    W = motion.unit_masses
    W_T = motion.unit_masses.swapaxes(1, 2)
    feedback = Feedback(W @ K_P @ W_T / 2.0, W @ K_D @ W_T / 2.0, 0.0 * W, W)
    return LinearisedJoints(motion, actuators).feedback_radius(feedback, dt, 1.0)


@pytest.mark.parametrize("late", [1, 10])
@pytest.mark.parametrize(("p", "d"), [(400.0, 40.0), (9000.0, 150.0)])
def test_a_delay_of_whole_periods_is_that_of_a_shift_register(late, p, d):
    """A double integrator under K_P, K_D: the exact sampled loop keeps the torques on their way."""
    controller = of_one_joint()
    M = controller.motion.mass_matrices[0]
    A = np.zeros((2 + late, 2 + late))
    A[:2, :2] = [[1.0, DT], [0.0, 1.0]]
    A[:2, 2] = [0.5 * DT**2, DT]  # the oldest torque acts
    A[2:-1, 3:] = np.eye(late - 1)
    A[-1, :2] = [-p, -d]
    exact = np.abs(np.linalg.eigvals(A)).max()
    found = radius_of(controller, Actuators(delay=late * DT), p * M, d * M)
    assert found == pytest.approx(exact, abs=1e-3)


def test_a_bandwidth_and_a_spring_are_those_of_the_differential_equation():
    """Slow gains at a short period: eigenvalues of the continuous loop, written out by hand."""
    B, K, D, w, dt = 0.4, 800.0, 3.0, 60.0, 1e-5
    controller = made(one_joint(armature=B), unknown=pa.Unknown(armature=False))
    M = float(controller.motion.mass_matrices[0][0, 0]) - B
    p = 300.0
    d = 20.0
    slow = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / (M + B)], [-w * p, -w * d, -w]]
    elastic = [
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [-K / M, K / M, -D / M, D / M],
        [K / B, -(K + p) / B, D / B, -(D + d) / B],
    ]  # link and motor
    own = Actuators(stiffness=K, damping=D)
    one = np.eye(1)
    for actuators, A in ((Actuators(bandwidth=w), slow), (own, elastic)):
        growth = np.linalg.eigvals(np.array(A)).real.max()
        found = radius_of(controller, actuators, p * one, d * one, dt)
        assert np.log(found) / dt == pytest.approx(growth, rel=1e-2, abs=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "actuators"),  # ur5 below, under all laws
    [
        ("panda", Actuators(delay=2e-3)),
        ("scara", Actuators(bandwidth=50.0)),
        ("panda", Actuators(delay=4e-3, bandwidth=100.0)),
        ("kinova", Actuators(delay=2e-3, stiffness=2e4, encoders="motor")),
    ],
    ids=str,
)
def test_default_gains_for_declared_actuators_pass(name, actuators):
    robot = catalogue_robot(name)
    controller = made(robot, actuators)
    assert [str(finding) for finding in preflight(controller, DT)] == []
    assert controller.law.lag == pytest.approx(feedback_lag(robot, DT, actuators))
    assert actuators.words in repr(controller)


LATE, ELASTIC = Actuators(delay=5e-3, bandwidth=100.0), Actuators(stiffness=5e3)
LATE_LAWS = "adaptive-jacobian", "adaptive-inverse-dynamics", "slotine-li"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "actuators", "law"),
    [("planar_2r", ELASTIC, law) for law in pa.laws.LAWS]
    + [("ur5", LATE, law) for law in LATE_LAWS],
    ids=str,
)
def test_laws_have_gains_for_elastic_joints_and_late_motors(name, actuators, law):
    controller = made(robot_of(law, name), actuators, law=law)
    assert [str(finding) for finding in preflight(controller, DT)] == []


@pytest.mark.slow
def test_a_loop_lost_without_a_declaration_follows_with_it():
    robot = catalogue_robot("ur5")
    actuators = Actuators(delay=15e-3)
    path = pa.reachable_circle(robot)
    errors = []
    chatter = []
    for declared in (None, actuators):
        controller = made(
            robot.changed(inertial_scale=0.7), declared, adaptation="natural", dt=2e-3
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of motors that are not declared
            rollout = pa.simulate(
                robot,
                controller,
                path.starting_at(robot.position(robot.q0)),
                duration=1.2,
                engine=actuators,
            )
        assert rollout.diverged is None
        late = rollout.t > 0.9
        errors.append(rollout.distance[late].max())
        chatter.append(np.std(np.diff(rollout.tau[late], axis=0)))
    assert errors[1] < 0.2 * errors[0], errors
    assert chatter[1] < 0.2 * chatter[0], chatter


def test_the_elastic_mode_of_one_joint():
    robot = one_joint(armature=0.3)
    M = float(pin.crba(robot.model, robot.model.createData(), robot.q0)[0, 0]) - 0.3
    assert elastic_mode(robot, Actuators(stiffness=500.0)) == pytest.approx(np.sqrt(500.0 / M))
    assert elastic_mode(robot, Actuators(delay=1e-3)) == np.inf
    late = feedback_lag(robot, DT, Actuators(delay=2e-3, bandwidth=200.0))
    assert late == pytest.approx(2.0 * (1e-3 + 2e-3 + 5e-3))  # twice until the torque is there
    soft = feedback_lag(robot, DT, Actuators(stiffness=500.0))
    assert soft == pytest.approx(2e-3 + np.sqrt(M / 500.0))
