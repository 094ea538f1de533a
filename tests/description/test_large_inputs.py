"""The time to read a description is linear in its size, not quadratic."""

import time

import pytest

import pinadapt as pa
from pinadapt.description.urdf import Urdf
from pinadapt.robot import loading
from pinadapt.robot.loading import end_links
from pinadapt.scenario.template import Template
from tests.support.descriptions import XMLNS
from tests.support.paths import ARM4

pytestmark = pytest.mark.slow

BODY = ARM4.read_text().removesuffix("</robot>\n")


def with_links(path, count, *, row=True):
    """Write arm4 with ``count`` more links fixed behind its tip, each on the one before or not."""
    parts = [BODY]
    for i in range(count):
        parent = f"extra{i - 1}" if row and i else "tip"
        parts.append(
            f'<link name="extra{i}"/><joint name="fix{i}" type="fixed"><parent link="{parent}"/>'
            f'<child link="extra{i}"/><origin xyz="0 0 0.00001"/></joint>'
        )
    path.write_text("".join([*parts, "</robot>"]))
    return path


def with_comment(path, size, xmlns=""):
    """Write arm4 with a comment of ``size`` letters."""
    text = BODY.replace('<robot name="arm4">', f'<robot name="arm4" {xmlns}>')
    path.write_text(f"{text}<!--{'x' * size}--></robot>")
    return path


def seconds(action, *arguments, calls=2):
    """Return the shortest processor time of some calls."""
    times = []
    for _ in range(calls):
        start = time.process_time()
        action(*arguments)
        times.append(time.process_time() - start)
    return min(times)


def test_finding_ends_is_linear_in_the_number_of_links(tmp_path):
    path = tmp_path / "a.urdf"
    few, many = (Urdf.read(with_links(path, n, row=False)).model() for n in (1000, 4000))
    assert seconds(end_links, many) < 10 * seconds(end_links, few)  # 16 times, if they were squared


def test_three_thousand_fixed_links_load(tmp_path):
    path = with_links(tmp_path / "long.urdf", 3000)
    begun = time.process_time()
    template = Template.of(str(path), frame="extra2999")
    assert time.process_time() - begun < 20  # it was two minutes; now one second
    assert template.robot.joint_names == ["joint1", "joint2", "joint3", "joint4"]


def test_a_chain_of_links_too_long_for_the_stack_is_refused(tmp_path):
    with pytest.raises(pa.RobotError, match="more than 3200 links in one chain"):
        pa.load(with_links(tmp_path / "deep.urdf", 6000))


@pytest.mark.parametrize("name", ["deep.urdf", "deep.xacro"])
def test_too_deeply_nested_elements_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_text(f"<robot name='r'>{'<a>' * 20_000}{'</a>' * 20_000}</robot>")
    with pytest.raises(pa.RobotError, match="nested too deeply"):
        pa.load(path)


@pytest.mark.parametrize(("name", "xmlns"), [("a.urdf", ""), ("a.xacro", XMLNS)])
def test_a_comment_is_read_in_linear_time(tmp_path, name, xmlns):
    sizes = (10**6, 2 * 10**7) if not xmlns else (10**5, 9 * 10**5)  # xacro files: at most 1 MB
    short, long = (with_comment(tmp_path / f"{n}{name}", n, xmlns) for n in sizes)
    start = time.process_time()
    text = Urdf.read(long).text
    assert time.process_time() - start < 3  # pieces of it, each read from the start: minutes
    assert text == Urdf.read(short).text


def test_a_hundred_thousand_attributes_are_refused_at_once(tmp_path):
    path = tmp_path / "a.urdf"
    attributes = " ".join(f'a{k}="1"' for k in range(100_000))
    path.write_text(BODY.replace("<robot ", f"<robot {attributes} ") + "</robot>")
    begun = time.process_time()
    with pytest.raises(pa.RobotError, match="<robot> has 100001 attributes, more than 1000"):
        pa.load(path)
    assert time.process_time() - begun < 5.0  # it was minutes


def test_a_chain_of_more_joints_than_the_limit_is_refused(monkeypatch):
    monkeypatch.setattr(loading, "_MOST_JOINTS", 3)
    with pytest.raises(pa.RobotError, match="a chain of 4 joints to tip, more than 3"):
        pa.load(ARM4)
