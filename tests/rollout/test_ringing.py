"""A torque that rings is distinguished from motion, noise and effects of frames."""

import json
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.rollout import Ringing, ringing
from pinadapt.rollout.recording import beyond_motion
from pinadapt.simulation.simulate import _ringing
from tests.support.chains import catalogue_robot
from tests.support.loops import circle_at_home, with_tool_and_load

T = 1e-3 * np.arange(8000)
MOTION = np.outer(1.0 + np.sin(2.0 * np.pi * T / 3.0), [30.0, 5.0])
NAMES = ("shoulder", "wrist")


def tone(frequency, amplitude, start=0.0):
    """Return torques (N, 2) of the wrist that oscillate from a time [s] on."""
    wave = amplitude * np.sin(2.0 * np.pi * frequency * T) * (start <= T)
    return np.outer(wave, [0.0, 1.0])


@pytest.mark.parametrize("frequency", [8.0, 27.0, 120.0, 333.3])
def test_an_oscillation_is_found_with_its_joint_frequency_and_size(frequency):
    found = ringing(T, MOTION + tone(frequency, 2.0), NAMES)
    assert found is not None and found.joint == "wrist"
    assert found.frequency == pytest.approx(frequency, abs=1.0)
    last = (MOTION + tone(frequency, 2.0))[4000:, 1]
    assert found.share == pytest.approx(np.sqrt(2.0 / np.mean(last**2)), rel=0.1)
    grown = ringing(T, MOTION + tone(frequency, 4.0, start=6.0), NAMES)  # begins late
    assert grown is not None and grown.frequency == pytest.approx(frequency, abs=1.0)


def test_a_slow_swing_is_found_where_the_motion_is_slower():
    turn = 2.0 * np.pi * T[:, None] / 3.0
    circle = np.hstack([np.cos(turn), np.sin(turn), np.full_like(turn, 0.4)])
    slowest = beyond_motion(T, circle)
    assert slowest == 1.5
    assert beyond_motion(T, circle[:1] + 0.0 * circle) == 1.5  # at rest
    fast = np.cos(6.0 * turn) + 3.0 * np.sin(turn)  # 2 Hz has most of the acceleration
    assert beyond_motion(T, fast) == pytest.approx(8.0, rel=0.02)
    assert beyond_motion(T[::10], fast[::10]) == pytest.approx(8.0, rel=0.03)
    assert beyond_motion(T[:100], circle[:100]) == np.inf
    torques = MOTION + tone(4.0, 2.0)
    found = ringing(T, torques, NAMES, slowest)
    assert found is not None and found.joint == "wrist" and found.frequency == pytest.approx(4.0)
    assert ringing(T, torques, NAMES, beyond_motion(T, fast)) is None
    robot = catalogue_robot("planar_2r")
    controller = pa.make_controller(robot, adaptation="none")
    assert ringing(T, torques, NAMES, controller.motion.bandwidth / (2.0 * np.pi)) is None
    assert _ringing(T, circle, torques, controller, robot).frequency == pytest.approx(4.0)
    assert ringing(T, MOTION, NAMES, slowest) is None
    square = MOTION + 3.0 * np.sign(np.sin(turn))
    assert ringing(T, square, NAMES, slowest) is None


@pytest.mark.parametrize(
    "torques",
    [
        MOTION,
        MOTION + 3.0 * np.random.default_rng(0).standard_normal(MOTION.shape),
        MOTION + tone(27.0, 0.3),
        MOTION + tone(27.0, 20.0) * (T < 2.0)[:, None],
        MOTION + np.sign(MOTION - MOTION.mean(axis=0)),
        np.zeros_like(MOTION),
    ],
    ids=["motion", "noise", "little", "over", "friction", "nothing"],
)
def test_other_torques_do_not_ring(torques):
    assert ringing(T, torques, NAMES) is None


def test_short_coarse_and_broken_records():
    torques = MOTION + tone(27.0, 5.0)
    assert ringing(T[:50], torques[:50], NAMES) is None
    assert ringing(T[:400], torques[:400], NAMES).frequency == pytest.approx(27.0, abs=2.0)
    assert ringing(T[::100], torques[::100], NAMES) is None  # ten samples a second show nothing
    assert ringing(T[::5], torques[::5], NAMES).frequency == pytest.approx(27.0, abs=1.0)
    broken = np.vstack([torques[:5000], np.full((3000, 2), np.nan)])
    assert ringing(T, broken, NAMES).joint == "wrist"
    assert ringing(T[:0], torques[:0], NAMES) is None


def loop(declared, **options):
    """Return a run of a Panda whose motors are 6 ms late."""
    robot, late = catalogue_robot("panda"), pa.robot.Actuators(delay=6e-3)
    true = with_tool_and_load(robot)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8),
        adaptation="natural",
        limits=pa.Limits(actuators=late if declared else None),
    )
    return pa.simulate(true, controller, circle_at_home(true), duration=1.0, engine=late, **options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the .* is too fast for motors")
def test_a_loop_with_late_motors_rings_until_they_are_declared(tmp_path):
    undeclared, declared = (loop(each, record_every=4) for each in (False, True))
    found = undeclared.ringing
    assert found is not None and found.joint in undeclared.joint_names
    assert 10.0 < found.frequency < 60.0 and found.share > 0.2
    assert f"the torque rings, {found.joint} at " in undeclared.verdict
    assert "pa.Limits(actuators=...)" in undeclared.verdict
    assert "torque rings" in str(undeclared)
    assert declared.ringing is None and "rings" not in declared.verdict
    undeclared.save(tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["ringing"] == found._asdict()
    loaded = pa.Rollout.load(tmp_path)
    assert loaded.ringing == found and loaded.verdict == undeclared.verdict
    quiet = replace(undeclared, ringing=None)
    assert quiet.summary()["ringing"] is None
    assert isinstance(found, Ringing)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("panda", pa.Sensors(encoder=2.0 * np.pi / 2**14)),
        ("z1", pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": 1e-3})),
    ],
    ids=["14 bit", "30 Hz"],
)
def test_coarse_sensors_do_not_ring(name, sensors):
    robot = catalogue_robot(name)
    true = robot.changed(payload=pa.Payload(0.03 * robot.mass))
    controller = pa.make_controller(robot.changed(inertial_scale=0.8), sensors=sensors, dt=2e-3)
    rollout = pa.simulate(true, controller, pa.reachable_circle(true), duration=1.4)
    assert rollout.diverged is None and rollout.ringing is None
