"""``pinadapt init``: its scenario runs without changes and reports the choices."""

from pathlib import Path

import numpy as np
import pytest

import pinadapt as pa
from pinadapt._output import read_toml
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import example_path
from pinadapt.description.urdf import Urdf
from pinadapt.robot.loading import end_links
from pinadapt.scenario.scenario import Scenario
from pinadapt.scenario.template import three_digits
from tests.support.paths import ARM4

pytestmark = pytest.mark.slow


def written(folder, source, *options):
    """Write a scenario and return its file."""
    file = folder / "scenario.toml"
    assert main(["init", str(source), "--out", str(file), *options]) == 0
    return file


# where the period is not the point
TWO_MS, FOUR_MS = "simulation.dt=2e-3", "simulation.dt=4e-3"


@pytest.mark.parametrize(
    ("source", "frame", "task"),
    [
        (ARM4, "tip", "xyz"),
        ("solo8_fl_leg", "FL_FOOT", "xz"),
        ("allegro_left_thumb", "link_15.0_tip", "xyz"),
        (example_path("double_pendulum_simple"), "link3", "yz"),
    ],
    ids=lambda value: Path(value).stem if isinstance(value, Path) else None,
)
def test_the_written_file_runs_and_the_controller_learns(tmp_path, source, frame, task):
    file = written(tmp_path, source)
    tables = read_toml(file)
    assert (tables["robot"]["frame"], tables["robot"]["task"]) == (frame, task)
    settings = ["simulation.duration=1.6", FOUR_MS]
    scenario = Scenario.read(file, settings)
    tool = np.linalg.norm(tables["truth"]["tool_translation"])
    assert np.isclose(tool, 0.05 * scenario.estimated.reach, rtol=0.01)
    rollout, fixed = (
        scenario.run(),
        Scenario.read(file, [*settings, "controller.adaptation='none'"]).run(),
    )
    assert rollout.diverged is None
    late = rollout.t > 1.3
    last = rollout.distance[late].max()
    assert last < 0.06 * tables["reference"]["radius"]
    assert last < 0.4 * fixed.distance[late].max()


@pytest.mark.parametrize("source", [ARM4, "solo8_fl_leg", "centauro_rr_leg"])
def test_the_unknown_tool_moves_the_task_by_all_its_length(tmp_path, source):
    scenario = Scenario.read(written(tmp_path, source))
    robot, true = scenario.estimated, scenario.true
    assert np.isclose(
        np.linalg.norm(true.position(robot.q0) - robot.position(robot.q0)),
        0.05 * robot.reach,
        rtol=0.02,
    )


def test_q0_and_the_circle_are_those_of_the_library(tmp_path):
    file = written(tmp_path, "ur5")
    tables, robot = read_toml(file), pa.load("ur5")
    assert np.allclose(tables["robot"]["q0"], robot.home_angles, atol=1e-4)
    circle = pa.reachable_circle(robot.at(tables["robot"]["q0"]))
    reference = tables["reference"]
    assert (reference["radius"], reference["period"], reference["plane"]) == (
        circle.radius,
        circle.period,
        circle.plane,
    )
    assert np.isclose(reference["phase"], circle.phase, atol=2e-5)


def test_the_gains_in_the_comments_are_the_ones_in_use(tmp_path):
    """A lag and rates of the user's own take the place of those that change after the start."""
    file = written(tmp_path, "solo8_fl_leg")
    text = file.read_text()
    uncommented = text
    for key in ("alpha", "beta", "gamma_k", "R_k"):
        assert f"\n# {key} = " in text
        uncommented = uncommented.replace(f"\n# {key} = ", f"\n{key} = ")
    other = tmp_path / "uncommented.toml"
    other.write_text(uncommented)
    short = ["simulation.duration=0.2"]
    scenario = Scenario.read(file, short)
    assert np.allclose(scenario.run().x, Scenario.read(other, short).run().x, atol=2e-5)
    law, bodies = scenario.controller.law, scenario.controller.adaptation_d.inner.parts[0][0]
    assert f"\n# gamma_d = {three_digits(bodies.gamma)} " in text
    gains = ", ".join(f"{gain:.3g}" for gain in np.diag(law.K_v))
    assert f"\n# Kv = [{gains}] " in text and f"\n# lag = {law.lag:g} " in text


@pytest.mark.parametrize(
    "arguments",
    [["ur10"], ["kinova", "--task", "pose"]],
    ids=lambda words: words[0],
)
def test_an_arm_with_a_light_wrist_holds_an_unmodelled_load(arguments, tmp_path):
    file = written(tmp_path, *arguments)
    tables = read_toml(file)
    assert tables["controller"]["law"] == "separation" and "belief" not in tables
    beside = f"truth.payload.com={(0.6 * np.roll(tables['truth']['tool_translation'], 1)).tolist()}"
    for mass in (1e-3, tables["truth"]["payload"]["mass"]):
        rollout = Scenario.read(
            file, ["simulation.duration=1.6", FOUR_MS, f"truth.payload.mass={mass}", beside]
        ).run()
        assert rollout.diverged is None
        assert rollout.distance[-100:].max() < 0.02 * tables["reference"]["radius"]


def test_the_given_frame_and_task_are_used(tmp_path):
    robot = read_toml(written(tmp_path, ARM4, "--frame", "link4", "--task", "xy"))["robot"]
    assert (robot["frame"], robot["task"], len(robot["q0"])) == ("link4", "xy", 4)


def test_a_relative_urdf_is_found_from_the_files_folder(tmp_path, monkeypatch):
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "arm4.urdf").write_text(ARM4.read_text())
    monkeypatch.chdir(tmp_path)
    assert main(["init", "arms/arm4.urdf", "--out", "scenarios/mine.toml"]) == 0
    assert read_toml(Path("scenarios/mine.toml"))["robot"]["source"] == "../arms/arm4.urdf"
    assert Scenario.read("scenarios/mine.toml").estimated.frame == "tip"
    assert main(["init", "arms/arm4.urdf"]) == 0
    assert Path("arm4.toml").is_file()


def floating(folder):
    """Write arm4 on a floating base and return its path."""
    joint = '<joint name="free" type="floating"><parent link="world"/><child link="base"/></joint>'
    path = folder / "floating.urdf"
    path.write_text(
        ARM4.read_text().replace(
            '<link name="base"/>', f'<link name="world"/><link name="base"/>{joint}'
        )
    )
    return path


def test_a_floating_base_is_fixed_and_reported(tmp_path):
    file = written(tmp_path, floating(tmp_path))
    assert read_toml(file)["robot"]["weld_root"] is True
    assert "The base floats" in file.read_text()
    assert Scenario.read(file).estimated.model.nv == 4


def test_an_existing_file_is_kept_unless_forced(tmp_path, capsys):
    file = written(tmp_path, ARM4)
    file.write_text("mine")
    assert main(["init", str(ARM4), "--out", str(file)]) == 2
    assert "exists already. Overwrite it by --force" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert main(["init", str(ARM4), "--out", str(file), "--force"]) == 0
    assert "[reference]" in file.read_text()


@pytest.mark.parametrize("name", ['say "ah"', "two\nlines", "tab\t#=[]'", "back\\slash\x07\u2028"])
def test_the_file_is_valid_whatever_joints_links_and_files_are_called(tmp_path, name):
    arm, link = tmp_path / f"{name}.urdf", name.replace("\x07", "")  # XML has no such letter
    escaped = link.translate({34: "&quot;", 10: "&#10;", 9: "&#9;"})
    text = ARM4.read_text().replace('"joint2"', f'"{escaped} joint"')
    arm.write_text(text.replace('"tip"', f'"{escaped}"'))
    file = written(tmp_path, arm, "--frame", link)
    tables = read_toml(file)
    assert tables["title"] == name
    assert (tables["robot"]["source"], tables["robot"]["frame"]) == (str(arm), link)
    assert Scenario.read(file).estimated.joint_names[1] == f"{link} joint"


ONE_JOINT = """<robot name="one"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ur55"], "Did you mean 'ur5'?"),
        (["nothing.urdf"], "no such file"),
        ([str(ARM4), "--frame", "tipp"], "Did you mean 'tip'?"),
        (
            [str(ARM4), "--frame", "nothere"],
            "has no frame 'nothere'. Likely ends of the chain: tip, link4, finger1.",
        ),
        ([str(ARM4), "--frame", "finger2"], "mimic"),
        ([str(ARM4), "--task", "xyzz"], "no task is called"),
        (["solo8_fl_leg", "--task", "xyz"], "only 2 joints"),
        (["one.urdf"], "no link is moved by two independent joints"),
        ([str(ARM4), "--frame", "link1"], "only 1 joints"),
    ],
)
def test_refusals_are_status_2_and_write_nothing(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("one.urdf").write_text(ONE_JOINT)
    assert main(["init", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error and "Traceback" not in error
    assert not list(tmp_path.glob("*.toml"))


@pytest.mark.parametrize(
    ("origin", "first"),
    [
        ("panda", "panda_hand_tcp"),
        ("tiago_pro", "gripper_left_base_link"),
        ("g1_with_hands", "left_hand_palm_link"),
        ("talos", "left_sole_link"),
    ],
)
def test_the_most_likely_end_frame_comes_first(origin, first):
    path = example_path(origin)
    urdf = Urdf.read(path)
    ends = end_links(urdf.model(), urdf.mimics())
    assert ends[0] == first


def test_links_behind_mimic_joints_are_not_end_frames():
    path = example_path("tiago_pro")
    urdf = Urdf.read(path)
    assert "gripper_left_fingertip_left_link" in end_links(urdf.model())
    assert "gripper_left_fingertip_left_link" not in end_links(urdf.model(), urdf.mimics())


@pytest.mark.parametrize("law", [name for name, law in pa.laws.LAWS.items() if law.set_point])
def test_a_set_point_law_gets_a_reachable_set_point(tmp_path, law):
    file = written(tmp_path, "scara", "--law", law)
    tables = read_toml(file)
    assert tables["controller"]["law"] == law and tables["reference"]["kind"] == "waypoints"
    scenario = Scenario.read(file, ["simulation.duration=3.5", FOUR_MS])
    assert scenario.findings() == [] and scenario.controller.law.name == law
    rollout = scenario.run()
    assert rollout.diverged is None and rollout.distance[-75:].max() < 0.02 * rollout.extent
    gains = [line.removeprefix("# ") for line in file.read_text().splitlines() if "# Kp =" in line]
    assert len(gains) == 1  # and can be taken as it stands
    Scenario.read(file, [f"controller.{gains[0].split('#')[0].strip()}"])


@pytest.mark.parametrize(
    ("arguments", "law"),
    [(["--task", "joint"], "separation"), (["--law", "craig"], "craig")],
    ids=("task", "law"),
)
def test_a_joint_task_gets_sines_of_its_joints(tmp_path, arguments, law):
    file = written(tmp_path, ARM4, *arguments)
    tables = read_toml(file)
    assert (tables["robot"]["task"], tables["controller"]["law"]) == ("joint", law)
    assert tables["reference"]["kind"] == "sinusoid" and "tool_translation" not in tables["truth"]
    short = ["simulation.duration=1.6", TWO_MS]
    rollout = Scenario.read(file, short).run()
    fixed = Scenario.read(file, [*short, "controller.adaptation='none'"]).run()
    assert rollout.diverged is None and not rollout.limits.exceeded
    assert rollout.distance[-250:].max() < 0.4 * fixed.distance[-250:].max()


def test_a_set_point_law_of_a_joint_task_gets_a_pose_to_reach(tmp_path):
    file = written(tmp_path, ARM4, "--task", "joint", "--law", "bounded-torque")
    scenario = Scenario.read(file, ["simulation.duration=4.5", TWO_MS])
    assert scenario.trajectory.settles is not None and scenario.findings() == []
    rollout = scenario.run()
    assert rollout.diverged is None and rollout.distance[-100:].max() < 0.02 * rollout.extent


TELESCOPE = """<robot name="telescope"><link name="base"/>{links}
<joint name="lift" type="prismatic"><parent link="base"/><child link="mast"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1.1" effort="100" velocity="1"/></joint>
<joint name="arm" type="prismatic"><parent link="mast"/><child link="boom"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.5" effort="100" velocity="1"/></joint>
<joint name="wrist" type="revolute"><parent link="boom"/><child link="hand"/>
<origin xyz="0 -0.2 0"/><axis xyz="0 0 -1"/>
<limit lower="-1.8" upper="3" effort="100" velocity="1"/></joint>
<joint name="fixed" type="fixed"><parent link="hand"/><child link="tip"/>
<origin xyz="0 -0.08 0"/></joint><link name="tip"/></robot>"""
LINK = """<link name="{}"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01"
 iyz="0" izz="0.01"/></inertial></link>"""


def test_a_chain_without_a_circle_in_space_gets_the_best_plane(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        "pinadapt.robot.workspace._SIZES", 4
    )  # of circles: at these sizes none is possible in space
    links = "".join(LINK.format(name) for name in ("mast", "boom", "hand"))
    arm = tmp_path / "telescope.urdf"
    arm.write_text(TELESCOPE.format(links=links))
    file = written(tmp_path, arm)
    assert "the task is the plane yz" in capsys.readouterr().out
    tables = read_toml(file)
    assert (tables["robot"]["task"], tables["reference"]["plane"]) == ("yz", "yz")
    assert "can follow no circle in space" in " ".join(file.read_text().split("\n# "))
    assert main(["init", str(arm), "--task", "xyz", "--out", str(tmp_path / "other.toml")]) == 2
    assert 'take a plane as the task, such as "yz"' in capsys.readouterr().err


def test_the_true_robot_has_friction_that_the_controller_learns(tmp_path):
    scenario = Scenario.read(written(tmp_path, ARM4))
    true, model = scenario.true.friction, scenario.estimated.friction
    assert (true.viscous > 0.0).all() and (true.coulomb > 0.0).all() and not model.present
    names = scenario.controller.dynamics.names
    assert all(any(kind in name for name in names) for kind in ("viscous", "coulomb"))
