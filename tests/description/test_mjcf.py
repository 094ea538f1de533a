"""MJCF files are read with Pinocchio; what it would ignore is refused."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.scenario.scenario import Scenario
from tests.support.descriptions import MJCF, TRIANGLE
from tests.support.loops import check_holds_home

FREE = MJCF.replace('pos="0 0 0.1">', 'pos="0 0 0.1"><freejoint/>').replace(
    'qpos="0', 'qpos="0 0 0 1 0 0 0 0'
)


def mjcf(folder, text=MJCF):
    """Write an MJCF file, one of its two meshes, and return its path."""
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes" / "rib.stl").write_text(TRIANGLE)
    path = folder / "arm.xml"
    path.write_text(text)
    return path


def test_a_chain_is_read_with_its_masses_limits_home_and_gravity(tmp_path):
    path = mjcf(tmp_path)
    whole = pin.buildModelFromMJCF(str(path))
    robot = pa.load(path, frame="tip")
    for ours, theirs in zip(robot.model.inertias[1:], whole.inertias[1:], strict=True):
        assert ours.isApprox(theirs)
    assert robot.joint_names == ["j1", "j2", "j3"]
    capsule = 1000 * (np.pi * 0.05**2 * 0.3 + 4 / 3 * np.pi * 0.05**3)
    masses = [body.mass for body in robot.model.inertias[1:3]]
    assert np.allclose(masses, [capsule, 2.0])
    assert np.allclose(robot.q0, [0.1, -0.5, 0.9])
    assert np.allclose(robot.model.gravity.linear, [0.0, 0.0, -1.62])
    assert np.allclose(robot.model.upperPositionLimit, [3.0, 2.0, 2.0])
    assert robot.model.armature[0] == 0.1 and robot.model.effortLimit[0] == 7.0
    check_holds_home(robot)


@pytest.mark.slow
def test_init_writes_a_scenario_of_it_that_runs(tmp_path):
    file = tmp_path / "arm.toml"
    assert main(["init", str(mjcf(tmp_path, FREE)), "--frame", "tip", "--out", str(file)]) == 0
    settings = ["simulation.duration=3.0", "controller.dt=4e-3", "trajectory.as_given=true"]
    rollout = Scenario.read(file, settings).run()
    assert rollout.distance[-100:].max() < 0.1 * rollout.distance[:100].max()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<asset>", '<include file="x.xml"/><asset>', "Pinocchio does not read <include>"),
        ('<body name="tip"', "<body", "a <body> has no name"),
        ('mass="2" diag', 'mass="1,5" diag', 'mass="1,5" is not some finite numbers'),
        (
            '<inertial pos="0.2 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>',
            "",
            "body 'link2' has no <inertial>",
        ),
        ('mass="2" diag', 'mass="-2" diag', "<inertial> has a negative mass, -2 kg"),
        ('type="box"', 'type="brick"', "Pinocchio cannot read this MJCF"),
    ],
)
def test_elements_that_pinocchio_would_ignore_are_refused(tmp_path, old, new, words):
    assert old in MJCF
    path = mjcf(tmp_path, MJCF.replace(old, new))
    with pytest.raises(pa.RobotError) as error:
        pa.load(path, frame="tip")
    assert words in str(error.value) and str(path) in str(error.value)


def test_a_body_that_no_joint_moves_needs_no_inertia(tmp_path):
    base = '<worldbody><body name="stand"><geom type="mesh" mesh="rib"/>'
    text = MJCF.replace("<worldbody>", base).replace("</worldbody>", "</body></worldbody>")
    assert pa.load(mjcf(tmp_path, text), frame="tip").joint_names == ["j1", "j2", "j3"]


def test_bodies_beside_the_first_are_told(tmp_path):
    path = mjcf(tmp_path, MJCF.replace("</worldbody>", '<body name="cube"/></worldbody>'))
    with pytest.warns(UserWarning, match="the first body of <worldbody> alone, without 'cube'"):
        pa.load(path, frame="tip")
