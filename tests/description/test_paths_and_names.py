"""One rule distinguishes paths from names, in the library, scenarios and `init`."""

import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.scenario.scenario import Scenario
from tests.support.descriptions import TRIANGLE
from tests.support.paths import ARM4


@pytest.mark.parametrize(
    ("source", "words"), [("arms/arm", "No such file"), ("arm", "neither a robot of the catalogue")]
)
def test_library_scenarios_and_init_follow_the_rule(source, words, tmp_path, capsys):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f'[robot]\nsource = "{source}"\n')
    for refused in (lambda: pa.load(source), lambda: Scenario.read(scenario)):
        with pytest.raises(pa.RobotError, match=words):
            refused()
    assert main(["init", source]) == 2
    assert words in capsys.readouterr().err


def test_a_missing_mesh_is_found_where_the_warning_says(tmp_path, monkeypatch, recwarn):
    arm = tmp_path / "here" / "arm4.urdf"
    arm.parent.mkdir()
    visual = (
        '<visual><geometry><mesh filename="package://mine/meshes/link1.stl"/></geometry></visual>'
    )
    arm.write_text(
        ARM4.read_text().replace('<link name="base"/>', f'<link name="base">{visual}</link>')
    )
    with pytest.warns(
        UserWarning,
        match=r"arm4.urdf: .*package://mine/meshes/link1.stl.* ROS_PACKAGE_PATH",
    ):
        assert not pa.load(arm, frame="tip").visual.geometryObjects
    mesh = tmp_path / "there" / "mine" / "meshes" / "link1.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text(TRIANGLE)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "there"))
    recwarn.clear()
    assert len(pa.load(arm, frame="tip").visual.geometryObjects) == 1
    assert not recwarn.list
