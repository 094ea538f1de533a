"""What ``load`` and ``pinadapt init`` choose by default: frame, task, home pose and circle."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt._output import read_toml
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import example_path
from pinadapt.description.chain import position_limits
from pinadapt.robot.home import find_home
from pinadapt.robot.loading import end_links
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ARM4

pytestmark = pytest.mark.slow

FILES = {
    "arm4": ARM4,
    **{name: example_path(name) for name in ("panda", "a1", "double_pendulum_simple")},
}


loaded = cache(pa.load)  # two tests ask the same robots


@pytest.mark.parametrize("path", FILES.values(), ids=list(FILES))
def test_init_and_load_choose_the_same(path, tmp_path):
    file = tmp_path / "scenario.toml"
    assert main(["init", str(path), "--out", str(file)]) == 0
    written = read_toml(file)["robot"]
    robot = loaded(path)
    assert (written["frame"], written["task"]) == (robot.frame, robot.task.name)
    np.testing.assert_allclose(written["q0"], robot.home_angles, rtol=0.0, atol=1e-10)
    lower, upper = position_limits(robot.model)
    assert ((lower < robot.home_angles) & (robot.home_angles < upper)).all()
    scenario = Scenario.read(file)
    circle = pa.reachable_circle(robot)
    np.testing.assert_allclose(circle.at(0.0).x_d, robot.position(robot.q0), atol=1e-12)
    there = scenario.trajectory.starting_at(circle.at(0.0).x_d)
    for t in np.linspace(0.0, circle.period, 5):
        np.testing.assert_allclose(there.at(t).x_d, circle.at(t).x_d, atol=1e-9)


def test_the_elbow_stays_above_the_floor():
    robot = pa.load(example_path("ur10"))
    model = robot.model
    frame = robot.frame_id
    rows = robot.frame_task.rows
    without = find_home(model, [frame], rows, [pin.neutral(model)])
    assert np.isfinite(position_limits(model)).all()  # a turn to each side
    distances = robot.mounting.distances(model, frame, [without, robot.q0])
    assert distances[0] < -0.3 and distances[1] > 0.05 * robot.reach


def with_links(folder, *names):
    """Return arm4 without its tip, with these links fixed to its last link instead."""
    text = ARM4.read_text().replace('name="tip"', f'name="{names[0]}"')
    text = text.replace('link="tip"', f'link="{names[0]}"')
    more = "".join(
        f'<link name="{name}"/><joint name="to {name}" type="fixed"><parent link="link4"/>'
        f'<child link="{name}"/><origin xyz="0 0 {0.1 + 0.1 * i}"/></joint>'
        for i, name in enumerate(names[1:])
    )
    path = folder / "arm.urdf"
    path.write_text(text.replace("</robot>", f"{more}</robot>"))
    return path


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (("flange", "camera_tool_frame"), "flange"),
        (("left_fingertip", "wrist", "imu"), "wrist"),
    ],
)
def test_a_tool_is_taken_before_cameras_and_fingers(tmp_path, names, chosen):
    path = with_links(tmp_path, *names)
    robot = pa.load(path)
    ends = [end for end in end_links(pin.buildModelFromUrdf(str(path))) if end in names]
    assert ends[0] == chosen
    palm = "link4"  # carries two fingers
    assert robot.frame == (chosen if chosen != "wrist" else palm)
    assert set(names) - {robot.frame} <= set(robot.ends)


def test_a_floating_base_is_fixed(tmp_path):
    text = ARM4.read_text().replace(
        '<link name="base"/>',
        '<link name="world"/><link name="base"/><joint name="free" type="floating">'
        '<parent link="world"/><child link="base"/></joint>',
    )
    path = tmp_path / "floating.urdf"
    path.write_text(text)
    robot = pa.load(path)
    assert robot.welded and robot.model.nv == 4 and "floating base fixed" in repr(robot)
    assert robot.locked == ("finger1_joint", "finger2_joint")
    assert pa.load(pin.buildModelFromUrdf(str(path)), frame="tip").welded


def test_the_circle_of_a_pose_task_can_be_tracked():
    robot = pa.load("ur5", task="pose")
    true = robot.changed(tool_translation=[0.0, 0.0, 0.05])
    circle = pa.reachable_circle(robot)
    start = true.position(true.q0)
    moved = circle.starting_at(start)
    assert (moved.radius, moved.period, moved.plane) == (circle.radius, circle.period, circle.plane)
    np.testing.assert_allclose(moved.at(0.0).x_d, start, atol=1e-12)
    quarter = moved.at(0.25 * circle.period).x_d
    np.testing.assert_allclose(quarter[3:], start[3:], atol=1e-12)
    assert np.linalg.norm(quarter[:3] - start[:3]) == pytest.approx(2**0.5 * circle.radius)
