"""After a refused sample, ``Controller.safe`` rests the arm on what can be believed, or says so."""

import copy
import math

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.lying_sensors import _apart

DT = 2e-3


def test_the_safe_torque_holds_an_arm_that_the_last_torque_moves_far(moving):
    """What used to be the advice after a refused sample."""
    loop = copy.deepcopy(moving[0][False])
    _, torque = next(iter(loop.samples(DT)))
    held, start = copy.deepcopy(loop.plant), loop.plant.measure().q
    for _ in range(round(1.0 / DT)):
        held.step(torque, DT)
    for _ in loop.rest(1.0):
        pass
    assert _apart(loop.true.model, start, held.measure().q) > 20.0
    assert _apart(loop.true.model, start, loop.plant.measure().q) < 3.0


def test_the_safe_torque_needs_no_measurement_at_all(moving):
    """The returned state is a new one, with the same estimates and counters."""
    loop = copy.deepcopy(moving[0][False])
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


@pytest.mark.parametrize(
    "fault", ["v not a number", "q of a joint not a number", "q not a number", "x not given"]
)
def test_any_part_of_q_and_v_suffices_to_rest_the_arm(moving, fault):
    loop = moving[0][False].lying(fault)
    start, drift = loop.plant.measure().q, 0.0
    for truth in loop.rest(0.8):
        drift = max(drift, _apart(loop.true.model, start, truth.q))
        assert not loop.state.unseen.any()
    assert drift < 1.0 and np.abs(truth.v).max() < 0.01


@pytest.mark.parametrize(
    ("lost", "said"),
    [("nothing comes", [True] * 6), ("a joint", [True] + [False] * 5)],
)
def test_unmeasured_joints_need_brakes_after_15_ms(moving, lost, said):
    """The joint is no longer reported once it is measured again."""
    loop = moving[0][False]
    first, state, after = loop.sample, loop.state, []
    blind = np.where(said, math.nan, 1.0)
    for k in range(1, 12):
        seen = first._replace(t=state.t + DT, q=first.q + k * DT * first.v)
        sample = seen._replace(q=seen.q * blind, v=seen.v * blind)
        _, state = loop.controller.safe(state, None if lost == "nothing comes" else sample)
        after.append(state.unseen)
    assert [each.any() for each in after] == 8 * [False] + 3 * [True]
    assert after[-1].tolist() == said
    seen = seen._replace(t=state.t + DT, q=seen.q + DT * first.v)
    assert not loop.controller.safe(state, seen)[1].unseen.any()


def test_without_guards_no_joint_is_reported_as_unseen():
    robot = pa.load("planar_2r")
    controller = pa.make_controller(robot, adaptation="natural", limits=pa.Limits(guards=False))
    state = controller.init(pa.plants.PinocchioPlant(robot).measure())
    for _ in range(30):
        _, state = controller.safe(state)
    assert not state.unseen.any() and state.unseen.size == 2


@pytest.mark.parametrize(("lost", "rests"), [("x", True), ("v", True), ("qv", False)])
def test_a_run_brings_an_arm_to_rest_or_leaves_it_to_its_own_stop(lost, rests):
    robot = pa.load("planar_2r", gravity=[0.0, -9.81, 0.0])
    truth, sent = pa.plants.PinocchioPlant(robot), []

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
