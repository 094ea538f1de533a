"""Torques of a log are compared with the description, and usual mistakes are named."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from benchmarks import corrupted_logs
from pinadapt.description.chain import effort_limits
from pinadapt.identification.torque_check import check_torques, on_wall
from tests.support.chains import catalogue_robot
from tests.support.paths import ROOT
from tests.support.recorded import motion, torques

RATED = {"panda": 3.0, "kinova": 1.6, "scara": 0.0}  # [kg]


@cache
def panda():
    """Return a recorded motion of a real arm, and its description, which has a hand too many."""
    robot = catalogue_robot("panda")
    return pa.read_log(ROOT / "tests/data/panda_unisa.csv", robot), robot


def causes(log, robot):
    """Return the likely causes in one text."""
    check = check_torques(log, robot)
    assert check.fits != bool(check.causes)
    return check.verdict if check.causes else ""


def with_gravity(robot, gravity):
    """Return a robot in another gravity."""
    model = robot.model.copy()
    model.gravity.linear = np.array(gravity)
    return replace(robot, model=model)


def turned(log, order, parts=("q", "v", "tau")):
    """Return a log with some columns in another order."""
    return replace(log, **{part: getattr(log, part)[:, order] for part in parts})


def test_the_log_of_a_real_arm_fits_and_so_do_a_few_seconds_of_it():
    log, robot = panda()
    check = check_torques(log, robot)
    judged = [one for one in check.joints if one.judged]
    assert check.fits and len(judged) >= 4
    assert all(0.65 < one.factor < 2.0 and one.correlation > 0.79 for one in judged)
    for part in np.array_split(np.arange(len(log.t)), 4):
        assert not causes(corrupted_logs.rows(log, part), robot)


def test_turning_joints_in_another_order_are_refused():
    """Of joints without limits, whose configurations have two numbers."""
    robot = catalogue_robot("kinova")
    t, q, v, a = motion("kinova", dt=4e-2)
    log = pa.Log(t, q, torques(robot, q, v, a), v)
    assert not causes(log, robot)
    assert causes(turned(log, [1, 2, 0, 4, 5, 3]), robot)
    assert causes(turned(log, [5, 4, 3, 2, 1, 0]), robot)


def test_an_arm_on_a_wall_or_ceiling_is_recognised_and_mounted_there():
    robot = catalogue_robot("ur5")
    for gravity, place in (((9.81, 0.0, 0.0), "wall"), ((0.0, 0.0, 9.81), "ceiling")):
        hung = with_gravity(robot, gravity)
        log = turned_in(hung, "ur5")
        text = causes(log, robot)
        down = ",".join(f"{x:.3g}" for x in gravity)
        assert f"--gravity={down}" in text and not causes(log, hung)
        mounted = on_wall(log, robot)
        if place == "wall":
            assert np.allclose(mounted.model.gravity.linear, gravity)
            turned_joint = replace(log, tau=log.tau * [1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
            assert f"--flip {log.joints[1]}" in causes(turned_joint, on_wall(turned_joint, robot))
            amperes = replace(log, tau=0.1 * log.tau)
            assert "motor currents" in causes(amperes, on_wall(amperes, robot))
        else:
            assert f"--gravity={down}" in causes(log, mounted)


def turned_in(robot, name):
    """Return an exact log of a robot along the motion of a name."""
    t, q, v, a = motion(name, duration=6.0, dt=3e-2)
    return pa.Log(t, q, torques(robot, q, v, a), v, tuple(robot.joint_names))


def unlike(name, seed, wrist, gains):
    """Return a noisy log of a robot that is unlike its description, which is returned too.

    Masses and inertias are wrong by up to a third, the last body is so many times as heavy,
    friction is 2 to 10 % of the effort limits, the load is up to the rated one, the gains of the
    torques have a deviation, positions are those of encoders of 17 bits without velocities.
    """
    rng = np.random.default_rng(seed)
    robot = catalogue_robot(name)
    limits = effort_limits(robot.model)
    friction = rng.uniform(0.02, 0.1, robot.model.nv) * limits
    scale = {joint: float(rng.uniform(2 / 3, 4 / 3)) for joint in robot.joint_names}
    scale[robot.joint_names[-1]] *= wrist
    true = robot.changed(inertial_scale=scale, viscous=friction, coulomb=friction)
    mass = RATED[name] * rng.uniform(0.2, 1.0)
    inertia = (0.01 * mass, 0.0, 0.01 * mass, 0.0, 0.0, 0.01 * mass)
    true = true.changed(payload=pa.Payload(mass, rng.uniform(-0.1, 0.1, 3), inertia))
    t, q, v, a = motion(name, 10.0, 48e-3, seed)
    noise = 0.01 * limits * rng.standard_normal(q.shape)
    count = 2.0 * np.pi / 2**17
    tau = torques(true, q, v, a) * rng.normal(1.0, gains, robot.model.nv) + noise
    return pa.Log(t, np.round(q / count) * count, tau, None, tuple(robot.joint_names)), robot


@pytest.mark.slow
def test_an_angle_that_is_off_is_named_with_its_joint():
    log, robot = panda()
    off = np.radians(20.0) * (np.arange(7) == 3)
    text = causes(replace(log, q=log.q + off), robot)
    assert "--offset panda_joint4=-0.3" in text or "=-0.4" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "wrist", "gains"),
    [
        ("panda", 1, 1.0, 0.0),
        ("kinova", 1, 1.0, 0.0),
        ("scara", 0, 1.0, 0.0),
        ("panda", 4, 3.5, 0.05),
    ],
)
def test_wrong_inertias_friction_noise_and_loads_are_accepted(name, seed, wrist, gains):
    """And a gripper on the wrist, where the load on the last body is not the only error."""
    check = check_torques(*unlike(name, seed, wrist, gains))
    assert check.fits, check


SAID = {  # and what corrects them
    "degrees": "--degrees",
    "torques without gravity": "--compensated nominal",
    "amperes": "--torque-gain=11.9",
    "amperes of unlike motors": "motor currents (A)",
    "torques before the gear": "before the gear",
    "all signs of the torque": "--torque-gain=-1",
    "sign of the position, panda_joint2": "--flip q:panda_joint2",
    "panda_joint2 and panda_joint3 swapped": "--joints panda_joint1,panda_joint3,panda_joint2",
    "torques of panda_joint2 and panda_joint3 swapped": "--joints tau:panda_joint1,panda_joint3",
    "described upside down": "--gravity=0,0,-9.81",
    "described tilted by 45 degrees": "",
    "joints from the last to the first": "",
    "samples repeated at new times": "--repeated",
    "samples twice": "--repeated",
    "a torque not recorded": "panda_joint2 is zero",
    "a joint missing": "6 columns",
    "another robot, xarm7": "",
}


@pytest.mark.slow
def test_no_mistake_of_the_benchmark_is_accepted():
    """One of each kind, in a log of 8 samples a second."""
    log, robot = panda()
    log = corrupted_logs.rows(log, np.arange(0, len(log.t), 4))
    mistakes = dict(corrupted_logs.mistakes(log, robot, catalogue_robot("xarm7")))
    for what, said in SAID.items():
        accepted, words = corrupted_logs.checked(*mistakes[what])
        assert not accepted and said in words, (what, words)
    assert corrupted_logs.checked(log, robot)[0]
