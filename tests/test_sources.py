"""One rule says what is the path of a file and what a name in the catalogue, for the library, scenarios and `init` alike."""

from pathlib import Path

import pytest

import pinadapt as pa
from pinadapt.cli import main
from pinadapt.robot.urdf import is_path
from pinadapt.scenario import Scenario

PATHS = ["arm.urdf", "arm.xml", "./arm", "arms/arm", Path("arm")]
NAMES = ["ur5", "arm", "urdf", "arm.toml"]


def test_the_rule():
    assert all(is_path(source) for source in PATHS)
    assert not any(is_path(source) for source in NAMES)


@pytest.mark.parametrize(("source", "words"), [("arms/arm", "no such file"), ("arm", "neither a robot of the catalogue")])
def test_everyone_follows_it(source, words, tmp_path, capsys):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f'[robot]\nsource = "{source}"\n')
    for refused in (lambda: pa.load(source), lambda: Scenario.read(scenario)):
        with pytest.raises(pa.RobotError, match=words):
            refused()
    assert main(["init", source]) == 2
    assert words in capsys.readouterr().err
