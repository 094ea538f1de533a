"""The zoo: cases as documented, robots that converge with default gains, and verdicts."""

import json

import numpy as np
import pinocchio as pin
import pytest

from pinadapt.cli.command_line import main
from pinadapt.zoo.experiment import (
    CONVERGED,
    SWING,
    zoo_case,
)

pytestmark = pytest.mark.slow


@pytest.fixture
def sooner(monkeypatch):
    """Let runs at 333 Hz end after 8 s, where robots have converged."""
    monkeypatch.setattr("pinadapt.zoo.experiment.LEAST_DURATION", 8.0)
    monkeypatch.setattr("pinadapt.zoo.experiment.PERIOD", 3e-3)


def test_the_tool_of_a_pose_case_swings():
    case = zoo_case("ur5", task="pose")
    start, later = (case.motion.at(t).x_d for t in (0.0, 0.25 * case.period))
    np.testing.assert_allclose(start, case.true.position(case.true.q0), atol=1e-12)
    turned = pin.Quaternion(start[3:]).angularDistance(pin.Quaternion(later[3:]))
    assert turned == pytest.approx(SWING)


@pytest.mark.usefixtures("sooner")
def test_a_chain_converges_under_the_default_law(tmp_path, capsys):
    names = ["asr_twodof"]
    here = ["--processes", "0", "--out", str(tmp_path)]  # where runs are as short as here
    assert main(["zoo", "--robots", ",".join(names), *here]) == 0
    rows = json.loads((tmp_path / "zoo.json").read_text())
    assert [row["robot"] for row in rows] == names
    (row,) = rows
    assert row["verdict"] == CONVERGED
    assert row["adapted"] <= 0.004 * row["radius"]
    assert row["adapted"] <= 0.1 * row["unadapted"]
    assert row["task"] == "position" and row["adapted_angle"] is None
    assert "1 of 1 converged" in capsys.readouterr().out


def test_the_command_writes_its_rows_in_the_order_of_the_robots(tmp_path, capsys):
    """Robots with most joints start first; these are refused at once."""
    names = ["planar_2r", "scara"]
    arguments = ["--robots", ",".join(names), "--processes", "0", "--task", "pose"]
    assert main(["zoo", *arguments, "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "zoo.json").read_text())
    assert [row["robot"] for row in rows] == names
    assert all(row["verdict"].startswith("refused: ") for row in rows)
    assert "0 of 2 converged" in capsys.readouterr().out
