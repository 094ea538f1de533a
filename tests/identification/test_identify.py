"""A robot and its load are identified from a recorded motion."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.calibration import measured, random_angles, wrong_arm
from pinadapt.cli.command_line import main
from pinadapt.identification.identification import log_and_robot, log_of
from pinadapt.identification.report import FILES
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot
from tests.support.paths import ROOT
from tests.support.recorded import LOAD, identified, motion, recorded, torques, true_robot

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]


TOLD = {"friction": True, "armature": False}  # where the choice of effects is not the point


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_errors_of_load_tool_and_friction_match_the_stated_uncertainty(name):
    found, true = identified(name), true_robot(name)
    load = found.payload()
    assert load.mass == pytest.approx(LOAD.mass, rel=0.02)
    assert np.abs(load.com - LOAD.com).max() < 2e-3
    assert abs(load.mass - LOAD.mass) < 4.0 * load.mass_known_to
    assert (np.abs(load.com - LOAD.com) < 4.0 * load.com_known_to).all()
    parts = found.estimator.controller
    for part, model in ((found.dynamic, parts.dynamics), (found.kinematic, parts.kinematics)):
        known = np.isfinite(part.deviations)
        off = np.abs(part.estimate - model.value(true))[known] / part.deviations[known]
        assert off.max() < 4.5 and np.sqrt(np.mean(off**2)) < 2.0
    assert np.linalg.norm(found.kinematic.estimate - parts.kinematics.value(true)) < 1e-4


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_held_out_torques_are_predicted_to_their_noise(name):
    found = identified(name)
    errors, true = found.torque_errors, found.estimator.controller.dynamics.value(true_robot(name))
    noise = np.sqrt(np.mean(found.windows.residual(true) ** 2, axis=0))
    assert errors.gain > 10.0
    assert (errors.learned_held_out < 2.0 * noise).all()
    assert np.linalg.norm(found.online_held_out) < np.linalg.norm(errors.described_held_out)
    assert "times less." in found.verdict


def test_the_learned_robot_is_physical_and_predicts_another_motion(tmp_path):
    identified("ur5").robot.save(tmp_path / "learned.urdf")
    described, true = catalogue_robot("ur5"), true_robot("ur5")
    learned = pa.load(tmp_path / "learned.urdf", frame=described.frame, joint_effects=True)
    _, q, v, a = (part[:500] for part in motion("ur5", duration=3.0, seed=5))
    wrong, left = (
        np.linalg.norm(torques(robot, q, v, a) - torques(true, q, v, a))
        for robot in (described, learned)
    )
    assert left < 0.1 * wrong
    assert np.allclose(learned.position(true.q0), true.position(true.q0), atol=1e-4)


def test_a_rollout_is_a_log(tmp_path):
    robot, true = catalogue_robot("ur5"), true_robot("ur5")
    path = pa.trajectories.Lissajous(robot.position(robot.q0), [0.12, 0.15, 0.12], [3, 4, 5], 6.0)
    controller = pa.make_controller(robot, adaptation="natural", dt=4e-3)
    rollout = pa.simulate(true, controller, path, duration=4.5)
    rollout.save(tmp_path)
    found = pa.identify(tmp_path, robot, unknown=pa.Unknown(bodies="payload", **TOLD))
    assert found.torque_errors.gain > 10.0
    load = found.payload()
    assert load.mass == pytest.approx(LOAD.mass, rel=1e-3)
    assert np.abs(load.com - LOAD.com).max() < 2e-4
    mine = log_of(rollout, robot)  # by its sensors, which were exact
    assert all(np.allclose(getattr(mine, part), getattr(found.log, part)) for part in ("q", "tau"))
    assert np.allclose(mine.x, found.log.x) and mine.held


def test_velocities_are_not_needed(name="ur5"):
    log = replace(recorded(name, noisy=True, duration=4.0), v=None)
    found = pa.identify(log, catalogue_robot(name), unknown=pa.Unknown(tool=True, **TOLD))
    load = found.payload()
    assert found.smoothed and found.torque_errors.gain > 10.0
    assert load.mass == pytest.approx(LOAD.mass, rel=0.02)
    assert np.linalg.norm(found.online_held_out) < np.linalg.norm(
        found.torque_errors.described_held_out
    )
    moved = found.online.a_k[-1] - found.kinematic.estimate  # frames as late as joint data
    assert np.linalg.norm(moved) < 2e-3
    assert "causal" in found.report()


def test_a_short_log_leaves_friction_undetermined_and_is_identified_nevertheless():
    """A joint that hardly turns around has no columns of its own for the shapes of friction."""
    found = pa.identify(recorded("ur5", seen=False, duration=2.0), catalogue_robot("ur5"))
    assert found.torque_errors.gain > 10.0


def test_translations_are_identified_from_frames_alone():
    found = pa.identify(
        recorded("panda", duration=4.0),
        catalogue_robot("panda"),
        unknown=pa.Unknown(bodies="none", friction=False, armature=False),
    )
    true = found.estimator.controller.kinematics.value(true_robot("panda"))
    assert np.allclose(found.kinematic.estimate, true, atol=1e-6)
    assert "error of held-out positions" in found.verdict and found.summary()["torque"] is None


def test_positions_in_other_units_are_refused():
    log = recorded("ur5", duration=1.5)
    with pytest.raises(pa.LogError, match="In millimetres"):
        pa.identify(replace(log, x=1e3 * log.x), catalogue_robot("ur5"))


def test_inertias_are_identified_at_the_identified_lengths():
    described, true = catalogue_robot("ur5"), true_robot("ur5")
    wrong = described.changed(link_translation={"elbow_joint": (0.0, 0.0, 0.02)})
    found = pa.identify(
        recorded("ur5", duration=4.0),
        wrong,
        unknown=pa.Unknown(tool=True, translations=["elbow_joint"], **TOLD),
    )
    at = described.q0
    assert np.allclose(found.robot.position(at), true.position(at), atol=1e-4)
    assert found.torque_errors.gain > 100.0


@pytest.mark.parametrize("name", ["kinova", "scara"])
def test_continuous_and_prismatic_joints_are_identified(name):
    found = pa.identify(recorded(name, duration=3.0), catalogue_robot(name))
    assert found.torque_errors.gain > 30.0 and "WORSE" not in found.verdict


def test_samples_with_nan_are_left_out_and_counted():
    log = recorded("ur5", noisy=True, duration=4.0)
    q, tau = log.q.copy(), log.tau.copy()
    q[150:155, 2], tau[400, :] = np.nan, np.inf
    tau[400, 1] = np.nan
    told = pa.Unknown(tool=True, **TOLD)
    found = pa.identify(replace(log, q=q, tau=tau), catalogue_robot("ur5"), unknown=told)
    assert found.online.refused == 6 and "refused online" in found.report()
    assert np.isfinite(found.online.a_d).all() and np.isfinite(found.dynamic.estimate).all()
    assert found.payload().mass == pytest.approx(LOAD.mass, rel=0.02)


def test_signals_that_are_never_finite_together_are_refused():
    log = recorded("ur5", duration=1.5)
    log = log.after(log.t[len(log.t) % 2])  # an even number of samples
    q, tau = log.q.copy(), log.tau.copy()
    q[::2], tau[1::2] = np.nan, np.nan
    with pytest.raises(pa.LogError, match="fewer than two samples"):
        pa.identify(replace(log, q=q, tau=tau), catalogue_robot("ur5"))


def test_torques_without_gravity_are_detected_and_compensated():
    robot, log = catalogue_robot("ur5"), recorded("ur5", duration=4.0)
    gravity = pa.robot.Gravity(robot)
    left_out = replace(log, tau=log.tau - np.array([gravity(q) for q in log.q]))
    viscous = pa.Unknown(tool=False, bodies="none", friction="viscous", armature=False)
    with pytest.raises(pa.LogError, match=r"without gravity.*--compensated nominal") as refused:
        pa.identify(left_out, robot, unknown=viscous)
    assert refused.value.check.causes[0].option == "--compensated nominal"
    plain = pa.identify(left_out, robot, unknown=viscous, intake={"doubtful": True})
    assert not plain.trusted and plain.verdict.startswith("NOT TO BE TRUSTED")
    payload = pa.Unknown(tool=False, bodies="payload", **TOLD)
    whole = pa.identify(left_out, robot, unknown=payload, compensated="nominal")
    assert whole.torque_errors.gain > 100.0 and whole.trusted
    by_intake, _ = log_and_robot(left_out, robot, pa.logs.Intake(compensated="nominal"), None)
    assert np.array_equal(by_intake.tau, whole.log.tau)


def test_a_correct_description_is_reported():
    log, true = recorded("ur5", duration=4.0), true_robot("ur5")
    found = pa.identify(
        log, true, unknown=pa.Unknown(tool=False, bodies="payload", friction=False, armature=False)
    )
    assert "already correct" in found.verdict and "WORSE" not in found.verdict


def test_the_log_of_another_robot_is_doubted():
    log = recorded("ur5", duration=4.0)
    other = catalogue_robot("ur5").changed(
        link_translation={"elbow_joint": [0.0, 0.3, 0.0], "wrist_1_joint": [0.2, 0.0, -0.2]}
    )
    found = pa.identify(log, other, unknown=pa.Unknown(tool=True, **TOLD))
    assert "Is this the log of another robot" in found.verdict
    assert "mm off even as identified" in found.verdict and not found.trusted
    turned = replace(log, q=log.q[:, ::-1], v=log.v[:, ::-1], tau=log.tau[:, ::-1], x=None)
    with pytest.raises(
        pa.LogError, match=r"the joints are in another order; --joints wrist_3_joint"
    ):
        pa.identify(replace(turned, joints=()), catalogue_robot("ur5"))
    assert "another robot" not in identified("ur5").verdict


def test_a_joint_that_does_not_move_is_not_identifiable_and_stays_as_described():
    """The others are identified, without positions of the frame."""
    log, robot = recorded("ur5", seen=False, duration=4.0), catalogue_robot("ur5")
    _, q, v, a = motion("ur5", duration=4.0)
    still = np.arange(6) == 5
    q, v, a = (np.where(still, part[:1] if part is q else 0.0, part) for part in (q, v, a))
    tau = torques(true_robot("ur5"), q, v, a)
    found = pa.identify(
        replace(log, q=q, v=v, tau=tau), robot, unknown=pa.Unknown(tool=False, **TOLD)
    )
    assert found.torque_errors.gain > 100.0 and not found.kinematic.names
    assert found.robot.task == found.described.task
    names = list(found.dynamic.names)
    friction = names.index("wrist_3_joint.coulomb")
    assert np.isinf(found.dynamic.deviations[friction])
    start = found.estimator.controller.dynamics.initial[friction]
    assert found.dynamic.estimate[friction] == pytest.approx(start, rel=1e-3)
    assert "only combinations of them are identifiable" in found.report()
    with pytest.raises(pa.ParameterError, match="no positions of the task frame"):
        pa.identify(log, robot, unknown=pa.Unknown(tool=True))


def test_the_report_lists_estimates_and_errors():
    text = identified("panda").report()
    for words in (
        "identifiable combinations of",
        "regularisation",
        "effect of the joints, beside viscous and Coulomb friction",
        "held out: described",
        "panda_joint7",
        "mass",
        "tool_z",
        "panda_joint1.coulomb",
        "velocities    ",
        "from the positions",
    ):
        assert words in text, words
    assert str(identified("panda")) == text and "<table>" in identified("panda")._repr_html_()


def as_csv(path, log, robot):
    """Write a log as a CSV file."""
    columns = {"time": log.t}
    for signal in ("q", "v", "tau"):
        for j, name in enumerate(robot.joint_names):
            columns[f"{signal}_{name}"] = getattr(log, signal)[:, j]
    np.savetxt(
        path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns),
        comments="",
    )  # fmt: skip
    return path


class Arm:
    """A robot that another controller drives."""

    def __init__(self, log):
        """Take its measurements."""
        self.rows = [
            pa.Measurement(t, q, v, tau=tau)
            for t, q, v, tau in zip(log.t.tolist(), log.q, log.v, log.tau, strict=True)
        ]

    def enabled(self):
        """Return whether there is another sample."""
        return bool(self.rows)

    def read(self):
        """Return the next sample."""
        return self.rows.pop(0)


def test_the_code_of_the_page_runs(tmp_path, monkeypatch):
    page = ROOT / "docs" / "identify.md"
    whole, geometry, loop, online = re.findall(r"```python\n(.*?)```", page.read_text(), re.S)
    robot, log = catalogue_robot("ur5"), recorded("ur5", duration=3.0)
    robot.save(tmp_path / "my_robot.urdf", shapes=False)
    as_csv(tmp_path / "log.csv", log, robot)
    monkeypatch.chdir(tmp_path)
    scope = {"pa": pa, "arm": Arm(log)}
    exec(whole, scope)
    assert pa.load("learned.urdf").model.nv == 6
    assert (tmp_path / "identified" / "summary.json").is_file()
    real, rng = wrong_arm(robot, np.random.default_rng(0)), np.random.default_rng(1)
    poses = measured(real, random_angles(robot, rng, 60), rng)
    header = ",".join([*(f"q_{name}" for name in robot.joint_names), *"xyz"])
    rows = np.hstack([poses.q, poses.x])
    np.savetxt("poses.csv", rows, "%.9g", ",", header=header, comments="")
    exec(geometry, own := {"pa": pa})
    place = own["found"].robot.position(real.q0)
    assert pa.load("learned.urdf").position(real.q0) == pytest.approx(place, abs=1e-12)
    exec(online, scope)
    assert len(scope["numbers"].dynamic) == 78
    true = pa.load("my_robot.urdf")
    start = pa.Measurement(0.0, true.q0, np.zeros(6), true.position(true.q0))
    scope |= {"true": true, "path": pa.reachable_circle(true), "measurement": start}
    exec(loop, scope)
    assert (scope["state"].a_d == scope["found"].dynamic.estimate).all()
    assert scope["rollout"].diverged is None


def test_the_command_writes_its_files(tmp_path, capsys):
    robot = catalogue_robot("ur5")
    log = as_csv(tmp_path / "log.csv", recorded("ur5", duration=4.0), robot)
    out = tmp_path / "out"
    known = ["--dynamic", "payload", "--joint", "all", "--mjcf"]
    robot.save(tmp_path / "published.urdf", shapes=False)
    known += ["--compare", str(tmp_path / "published.urdf")]
    assert main(["identify", str(log), "--robot", "ur5", *known, "--out", str(out)]) == 0
    assert sorted(file.name for file in out.iterdir()) == sorted(FILES)
    page = (out / "report.html").read_text()
    assert "pinadapt excite ur5 --frame tool0" in page and ">published.urdf<" in page
    printed, summary = capsys.readouterr().out, json.loads((out / "summary.json").read_text())
    assert summary["verdict"] in printed and summary["torque"]["gain"] > 100.0
    assert summary["payload"]["mass"] == pytest.approx(LOAD.mass, rel=1e-2)
    learned = pa.LearnedParameters.load(out / "learned.json")
    controller = pa.make_controller(
        pa.load("ur5", task="joint"),
        law="slotine-li",
        unknown=pa.Unknown(bodies="payload", friction=True, armature=True),
    )
    learned.start(controller)
    assert np.load(out / "estimates.npz")["a_d"].shape[1] == len(summary["dynamic"])
    pa.load(out / "learned.urdf")


def test_a_file_that_cannot_be_written_is_reported_in_last_line_and_status(
    tmp_path, capsys, monkeypatch
):
    out = tmp_path / "out"

    def refuse(self, **_):
        raise pa.RobotError("no distribution of mass has it.", where="urdf")

    monkeypatch.setattr(pa.Robot, "urdf", refuse)
    monkeypatch.setattr("pinadapt.cli.identify.identify_log", lambda *_, **__: identified("ur5"))
    assert main(["identify", "log.csv", "--robot", "ur5", "--mjcf", "--out", str(out)]) == 4
    last = capsys.readouterr().out.strip().splitlines()[-1]
    assert last.startswith("INCOMPLETE: not written: learned.urdf") and "distribution" in last
    assert {file.name for file in out.iterdir()} == set(FILES) - {"learned.urdf"}


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
        '[reference]\nkind = "circle"\nradius = 0.08\nperiod = 3.0\n'
        "[simulation]\nduration = 0.5\ndt = 2e-3\n"
    )
    cold = Scenario.read(scenario)
    warm = Scenario.read(scenario, ["belief.learned=learned.json"])
    names = warm.controller.dynamics.names
    assert sorted(names) == sorted(learned.dynamic) != sorted(cold.controller.dynamics.names)
    friction = warm.controller.kinematics.robot.friction
    for part in ("threshold", "breakaway", "fading"):
        assert np.allclose(getattr(friction, part), getattr(found.robot.friction, part))
    assert warm.start["information"].shape[1] == len(names)
    said = ["belief.learned=learned.json", "unknown.joint=all"]  # as `pinadapt init` writes
    assert Scenario.read(scenario, said).controller.dynamics.names == names
    errors = [scenario.run().distance.max() for scenario in (cold, warm)]
    assert errors[1] < 0.2 * errors[0]  # friction in a scenario is sharper than in this log


def test_the_command_takes_the_robot_of_a_scenario(tmp_path, capsys):
    scenario = tmp_path / "ours.toml"
    assert main(["init", "ur5", "--out", str(scenario)]) == 0
    settings = ["simulation.duration=1.5", "simulation.dt=0.004", "unknown.dynamic=payload"]
    run, out = tmp_path / "run", tmp_path / "out"
    assert main(["run", str(scenario), "--no-html", "--out", str(run), "--set", *settings]) == 0
    assert main(["identify", str(run), "--robot", str(scenario), "--out", str(out)]) == 0
    assert "times less" in capsys.readouterr().out
    assert main(["identify", str(run), "--robot", str(scenario), "--out", str(run)]) == 2
    assert "--out takes another place" in capsys.readouterr().err
    assert (run / "rollout.npz").is_file()


def test_the_command_refuses_before_it_writes(tmp_path, capsys):
    log = as_csv(tmp_path / "log.csv", recorded("ur5", duration=1.5), catalogue_robot("ur5"))
    out = tmp_path / "out"
    for arguments, words in (
        ([str(log), "--robot", "panda"], "no joint positions found"),
        ([str(tmp_path / "none.csv"), "--robot", "ur5"], "no such file"),
        ([str(log), "--robot", "ur5", "--columns", "tau=effort_*"], "no column"),
        ([str(log), "--robot", "ur5", "--kinematic", "tool"], "no positions of the task frame"),
        ([str(log), "--robot", "ur55"], "Did you mean 'ur5'"),
        (
            [str(log), "--robot", "ur5", "--dynamic", "none", "--joint", "none"],
            "nothing is unknown",
        ),
    ):
        assert main(["identify", *arguments, "--out", str(out)]) == 2
        assert words in capsys.readouterr().err
        assert not out.exists()
