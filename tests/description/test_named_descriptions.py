"""Names of the package robot_descriptions, with a package of the same structure, offline."""

import sys

import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from tests.support.descriptions import MJCF, XMLNS
from tests.support.paths import ARM4

NAMES = ["arm4_description", "arm_mj_description", "arm_xacro_description"]
XACRO = f"""<robot name="x" {XMLNS}><xacro:include filename="$(find elsewhere)/$(arg kind).urdf"/>
</robot>"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install a package like robot_descriptions, with four names."""
    folder = tmp_path / "site" / "robot_descriptions"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text(f"DESCRIPTIONS = dict.fromkeys({NAMES})")
    (folder / "arm4_description.py").write_text(f"URDF_PATH = {str(ARM4)!r}")
    (tmp_path / "arm.xml").write_text(MJCF)
    mjcf = str(tmp_path / "arm.xml")
    (folder / "arm_mj_description.py").write_text(f"MJCF_PATH = {mjcf!r}")
    (tmp_path / "arm.urdf.xacro").write_text(XACRO)
    xacro = str(tmp_path / "arm.urdf.xacro")
    (folder / "arm_xacro_description.py").write_text(
        f"XACRO_PATH = {xacro!r}\nXACRO_ARGS = {{'kind': 'arm4'}}\n"
        f"XACRO_PACKAGE_PATHS = {{'elsewhere': {str(ARM4.parent)!r}}}"
    )
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(folder.parent))
    yield folder
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        del sys.modules[name]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_loaded_from_their_files(package, name):
    robot = pa.load(name, frame="tip")
    assert robot.name == name
    assert robot.model.nv == (3 if "mj" in name else 4)


@pytest.mark.usefixtures("blank_pictures")
def test_init_and_scenarios_take_them(package, tmp_path):
    file = tmp_path / "scenario.toml"
    assert main(["init", "arm4_description", "--out", str(file)]) == 0
    assert 'source = "arm4_description"' in file.read_text()
    assert main(["run", str(file), "--set", "simulation.duration=0.1", "--no-html"]) == 0
