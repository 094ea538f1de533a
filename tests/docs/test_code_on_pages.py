"""The code on the pages of the site runs without changes."""

import re

import numpy as np
import pytest

import pinadapt as pa
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

DOCS = ROOT / "docs"


def blocks(page):
    """Return the Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", (DOCS / f"{page}.md").read_text(), re.S)


def test_the_quickstart_runs(tmp_path, monkeypatch, capsys, blank_pictures):
    monkeypatch.chdir(tmp_path)
    scope = {}
    for block in blocks("quickstart"):
        if "while True" not in block:  # the loop of an arm, see below
            exec(re.sub(r"duration=[45]\.0", "duration=1.2", block), scope)
    for name in ("rollout", "wave", "legs"):
        assert scope[name].summary()["max_error_last"] < 1e-3
    assert (tmp_path / "out" / "error.png").is_file()
    assert "@article" in capsys.readouterr().out


def test_the_page_without_calibration_runs():
    """Shortened, the first one at half of its rate; both begin after two seconds of a wiggle."""
    scope = {}
    of_tracker, of_camera = blocks("without_calibration")
    assert "dt=0.002" in of_tracker
    exec(of_tracker.replace("0.002", "0.004").replace("duration=3.0", "duration=1.0"), scope)
    assert scope["rollout"].distance.max() < 1e-4
    found, true = scope["rollout"].tracker().tracker, scope["true"].tracker
    assert found.placement.homogeneous == pytest.approx(true.homogeneous, abs=1e-5)
    exec(of_camera.replace("duration=1.0", "duration=0.5"), scope)
    assert scope["rollout"].distance.max() < 2e-3


class Arm:
    """A simulated arm with the interface that the page on hardware describes."""

    def __init__(self, robot, samples):
        """Take the true robot, which compensates described gravity, and the number of samples."""
        self.plant = pa.plants.PinocchioPlant(robot, compensation=pa.robot.Gravity(pa.load("ur5")))
        self.left, self.sent, self.error = samples, [], None
        self.driven, self.reached = 0, None

    def read(self):
        """Return a measurement."""
        truth = self.plant.measure()
        return pa.Measurement(truth.t, truth.q, truth.v, x=truth.x, x_time=truth.t)

    def enabled(self):
        """Return whether the run continues; at its end, keep how many torques came and where."""
        self.left -= 1
        if self.left == -1:
            self.driven, self.reached = len(self.sent), self.read()
        return self.left >= 0

    def send(self, torque):
        """Move for a period."""
        self.sent.append(torque)
        self.plant.step(torque, 1e-3)

    def stop(self, error):
        """Keep the error."""
        self.error = error


class Operator:
    """An operator who presses the button from the n-th sample on."""

    def __init__(self, after):
        """Take n."""
        self.left = after

    def pressed(self, button):
        """Return whether the button is pressed."""
        self.left -= 1
        return self.left < 0


@pytest.mark.usefixtures("forked")
def test_the_realtime_loop_on_the_page_on_hardware_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(blocks("hardware")[0], {"__name__": "__main__"})
    assert "stopped" in capsys.readouterr().out


@pytest.mark.parametrize("after", [200, 10_000])
def test_the_loop_on_hardware_runs_and_adapts_only_when_enabled(after):
    _, block, _ = blocks("hardware")
    arm = Arm(pa.load("ur5").changed(payload=pa.Payload(mass=1.0)), samples=600)
    block = block.replace('pa.load("my_robot.urdf", frame="tool0")', 'pa.load("ur5")')
    scope = {"arm": arm, "operator": Operator(after)}
    exec(block, scope)
    assert arm.error is None and arm.driven == 600
    state, initial = scope["state"], scope["controller"].dynamics.initial
    assert state.adapting == (after < 600)
    assert np.array_equal(state.a_d, initial) == (after > 600)
    reached = scope["motion"].at(0.6).x_d
    assert np.linalg.norm(arm.reached.x - reached) < 0.01
    assert len(arm.sent) > 600 and np.abs(arm.read().v).max() < 0.01  # then it comes to rest
    assert np.linalg.norm(arm.read().x - reached) < 0.03  # where a load not learned sags
    assert np.abs(arm.sent[0]).max() < 30.0  # without the gravity torque that the arm adds itself


def test_the_declaration_of_actuators_on_the_page_on_hardware_runs(capsys):
    scope = {"pa": pa, "robot": pa.load("ur5")}
    exec(blocks("hardware")[2], scope)
    assert capsys.readouterr().out == "[]\n"
    assert scope["springs"].elastic and scope["controller"].limits.actuators is scope["late"]
