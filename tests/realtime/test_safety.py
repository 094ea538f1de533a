"""The checklist: each item finds what it is for, and nothing in a good run."""

from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.realtime import PlantArm, Safety
from tests.support.arms import PERIOD, Loop, arm, faulty, robot


def ended(loop):
    """Run a loop; return what it found first and the phases it went through."""
    ending = loop.ended()
    return ending.reason, loop.phases


def test_a_good_run_finds_nothing():
    loop = Loop(seconds=1.0)
    assert ended(loop) == ("the time is over", ["running", "holding", "damping", "stopped"])
    assert not loop.loop.result.failed and len(loop.said) == 4


@pytest.mark.parametrize(
    ("limit", "words"), [({"velocity": 1e-3}, "velocity: "), ({"error": 1e-5}, "error: coordinate")]
)
def test_a_joint_that_is_too_fast_and_a_large_error_start_damping(limit, words):
    reason, phases = ended(Loop(safety=Safety(**limit)))
    assert reason.startswith(words) and phases == ["running", "damping", "stopped"]


def test_a_joint_brakes_before_its_stop():
    """The arm never reaches the stop, although its path leads across it."""
    bounded = robot()
    model = bounded.model.copy()
    stop = robot().q0[0] + 0.05
    model.upperPositionLimit[0] = stop
    bounded = replace(bounded, model=model)
    turning = pa.trajectories.Waypoints(
        [bounded.position(robot().q0), bounded.position(robot().q0 + np.array([0.4, 0.0]))], 0.5
    )
    of = pa.make_controller(bounded, dt=PERIOD, adaptation="natural")
    on = faulty(None, true=bounded)
    highest = []
    on.fault = lambda arm, m: highest.append(m.q[0]) or m
    on.at = 0
    reason, phases = ended(Loop(on, motion=turning, of=of, seconds=1.0))
    assert reason.startswith("joint stop: ") and phases[1] == "damping"
    assert max(highest) < stop


def test_the_frame_stays_in_its_box():
    home = robot().position(robot().q0)
    loop = Loop(safety=Safety(box=[home - 0.01, home + 0.01]), seconds=2.0)
    reason, _ = ended(loop)
    assert reason.startswith("workspace: coordinate ")
    with pytest.raises(pa.InputError, match=r"safety.box: has 3 coordinates; the task has 2"):
        Loop(safety=Safety(box=np.array([[0.0] * 3, [1.0] * 3])))


def test_an_unknown_load_does_not_sink_while_the_arm_is_damped():
    on = faulty(None)
    q = []
    on.fault = lambda arm, m: q.append(m.q) or m
    on.at = 0
    loop = Loop(on, "hold", seconds=0.8)
    assert ended(loop)[1][-2:] == ["damping", "stopped"]
    damped = next(t for t, phase, _ in loop.loop.result.phases if phase == "damping")
    assert np.abs(np.array(q)[round(damped / PERIOD) :] - q[round(damped / PERIOD)]).max() < 3e-3


class Wall(PlantArm):
    """An arm that meets a stiff wall at some angle of its first joint."""

    angle, stiffness, felt = 0.0, 2000.0, None

    def send(self, torque):
        over = self.plant.measure().q[0] - self.angle
        push = np.array([self.stiffness * max(over, 0.0), 0.0])
        if over > 0.0 and self.felt is None:
            self.felt = self._count
        super().send(torque - push)


def test_an_obstacle_is_distinguished_from_a_load_and_freezes_the_adaptation_first():
    away = pa.trajectories.Waypoints(
        [robot().position(robot().q0), robot().position(robot().q0 + np.array([0.5, 0.0]))], 0.8
    )
    with_load = Loop(motion=away, seconds=1.2)
    assert ended(with_load)[0] == "the time is over"
    on = arm(kind=Wall)
    on.angle = robot().q0[0] + 0.2
    loop = Loop(on, motion=away, seconds=1.2)
    reason, phases = ended(loop)
    assert reason.startswith("contact: ") and phases == ["running", "damping", "stopped"]
    assert any(words.startswith("the adaptation rests: contact") for words in loop.said)


def test_the_latch_stops_and_stays():
    def pressed(arm, m):
        loop.loop._checks.latched = "red button"
        return m

    on = faulty(pressed)
    loop = Loop(on, seconds=3.0)
    reason, phases = ended(loop)
    assert reason == "latch: red button" and phases == ["running", "damping", "stopped"]
