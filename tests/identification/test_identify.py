"""A robot and its load are identified from a recorded motion."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.identification.identification import log_and_robot
from pinadapt.identification.report import FILES
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot
from tests.support.recorded import LOAD, identified, motion, recorded, torques, true_robot

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("blank_pictures", "shortened"),
]


TOLD = {"friction": True, "armature": False}  # where the choice of effects is not the point


def test_errors_match_the_stated_uncertainty_and_held_out_torques_are_predicted_to_their_noise():
    found = identified("ur5")
    true = true_robot("ur5")
    load = found.payload()
    parts = found.controller
    assert load.mass == pytest.approx(LOAD.mass, rel=0.02)
    assert np.abs(load.com - LOAD.com).max() < 2e-3
    assert abs(load.mass - LOAD.mass) < 4.0 * load.mass_known_to
    assert (np.abs(load.com - LOAD.com) < 4.0 * load.com_known_to).all()
    for part, model in ((found.dynamic, parts.dynamics), (found.kinematic, parts.kinematics)):
        known = np.isfinite(part.deviations)
        off = np.abs(part.estimate - model.value(true))[known] / part.deviations[known]
        assert off.max() < 4.5 and np.sqrt(np.mean(off**2)) < 2.0
    assert np.linalg.norm(found.kinematic.estimate - parts.kinematics.value(true)) < 1e-4
    errors = found.torque_errors
    noise = np.sqrt(np.mean(found.windows.residual(parts.dynamics.value(true)) ** 2, axis=0))
    assert errors.gain > 10.0
    assert (errors.learned_held_out < 2.0 * noise).all()
    assert np.linalg.norm(found.online_held_out) < np.linalg.norm(errors.described_held_out)


def test_the_page_is_whole_and_loads_nothing():
    page = identified("ur5").page()
    assert page.startswith("<!DOCTYPE html>") and page.rstrip().endswith("</html>")
    assert not re.search("<(script|link|iframe)", page)
    (source,) = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert source.startswith("data:image/png;base64,")


def test_the_learned_robot_is_physical_and_predicts_another_motion(tmp_path):
    identified("ur5").robot.save(tmp_path / "learned.urdf")
    described = catalogue_robot("ur5")
    true = true_robot("ur5")
    learned = pa.load(tmp_path / "learned.urdf", frame=described.frame, joint_effects=True)
    _, q, v, a = (part[:500] for part in motion("ur5", duration=3.0, seed=5))
    wrong, left = (
        np.linalg.norm(torques(robot, q, v, a) - torques(true, q, v, a))
        for robot in (described, learned)
    )
    assert left < 0.1 * wrong
    assert np.allclose(learned.position(true.q0), true.position(true.q0), atol=1e-4)


def test_translations_are_identified_from_frames_alone():
    found = pa.identify(
        recorded("panda", duration=4.0),
        catalogue_robot("panda"),
        unknown=pa.Unknown(bodies="none", friction=False, armature=False),
    )
    true = found.controller.kinematics.value(true_robot("panda"))
    assert np.allclose(found.kinematic.estimate, true, atol=1e-6)
    assert found.summary()["torque"] is None


@pytest.mark.parametrize("name", ["kinova", "scara"])
def test_continuous_and_prismatic_joints_are_identified(name):
    found = pa.identify(recorded(name, duration=2.5), catalogue_robot(name))
    assert found.torque_errors.gain > 30.0


def test_samples_with_nan_are_left_out_and_counted():
    log = recorded("ur5", noisy=True, duration=4.0)
    q = log.q.copy()
    tau = log.tau.copy()
    q[150:155, 2], tau[400, :] = np.nan, np.inf
    tau[400, 1] = np.nan
    told = pa.Unknown(tool=True, **TOLD)
    found = pa.identify(replace(log, q=q, tau=tau), catalogue_robot("ur5"), unknown=told)
    assert found.summary()["left_out"] == 6
    assert all(np.isfinite(one.a).all() for one in found.online.values())
    assert np.isfinite(found.dynamic.estimate).all()
    assert found.payload().mass == pytest.approx(LOAD.mass, rel=0.02)


def test_torques_without_gravity_are_detected_and_compensated():
    robot = catalogue_robot("ur5")
    log = recorded("ur5", duration=4.0)
    gravity = pa.robot.Gravity(robot)
    left_out = replace(log, tau=log.tau - np.array([gravity(q) for q in log.q]))
    viscous = pa.Unknown(tool=False, bodies="none", friction="viscous", armature=False)
    with pytest.raises(pa.LogError, match=r"without gravity.*--compensated nominal") as refused:
        pa.identify(left_out, robot, unknown=viscous)
    assert "--compensated nominal" in refused.value.check.causes[0]
    plain = pa.identify(left_out, robot, unknown=viscous, import_options={"doubtful": True})
    assert not plain.trusted and plain.verdict.startswith("NOT TO BE TRUSTED")
    payload = pa.Unknown(tool=False, bodies="payload", **TOLD)
    whole = pa.identify(left_out, robot, unknown=payload, import_options={"compensated": "nominal"})
    assert whole.torque_errors.gain > 100.0 and whole.trusted
    by_options, _ = log_and_robot(left_out, robot, pa.logs.ImportOptions(compensated="nominal"))
    assert np.array_equal(by_options.tau, whole.log.tau)


def test_late_torques_are_found_under_noise():
    """Noise of the measured rates would hide the lateness."""
    robot = catalogue_robot("ur5")
    log = recorded("ur5", duration=5.0)
    noise = 0.2 * log.tau.std(axis=0) * np.random.default_rng(3).standard_normal(log.tau.shape)
    late = 6 * log.period
    tau = np.vstack([np.repeat(log.tau[:1], 6, axis=0), log.tau[:-6]])
    told = pa.Unknown(tool=True, **TOLD)
    healthy, found = (
        pa.identify(replace(log, tau=part + noise), robot, unknown=told) for part in (log.tau, tau)
    )
    assert found.late[0] == pytest.approx(late, rel=0.15)
    assert "ms later than the positions" in str(found)
    assert "ms later than the positions" not in str(healthy)


def test_a_stated_mass_is_that_of_what_the_motion_does_not_tell_apart():
    """The first link of a Panda turns about the vertical: its mass moves no torque."""
    robot = catalogue_robot("panda")
    log = recorded("panda", noisy=True, duration=4.0)
    told = pa.Unknown(tool=True, **TOLD)
    true = true_robot("panda")
    base = true.model.inertias[0].mass
    mass = 1.2 * true.mass + base
    found = pa.identify(log, robot, unknown=told, total_mass=mass)
    assert found.robot.mass + base == pytest.approx(mass, rel=1e-3)
    assert found.torque_errors.gain > 10.0
    with pytest.raises(pa.ParameterError, match="not more than"):
        pa.identify(log, robot, unknown=told, total_mass=0.5 * base)
    with pytest.raises(pa.InputError, match="total_mass"):
        pa.identify(log, robot, unknown=told, total_mass=-1.0)


def test_masses_stay_within_stated_bounds():
    robot = catalogue_robot("panda")
    log = recorded("panda", noisy=True, duration=4.0)
    told = pa.Unknown(tool=True, **TOLD)
    free = pa.identify(log, robot, unknown=told)
    masses = [body.mass for body in free.robot.model.inertias[1:]]
    limits = {"panda_joint3": (1.1 * masses[2], 9.0), "panda_joint5": (0.1, 0.9 * masses[4])}
    found = pa.identify(log, robot, unknown=told, mass_bounds=limits)
    bodies = found.robot.model.inertias
    assert bodies[3].mass == pytest.approx(1.1 * masses[2], rel=2e-3)
    assert bodies[5].mass == pytest.approx(0.9 * masses[4], rel=2e-3)
    ratio = found.torque_errors.learned_held_out.mean() / free.torque_errors.learned_held_out.mean()
    assert ratio < 1.2
    with pytest.raises(pa.InputError, match="Did you mean 'panda_joint3'"):
        pa.identify(log, robot, unknown=told, mass_bounds={"panda_joint33": (1.0, 2.0)})


def test_a_load_that_the_arm_cannot_carry_is_no_explanation():
    robot = catalogue_robot("ur5")
    log = recorded("ur5", duration=4.0, seen=False)
    heavy = 0.6 * robot.mass
    loaded = robot.changed(payload=pa.Payload(heavy, (0.0, 0.0, 0.1)))
    _, q, v, a = motion("ur5", duration=4.0)
    told = pa.Unknown(tool=False, **TOLD)
    log = replace(log, tau=torques(loaded, q, v, a))
    found = pa.identify(log, robot, unknown=told, import_options={"doubtful": True})
    assert "no load explains" in str(found) and found.summary()["payload"] is None


def test_the_log_of_another_robot_is_doubted():
    log = recorded("ur5", duration=4.0)
    other = catalogue_robot("ur5").changed(
        link_translation={"elbow_joint": [0.0, 0.15, 0.0], "wrist_1_joint": [0.1, 0.0, -0.1]}
    )
    found = pa.identify(log, other, unknown=pa.Unknown(tool=True, **TOLD))
    assert "mm off even as identified" in found.verdict and not found.trusted
    turned = replace(log, q=log.q[:, ::-1], v=log.v[:, ::-1], tau=log.tau[:, ::-1], x=None)
    with pytest.raises(pa.LogError, match="do not fit the description"):
        pa.identify(replace(turned, joints=()), catalogue_robot("ur5"))


def test_the_command_writes_its_files(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pinadapt.identification.report._TIMES", 20)
    robot = catalogue_robot("ur5")
    moved = recorded("ur5", duration=4.0)
    hung = pa.logs.ImportOptions(mount="ceiling").mounted(true_robot("ur5"))
    tau = torques(hung, *motion("ur5", duration=4.0)[1:])
    log = tmp_path / "log.npz"
    out = tmp_path / "out"
    np.savez(log, t=moved.t, q=moved.q, v=moved.v, tau=tau)
    known = ["--dynamic", "payload", "--joint", "all", "--mjcf", "--mount", "ceiling"]
    robot.save(tmp_path / "published.urdf", shapes=False)
    known += ["--compare", str(tmp_path / "published.urdf")]
    assert main(["identify", str(log), "--robot", "ur5", *known, "--out", str(out)]) == 0
    assert sorted(file.name for file in out.iterdir()) == sorted(FILES)
    page = (out / "report.html").read_text()
    _, described, published, *_ = re.findall(r">([\d.]+)<", page.split("all, rms")[1])
    assert described == published  # as both hang there
    printed = capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["verdict"] in printed and summary["torque"]["gain"] > 100.0
    assert summary["payload"]["mass"] == pytest.approx(LOAD.mass, rel=1e-2)
    learned = pa.LearnedParameters.load(out / "learned.json")
    controller = pa.make_controller(
        pa.load("ur5", task="joint"),
        law="slotine-li",
        unknown=pa.Unknown(bodies="payload", friction=True, armature=True),
    )
    learned.start(controller)
    pa.load(out / "learned.urdf")


def test_a_scenario_starts_from_what_a_log_identified(tmp_path):
    """Its joints have the effects of the file, and the loop is good from the first sample."""
    robot = catalogue_robot("ur5")
    sticky = pa.Friction(np.full(6, 0.5), np.full(6, 0.8), threshold=0.05)
    log = replace(
        recorded("ur5", duration=4.0),
        tau=torques(true_robot("ur5").changed(friction=sticky), *motion("ur5", duration=4.0)[1:]),
    )
    found = pa.identify(log, robot)
    found.save(tmp_path)
    learned = pa.LearnedParameters.load(tmp_path / "learned.json")
    assert learned == found.parameters()
    load = "mass = 1.5, com = [0.02, -0.01, 0.05], inertia = [0.01, 0.0, 0.012, 0.0, 0.0, 0.004]"
    scenario = tmp_path / "one.toml"
    scenario.write_text(
        f'[robot]\nsource = "ur5"\n[truth]\npayload = {{{load}}}\n'
        "tool_translation = [0.03, -0.02, 0.12]\nfriction = {viscous = 0.5, coulomb = 0.8}\n"
        '[trajectory]\nkind = "circle"\nradius = 0.08\nperiod = 3.0\n'
        "[simulation]\nduration = 0.5\n[controller]\ndt = 2e-3\n"
    )
    cold = Scenario.read(scenario)
    warm = Scenario.read(scenario, [f"model.learned={tmp_path / 'learned.json'}"])
    names = warm.controller.dynamics.names
    assert sorted(names) == sorted(learned.dynamic) != sorted(cold.controller.dynamics.names)
    friction = warm.controller.kinematics.robot.friction
    for part in ("threshold", "breakaway", "fading"):
        assert np.allclose(getattr(friction, part), getattr(found.robot.friction, part))
    assert warm.start["information"].shape[1] == len(names)
    said = [
        f"model.learned={tmp_path / 'learned.json'}",
        "unknown.friction=true",
        "unknown.armature=true",
    ]  # as `pinadapt init` writes
    assert Scenario.read(scenario, said).controller.dynamics.names == names
    errors = [scenario.run().distance.max() for scenario in (cold, warm)]
    assert errors[1] < 0.2 * errors[0]  # friction in a scenario is sharper than in this log
