"""Xacro files are expanded with arguments and without ROS; errors name file and reason."""

import pytest

import pinadapt as pa
from pinadapt._output import read_toml
from pinadapt.cli.command_line import main
from pinadapt.description.xacro import Packages
from pinadapt.scenario.scenario import Scenario
from tests.support.descriptions import TRIANGLE, XMLNS
from tests.support.paths import ARM4

BODY = ARM4.read_text().split('<robot name="arm4">')[1].replace("</robot>", "")
ARM = f"""<robot name="arm" {XMLNS}>
<xacro:arg name="reach" default="0.3"/><xacro:arg name="tool" default="true"/>
<xacro:include filename="$(find parts)/macros.xacro"/>
{BODY.replace('xyz="0.3 0 0"', 'xyz="$(arg reach) 0 0"')}
<xacro:if value="$(arg tool)"><xacro:tool name="probe" length="${{2 * 0.05}}"/></xacro:if>
</robot>"""
MACROS = f"""<robot {XMLNS}><xacro:macro name="tool" params="name length">
<link name="${{name}}"><visual><geometry><mesh filename="package://parts/meshes/p.stl"/></geometry>
</visual></link>
<joint name="${{name}}_joint" type="fixed"><parent link="tip"/><child link="${{name}}"/>
<origin xyz="${{length}} 0 0"/></joint></xacro:macro></robot>"""


@pytest.fixture
def arm(tmp_path):
    """Write a xacro file and, beside its folder, the package that it includes."""
    (tmp_path / "robot").mkdir()
    (tmp_path / "parts" / "meshes").mkdir(parents=True)
    (tmp_path / "parts" / "macros.xacro").write_text(MACROS)
    (tmp_path / "parts" / "meshes" / "p.stl").write_text(TRIANGLE)
    path = tmp_path / "robot" / "arm.urdf.xacro"
    path.write_text(ARM)
    return path


def forearm(robot):
    """Return the length of the link before the last joint."""
    return robot.model.jointPlacements[4].translation[0]


def test_arguments_have_defaults(arm):
    robot = pa.load(arm, frame="probe")
    assert forearm(robot) == 0.3
    assert len(robot.visual.geometryObjects) == 1


@pytest.mark.parametrize("name", ["arm.xml", "arm.urdf"])
def test_a_file_is_a_program_only_by_its_name(arm, name):
    with pytest.raises(pa.RobotError, match=r"whose name ends in \.xacro"):
        pa.load(arm.rename(arm.with_name(name)))


def test_init_and_scenarios_take_arguments(arm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--xacro", "reach=0.45", "--xacro", "tool=false"]
    assert main(["init", "robot/arm.urdf.xacro", *words, "--frame", "tip"]) == 0
    file = tmp_path / "arm.toml"
    assert read_toml(file)["robot"]["xacro"] == {"reach": "0.45", "tool": "false"}
    assert forearm(Scenario.read(file).estimated) == 0.45
    assert forearm(Scenario.read(file, ["robot.xacro.reach=0.5"]).estimated) == 0.5


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("parts)/macros", "part)/macros", ["package 'part' is not found", "ROS_PACKAGE_PATH"]),
        ("2 * 0.05", "2 * width", ["width", "not defined"]),
        ("$(arg tool)", "$(arg tol)", ["Undefined substitution argument", "--xacro name=value"]),
        ("$(arg reach) 0 0", "$(arg reach),0,0", ["joint 'joint4', <origin>", '"0.3,0,0"']),
    ],
)
def test_errors_name_file_and_reason(arm, old, new, words, capsys):
    assert old in ARM
    arm.write_text(ARM.replace(old, new))
    assert main(["init", str(arm)]) == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    for word in [str(arm), *words]:
        assert word in error


# --- packages ---


def test_packages_and_their_files_are_found_by_folder_and_environment(tmp_path, monkeypatch):
    here = tmp_path / "ws" / "arm_description" / "urdf"
    places = {
        "arm_description": here.parent,
        "beside": tmp_path / "ws" / "beside",
        "from_ros_1": tmp_path / "ros1" / "from_ros_1",
        "from_ros_2": tmp_path / "ros2" / "share" / "from_ros_2",
    }
    for folder in [here, *places.values()]:
        folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros1"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros2"))
    packages = Packages(here)
    for name, folder in places.items():
        assert packages.find(name) == folder
    assert packages.find("nowhere") is None
    assert Packages(here, {"nowhere": str(tmp_path)}).find("nowhere") == tmp_path
    file = here.parent / "a b.stl"
    file.write_text(TRIANGLE)
    forms = "package://arm_description/a b.stl", "model://arm_description/a b.stl", "../a b.stl"
    for name in (*forms, f"file://{file}", str(file)):
        assert packages.file(name).resolve() == file
