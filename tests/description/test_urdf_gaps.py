"""Common gaps in URDF files are filled with a warning."""

import re

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits, velocity_limits
from tests.support.descriptions import arm4
from tests.support.paths import ARM4


def test_undeclared_prefixes_are_part_of_the_name(tmp_path):
    tags = '<drake:joint name="x" drake:stiff="1"><drake:gain/></drake:joint></robot>'
    robot = pa.load(arm4(tmp_path, ("</robot>", tags)))
    assert robot.joint_names == pa.load(ARM4).joint_names
    with pytest.raises(pa.RobotError, match="not well-formed XML"):
        pa.load(arm4(tmp_path, ("</robot>", "<drake:joint></robot>")))


def test_missing_limits_mean_no_limit(tmp_path):
    first = re.search(r"<limit [^>]*/>", ARM4.read_text()).group()
    with pytest.warns(UserWarning, match=r"no limit is stated, taken as unlimited: joint1"):
        robot = pa.load(arm4(tmp_path, (first, '<limit lower="-1" upper="1"/>')))
    assert np.isinf(effort_limits(robot.model)[0]) and np.isinf(velocity_limits(robot.model)[0])
    assert robot.model.upperPositionLimit[0] == 1.0
    with pytest.warns(UserWarning, match="no limit is stated, taken as unlimited: joint1"):
        free = pa.load(arm4(tmp_path, (first, "")))
    assert free.joint_names == robot.joint_names


def test_an_undefined_parent_becomes_a_link_without_body(tmp_path):
    weld = '<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>'
    path = arm4(tmp_path, ("</robot>", f"{weld}</robot>"))
    with pytest.warns(UserWarning, match="parent link added without a body: world"):
        robot = pa.load(path)
    assert robot.joint_names == pa.load(ARM4).joint_names


LEG = """<robot name="leg">{links}
<joint name="a" type="revolute"><parent link="body"/><child link="thigh"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/></joint>
<joint name="b" type="revolute"><parent link="thigh"/><child link="tool"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/></joint>
<joint name="c" type="revolute"><parent link="thigh"/><child link="shank"/><axis xyz="0 1 0"/>
<origin xyz="0 0 -0.4"/><limit lower="-2" upper="2" effort="50" velocity="5"/></joint>
<joint name="d" type="fixed"><parent link="shank"/><child link="foot"/><origin xyz="0 0 -0.4"/>
</joint></robot>"""


def test_the_next_end_is_taken_if_the_first_cannot_do_any_task(tmp_path):
    """What looks like a tool turns in place; the foot moves in a plane."""
    body = (
        '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    )
    links = '<link name="body"/><link name="foot"/>' + "".join(
        f'<link name="{name}">{body}</inertial></link>' for name in ("thigh", "tool", "shank")
    )
    path = tmp_path / "leg.urdf"
    path.write_text(LEG.format(links=links))
    robot = pa.load(path)
    assert (robot.frame, robot.task.name) == ("foot", "xz") and "tool" in robot.ends
    with pytest.raises(pa.RobotError, match="cannot move all coordinates"):
        pa.load(path, frame="tool")
    with pytest.raises(pa.RobotError, match="'tool' has only 2 joints"):
        pa.load(path, task="pose")
