"""After a refused sample, ``Controller.safe`` rests the arm on what can be believed, or says so."""

import copy
import math

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.lying_sensors import _apart, begun

DT = 2e-3


@pytest.fixture(scope="module")
def moving():
    """Return a loop of a UR5 in motion."""
    return begun("ur5", "separation", dt=DT)


def test_the_safe_torque_holds_an_arm_that_the_last_torque_moves_far(moving):
    """What used to be the advice after a refused sample."""
    loop = copy.deepcopy(moving)
    _, torque = next(iter(loop.samples(DT)))
    held = copy.deepcopy(loop.plant)
    start = loop.plant.measure().q
    for _ in range(round(1.0 / DT)):
        held.step(torque, DT)
    for _ in loop.rest(1.0):
        pass
    assert _apart(loop.true.model, start, held.measure().q) > 20.0
    assert _apart(loop.true.model, start, loop.plant.measure().q) < 3.0


def test_the_safe_torque_needs_no_measurement_at_all(moving):
    """The returned state is a new one, with the same estimates and counters."""
    loop = copy.deepcopy(moving)
    before = loop.state
    torque, state = loop.controller.safe(before)
    assert np.isfinite(torque).all() and state.t == before.t + DT
    assert np.array_equal(state.flat(), before.flat()) and state.bridged == before.bridged
    slower = [np.abs(state.sensed.v).max()]
    for _ in range(100):
        _, state = loop.controller.safe(state)
        slower.append(np.abs(state.sensed.v).max())
    assert slower[-1] < 0.01 * slower[0] and (np.diff(slower) <= 0.0).all()
    for wrong in (-1.0, math.nan):
        with pytest.raises(pa.InputError, match="damping"):
            loop.controller.safe(state, damping=wrong)


@pytest.mark.parametrize(("lost", "rests"), [("x", True), ("v", True), ("qv", False)])
def test_a_run_brings_an_arm_to_rest_or_leaves_it_to_its_own_stop(lost, rests):
    robot = pa.load("planar_2r", gravity=[0.0, -9.81, 0.0])
    truth = pa.plants.PinocchioPlant(robot)
    sent = []

    class Arm(pa.plants.Plant):
        """A plant not marked as simulated; from 0.3 s on some measurements are NaN."""

        def reset(self):
            truth.reset()

        def measure(self):
            m = truth.measure()
            bad = {name: math.nan * getattr(m, name) for name in lost} if m.t > 0.3 else {}
            return m._replace(**bad)

        def step(self, torque, dt):
            sent.append(truth.measure().t)
            truth.step(torque, dt)

    controller = pa.make_controller(robot, dt=DT, adaptation="natural")
    path = pa.reachable_circle(robot)
    with pytest.raises(pa.PinadaptError, match=r"is not finite|exceed"):
        list(pa.run(Arm(), controller, path, dt=DT, duration=1.0))
    still = np.abs(truth.measure().v).max() < 0.02
    assert still == rests and sent[-1] > 0.3 + 0.01 and (rests or sent[-1] < 0.3 + 0.02)
