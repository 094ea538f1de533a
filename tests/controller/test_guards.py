"""Measurements that a controller refuses as implausible, and when its estimates rest."""

from itertools import pairwise

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.loops import circle_at_home, with_tool_and_load
from tests.support.snapshots import guarded_alike, snapshot, unchanged

DT = 1e-3
SWITCHES = ["velocity", "time", "rest"]


def without(*names):
    """Return all guards but some."""
    return dict.fromkeys(names, False)


class Loop:
    """A UR5's controller after three samples near home, and what comes next."""

    def __init__(self, guards=True, **options):
        self.robot = catalogue_robot("ur5")
        believed = self.robot.changed(inertial_scale=0.8)
        self.controller = pa.make_controller(
            believed, limits=pa.Limits(guards=guards), dt=DT, **options
        )
        self.path, self.plant = circle_at_home(self.robot), pa.plants.PinocchioPlant(self.robot)
        self.state = self.controller.init(self.sample(0))
        for k in range(3):
            self.state = self.step(self.sample(k))

    def sample(self, k, **changed):
        """Return the measurement of sample k, with some of it changed."""
        v = np.linspace(0.1, 0.3, 6)
        q = self.plant.integrate(self.robot.q0, k * DT * v)
        return self.plant.measurement(q, v, k * DT)._replace(**changed)

    def step(self, sample, state=None, dt=DT):
        """Return the state after a sample."""
        state = self.state if state is None else state
        return self.controller.step(state, sample, self.path.at(sample.t), dt)[1]

    def check_refused(self, words, sample, kind=pa.ImplausibleError):
        """The sample is refused, the state as good as before."""
        before = snapshot(self.state)
        state = self.state
        with pytest.raises(kind, match=words):
            for k in range(20):  # what does not last is bridged
                state = self.step(sample._replace(t=sample.t + k * DT), state)
        assert unchanged(self.state, before)


def spoilt(loop):
    """Return for each guard a sample that it refuses at once, and what it says."""
    sample = loop.sample(3)
    return {
        "velocity": (
            sample._replace(v=np.degrees(4.0 * sample.v)),
            r"'v' is implausible: joint 'shoulder_(pan|lift)_joint', .*in degrees\?",
        ),
        "time": (sample._replace(t=0.5 * DT), r"'t' is before the last sample's, 0.002 s"),
    }


@pytest.mark.parametrize("name", ["velocity", "time"])
def test_a_guard_refuses_by_name_and_can_be_switched_off(name):
    loop = Loop()
    sample, words = spoilt(loop)[name]
    loop.check_refused(words, sample)
    for guards in (without(name), False):
        assert Loop(guards).step(sample).t == sample.t
    others = without(*(other for other in SWITCHES if other != name), "differences", "gravity")
    Loop(others).check_refused(words, sample)


def test_plausible_samples_pass_to_the_bit():
    one = Loop()
    other = Loop(False)
    checked = one.step(one.sample(3))
    free = other.step(other.sample(3))
    assert checked.sensed.first is not None and free.sensed.first is None
    assert unchanged(guarded_alike(checked), snapshot(guarded_alike(free)))


# --- dropped samples ---


@pytest.mark.parametrize("missed", [1, 2, 8])
def test_a_step_after_dropped_samples_covers_the_elapsed_time(missed):
    loop = Loop()
    late = loop.sample(3 + missed)
    over = loop.step(late)
    told = Loop(without("time"))
    expected = told.step(late, dt=late.t - loop.state.t)
    assert unchanged(guarded_alike(over), snapshot(guarded_alike(expected)))
    assert not np.array_equal(over.a_d, told.step(late).a_d)


def test_a_pause_of_more_than_ten_periods_is_refused():
    loop = Loop()
    loop.step(loop.sample(2 + 10))
    loop.check_refused(r"dt: .*at most 0.01 s.*start anew", loop.sample(2 + 11), pa.InputError)
    assert Loop(without("time")).step(loop.sample(2 + 11)).t == 13 * DT


# --- rest ---


def resting(noise=None, encoder=0.0):
    """Yield states of a controller whose arm all but rests at its reference, seen through noise.

    Past the hundredth sample the reference moves at 0.05 m/s.
    """
    robot = catalogue_robot("ur5")
    sensors = pa.Sensors(noise=noise, encoder=encoder)
    believed = robot.changed(inertial_scale=0.8)
    controller = pa.make_controller(believed, adaptation="natural", sensors=sensors)
    plant = pa.plants.PinocchioPlant(robot)
    seen = pa.plants.SimulatedSensors(robot, DT, sensors, seed=1)
    still = np.zeros(3)
    state = None
    x_d = robot.position(robot.q0) + 5e-5
    for k in range(200):
        v = 5e-4 * np.sin(k + np.arange(6.0))
        sample = seen.measure(plant.measurement(robot.q0, v, k * DT))
        state = controller.init(sample) if state is None else state
        xd_d = still if k < 100 else np.array([0.05, 0.0, 0.0])
        state = controller.step(state, sample, pa.Desired(x_d, xd_d, still), DT)[1]
        yield state


SENSORS = {
    "perfect": {},
    "noise of v": {"noise": {"v": 0.02}},
    "noise of x": {"noise": {"x": 1e-3}},
    "14 bits": {"encoder": 2 * np.pi / 2**14, "noise": {"q": 1e-4}},
}


@pytest.mark.parametrize("sensors", SENSORS.values(), ids=SENSORS.keys())
def test_estimates_pause_at_rest_and_resume_with_the_reference(sensors):
    states = list(resting(**sensors))
    share = np.mean([np.array_equal(a.a_d, b.a_d) for a, b in pairwise(states[:100])])
    assert share > (0.99 if sensors == {} else 0.95)  # a deviation of four is rare
    moved = [not np.array_equal(a.a_d, b.a_d) for a, b in pairwise(states[99:])]
    assert all(moved)


def test_in_a_closed_loop_estimates_stand_still_once_the_arm_does():
    """They learn until the arm is where it should be, and to the bit nothing afterwards."""
    robot = catalogue_robot("ur5")
    true = with_tool_and_load(robot)
    path = pa.trajectories.Hold(true.position(true.q0))
    rollout = pa.simulate(
        true, pa.make_controller(robot, adaptation="natural", dt=2e-3), path, duration=3.0
    )
    assert (rollout.a_d[0] != rollout.a_d[-1]).any()
    assert np.array_equal(rollout.a_d[-250], rollout.a_d[-1])
    assert np.array_equal(rollout.a_k[-250], rollout.a_k[-1])
    assert rollout.distance[-1] < 2e-4
