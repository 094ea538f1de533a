"""What robots, controllers and rollouts show of themselves, as text and in a notebook."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

import pinadapt as pa
from tests.support.paths import ARM4


class Cells(HTMLParser):
    """The texts of a page, and its tags with their attributes."""

    def __init__(self, page):
        super().__init__()
        self.texts, self.tags = [], set()
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.add((tag, *(name for name, _ in attributes)))

    def handle_data(self, data):
        self.texts.append(data)


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


def test_a_controller_shows_law_gains_parameters_and_limits(run):
    text = repr(run[1])
    assert len(text.splitlines()) < 15
    for word in ("separation", "arm4, 4 joints", "xyz of tip", "N m s/rad", "tool_x", "1 ms"):
        assert word in text
    assert "50, 50, -, 10 N m or N" in text
    known = pa.make_controller(run[0], law="resolved-acceleration", adaptation="none")
    assert "resolved-acceleration" in repr(known)


def test_a_rollout_shows_robot_law_duration_and_errors_in_a_few_lines(run):
    rollout = run[2]
    text = repr(rollout)
    assert len(text.splitlines()) <= 7 < len(str(rollout).splitlines())
    last = f"{1e3 * rollout.window(first=False).max():.3f} mm in the last 10 %"
    for word in ("arm4, 4 joints, task xyz", "separation, adaptation natural", "0.2 s", last):
        assert word in text


def test_notebooks_show_the_same_rows(run):
    for thing in run:
        cells = Cells(thing._repr_html_())
        words = re.split(r" {3,}|\n", str(thing))
        shown = [word.strip() for word in words if word.strip(" -")]
        assert [text for text in cells.texts if text != "-"] == [w for w in shown if w != "-"]
        assert {tag for tag, *_ in cells.tags} <= {"div", "strong", "table", "tr", "td", "th"}
        assert {name for _, *names in cells.tags for name in names} <= {"style"}


def test_names_are_escaped(tmp_path):
    path = tmp_path / "evil.urdf"
    evil = "&lt;script&gt;alert(1)&lt;/script&gt;"
    path.write_text(ARM4.read_text().replace('"joint2"', f'"{evil}"'))
    robot = pa.load(path)
    assert robot.joint_names[1] == "<script>alert(1)</script>"
    assert "<script" not in robot._repr_html_() and "&lt;script&gt;" in robot._repr_html_()
    controller = pa.make_controller(robot, unknown=pa.Unknown(bodies=robot.joint_names[1:2]))
    assert "<script" not in controller._repr_html_()


def test_a_run_of_no_length_is_shown(run):
    robot, controller, _ = run
    far = pa.trajectories.Circle(np.full(3, 50.0), 0.1, 3.0)
    lost = pa.simulate(robot, controller, far, duration=1.0, engine=pa.Engine(torque_limits=False))
    assert "robot" in repr(lost) and "<table>" in lost._repr_html_()
