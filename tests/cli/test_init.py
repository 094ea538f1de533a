"""``pinadapt init``: its scenario runs without changes and reports the choices."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from pinadapt._output import read_toml
from pinadapt.cli.command_line import main
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ARM4

pytestmark = pytest.mark.slow


def written(folder, source, *options):
    """Write a scenario and return its file."""
    file = folder / "scenario.toml"
    assert main(["init", str(source), "--out", str(file), *options]) == 0
    return file


def followed(file, *settings):
    """Return a run of a scenario, and one without adaptation."""
    return (
        Scenario.read(file, [*settings, *more]).run()
        for more in ([], ["controller.adaptation='none'"])
    )


# where the period is not the point
TWO_MS, FOUR_MS = "controller.dt=2e-3", "controller.dt=4e-3"


def test_the_written_file_runs_and_the_controller_learns(tmp_path):
    file = written(tmp_path, "solo8_fl_leg")
    tables = read_toml(file)
    assert (tables["robot"]["frame"], tables["robot"]["task"]) == ("FL_FOOT", "xz")
    tool = np.linalg.norm(tables["truth"]["tool_translation"])
    assert np.isclose(tool, 0.05 * Scenario.read(file).estimated.reach, rtol=0.01)
    rollout, fixed = followed(file, "simulation.duration=1.6", FOUR_MS)
    assert rollout.diverged is None
    late = rollout.t > 1.3
    last = rollout.distance[late].max()
    assert last < 0.06 * tables["trajectory"]["radius"]
    assert last < 0.4 * fixed.distance[late].max()


ONE_JOINT = """<robot name="one"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ur55"], "Did you mean 'ur5'?"),
        (["solo8_fl_leg", "--task", "xyz"], "only 2 joints"),
        (["one.urdf"], "no outermost link is moved by two joints"),
    ],
)
def test_refusals_are_status_2_and_write_nothing(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("one.urdf").write_text(ONE_JOINT)
    assert main(["init", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error and "Traceback" not in error
    assert not list(tmp_path.glob("*.toml"))


def test_a_description_of_several_legs_offers_the_whole_robot_first(tmp_path, capsys):
    file = written(tmp_path, "solo12")
    first, *commands, found, _, left = capsys.readouterr().out.splitlines()[:6]
    assert first == "An arm or leg of 4. For the whole robot:" and "3 joints" in found
    for command, n in zip(commands, (12, 18), strict=True):
        assert main(shlex.split(command)[1:]) == 0
        assert f"{file}: {n} joints, " in capsys.readouterr().out.splitlines()[0]
    assert commands[1].split()[3:5] == ["--contacts", "FL_FOOT,FR_FOOT,HL_FOOT,HR_FOOT"]
    assert left.startswith("Not controlled: FR_HAA")
    written(tmp_path, ARM4, "--force")
    assert "whole" not in capsys.readouterr().out


def test_a_standing_robot_carries_an_unknown_load_on_a_circle(tmp_path, capsys):
    file = written(tmp_path, "a1", "--contacts", "FL_foot,FR_foot", "--contacts", "RL_foot,RR_foot")
    rollout, fixed = followed(file, "simulation.duration=1.2", FOUR_MS)
    assert rollout.diverged is None
    assert rollout.x[:, 0].max() - rollout.x[0, 0] > 0.05
    assert rollout.distance[-250:].max() < 0.1 * fixed.distance[-250:].max()
    assert main(["init", "a1", "--out", str(file), "--contacts", "FL_foot,RR_foot", "--force"]) == 2
    assert "three point feet" in capsys.readouterr().err


def test_a_joint_task_gets_sines_of_the_joints_for_any_law_of_joint_space(tmp_path):
    file = written(tmp_path, ARM4, "--task", "joint", "--frame", "tip")
    tables = read_toml(file)
    assert tables["robot"]["task"] == "joint"
    assert tables["trajectory"]["kind"] == "sinusoid" and "tool_translation" not in tables["truth"]
    rollout, fixed = followed(file, "simulation.duration=1.6", TWO_MS, "controller.law=craig")
    assert rollout.diverged is None and not rollout.limits.exceeded
    assert rollout.distance[-250:].max() < 0.4 * fixed.distance[-250:].max()
