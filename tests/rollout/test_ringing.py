"""A torque that rings is distinguished from motion, noise and effects of frames."""

import json

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.rollout import ringing
from pinadapt.rollout.summary import ringing_words
from tests.support.chains import catalogue_robot
from tests.support.loops import circle_at_home, with_tool_and_load

T = 1e-3 * np.arange(8000)
MOTION = np.outer(1.0 + np.sin(2.0 * np.pi * T / 3.0), [30.0, 5.0])
NAMES = ("shoulder", "wrist")


def tone(frequency, amplitude, start=0.0):
    """Return torques (N, 2) of the wrist that oscillate from a time [s] on."""
    wave = amplitude * np.sin(2.0 * np.pi * frequency * T) * (start <= T)
    return np.outer(wave, [0.0, 1.0])


@pytest.mark.parametrize("frequency", [8.0, 333.3])
def test_an_oscillation_is_found_with_its_joint_frequency_and_size(frequency):
    found = ringing(T, MOTION + tone(frequency, 2.0), NAMES)
    assert found is not None and found.joint == "wrist"
    assert found.frequency == pytest.approx(frequency, abs=1.0)
    last = (MOTION + tone(frequency, 2.0))[4000:, 1]
    assert found.share == pytest.approx(np.sqrt(2.0 / np.mean(last**2)), rel=0.1)
    grown = ringing(T, MOTION + tone(frequency, 4.0, start=6.0), NAMES)  # begins late
    assert grown is not None and grown.frequency == pytest.approx(frequency, abs=1.0)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:dt = .* behind motors")
def test_a_loop_with_late_motors_rings_until_they_are_declared_or_the_lag_is_as_advised(tmp_path):
    robot = catalogue_robot("panda")
    late = pa.robot.Actuators(delay=15e-3)
    true = with_tool_and_load(robot)

    def run(**options):
        """Return a run of a Panda whose motors are 15 ms late."""
        controller = pa.make_controller(robot.changed(inertial_scale=0.8), **options)
        path = circle_at_home(true)
        return pa.simulate(true, controller, path, duration=1.2, engine=late, record_every=2)

    undeclared = run()
    found = undeclared.ringing
    assert found is not None and 10.0 < found.frequency < 60.0 and found.share > 0.2
    lag = float(undeclared.verdict.rpartition("lag = ")[2].rstrip("."))
    for quiet in (run(limits=pa.Limits(actuators=late)), run(lag=lag)):
        assert quiet.ringing is None and "rings" not in quiet.verdict
    words = ringing_words(found._replace(frequency=480.0), undeclared.evaluated().controller)
    assert "too fast for dt" in words and words.endswith("lag = 0.016")  # twice what it is
    undeclared.save(tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["ringing"] == found._asdict()
    loaded = pa.Rollout.load(tmp_path)
    assert loaded.ringing == found and loaded.verdict == undeclared.verdict
