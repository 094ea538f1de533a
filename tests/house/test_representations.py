"""What robots, controllers and rollouts show of themselves, as text and in a notebook."""

import re

import pytest

import pinadapt as pa
from tests.support.paths import ARM4


@pytest.fixture(scope="module")
def run():
    robot = pa.load(ARM4)
    controller = pa.make_controller(robot)
    rollout = pa.simulate(robot, controller, pa.reachable_circle(robot), duration=0.2)
    return robot, controller, rollout


def test_a_robot_shows_frame_task_size_ends_and_joints_with_units(run):
    robot = run[0]
    text = repr(robot)
    assert str(robot) == text and len(text.splitlines()) < 20
    for word in ("arm4, 4 joints", "tip", "xyz", f"{robot.mass:.4g} kg", f"{robot.reach:.4g} m"):
        assert word in text
    assert re.search(r"other ends +link4, finger1", text)
    rows = {line.split()[0]: line for line in text.splitlines() if line.startswith("joint")}
    for name, home in zip(robot.joint_names, robot.home_angles, strict=True):
        assert f"{home:.4g}" in rows[name] and rows[name].endswith("rad, rad/s, N m")
    assert rows["joint3"].split()[5] == "-"  # no effort is stated
    assert "m, m/s, N" in repr(pa.load("scara"))


def test_a_rollout_shows_its_title_and_verdict(run):
    assert repr(run[2]) == f"{run[2].title}: {run[2].verdict}"


def test_names_are_escaped(tmp_path):
    path = tmp_path / "evil.urdf"
    evil = "&lt;script&gt;alert(1)&lt;/script&gt;"
    path.write_text(ARM4.read_text().replace('"joint2"', f'"{evil}"'))
    robot = pa.load(path)
    assert robot.joint_names[1] == "<script>alert(1)</script>"
    assert "<script" not in robot._repr_html_() and "&lt;script&gt;" in robot._repr_html_()
