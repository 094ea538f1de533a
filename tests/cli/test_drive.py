"""``pinadapt drive``, ``replay`` and ``tell``."""

import re
import threading
import time

import numpy as np
import pytest

from pinadapt.cli import main
from pinadapt.realtime import CycleLog, tell
from tests.support.arms import ORDINARY

SCENARIO = """
[robot]
source = "planar_2r"
gravity = [0.0, -9.81, 0.0]
[truth]
payload = { mass = 0.3 }
[controller]
adaptation = "natural"
dt = 0.01  # ten of them are a long stall, even on a busy machine
[trajectory]
kind = "circle"
radius = 0.1
period = 3.0
"""
OWN = """
from functools import partial
import pinadapt as pa
from pinadapt.realtime import PlantArm

class Mine(PlantArm):
    def __init__(self, address, robot):
        assert address == "here"
        super().__init__(pa.plants.PinocchioPlant(robot), 1e-2)

def nothing(address, robot):
    return None
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a scenario and a user's own arm."""
    folder = tmp_path_factory.mktemp("drive")
    (folder / "arm.toml").write_text(SCENARIO)
    (folder / "mine.py").write_text(OWN)
    return folder


@pytest.fixture(autouse=True)
def ordinary(monkeypatch):
    """Run loops without real-time priority and without active waiting."""
    monkeypatch.setattr("pinadapt.cli.drive.Scheduling", lambda **_: ORDINARY)


def drive(folder, *arguments, kind="simulated"):
    """Return the exit status of ``pinadapt drive`` with the scenario and its log."""
    given = ("--scenario", str(folder / "arm.toml"), "--log", str(folder / "run.mcap"))
    return main(["drive", *kind.split(), *given, "--safety", "late=1000000", *arguments])


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_a_users_own_arm_is_driven_replayed_and_identified(folder, capsys):
    assert drive(folder, "--adapt", "--duration", "0.3", kind=f"{folder}/mine.py:Mine here") == 0
    out = capsys.readouterr().out
    assert "worst" in out and "learned parameters in" in out
    assert (folder / "run.learned.json").is_file()
    assert main(["replay", str(folder / "run.mcap")]) == 0
    assert "the same torques, bit for bit" in capsys.readouterr().out
    assert main(["replay", str(folder / "run.mcap"), "--set", "controller.Kv=5.0"]) == 0
    out = capsys.readouterr().out
    largest = [float(number) for number in re.findall(r"^joint\d.* (\S+)$", out, re.M)]
    assert len(largest) == 2 and max(largest) > 1e-3 and "bit for bit" not in out


@pytest.mark.slow
def test_a_simulated_arm_is_commanded_from_another_process(folder, capsys):
    """The plant has a process of its own; commands come by the port that is printed."""
    said = []

    def command():
        while not (found := re.search(r"port (\d+)", capsys.readouterr().out)):
            time.sleep(0.05)
        port = int(found[1])
        while tell(port, "state", timeout=20.0)["cycle"] < 50:
            time.sleep(0.05)
        said.append(main(["tell", str(port), "stop"]))

    teller = threading.Thread(target=command)
    teller.start()
    assert drive(folder, "--hold", "--duration", "100") == 0
    teller.join(20.0)
    log = CycleLog.read(folder / "run.mcap")
    assert said == [0] and log.about["stage"] == "hold"
    assert [event["phase"] for event in log.events if "phase" in event][-1] == "stopped"
    assert np.abs(log.cycles.v[-1]).max() < 0.1
