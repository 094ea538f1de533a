"""The loop on an arm: stages, phases, late cycles, signals, faults of drivers."""

import itertools
import re
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.exceptions import ArmError
from pinadapt.realtime import PlantArm, Safety
from tests.support.arms import (
    PERIOD,
    Loop,
    arm,
    controller,
    faulty,
    heavy,
    robot,
)
from tests.support.chains import catalogue_robot

OUT = ["running", "holding", "damping", "stopped"]


def rests(loop):
    """Return whether the arm was damped until it rested."""
    return np.abs(loop.arm.plant.measure().v).max() < 0.03


def moved(loop):
    """Return how far the arm is from its home [rad]."""
    return float(np.abs(loop.arm.plant.measure().q - robot().q0).max())


# --- stages ---


def test_log_only_computes_torques_and_sends_none():
    loop = Loop(faulty(None), "log")
    ending = loop.ended()
    assert loop.arm.sent == [] and ending.step.total() > 75 and not ending.failed
    assert loop.phases == ["running", "stopped"] and moved(loop) == 0.0


def test_gravity_compensation_lets_the_arm_be_moved_by_hand():
    """A push moves it on, and with the right model it neither falls nor returns."""

    class Pushed(PlantArm):
        def send(self, torque):
            push = 0.5 if 25 < self._count < 50 else 0.0
            super().send(torque + np.array([push, 0.0]))

    loop = Loop(arm(robot(), Pushed), "gravity", 0.5)
    loop.ended()
    assert loop.phases == ["running", "damping", "stopped"]
    assert moved(loop) > 0.005


def test_adaptation_learns_the_load():
    loop = Loop(stage="adapt", seconds=1.5)
    ending = loop.ended()
    truth = controller().dynamics.value(heavy())
    before = np.abs(controller().dynamics.initial - truth).max()
    assert np.abs(ending.state.a_d - truth).max() < before
    assert "adapt" in ending.phases[0][2] and "the time is over" in str(ending)


def test_a_motion_without_a_place_begins_where_the_arm_is():
    loop = Loop(motion=pa.trajectories.Circle(radius=0.05), seconds=1.0)
    loop.ended()
    assert np.linalg.norm(loop.arm.plant.measure().x - robot().position(robot().q0)) < 0.11


def test_the_null_space_stays_where_the_arm_begins():
    """Joint 7 of this arm turns about the axis of its flange."""
    described = catalogue_robot("panda")
    q0 = described.q0 + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    plant = pa.plants.PinocchioPlant(replace(described, q0=q0))
    of = pa.make_controller(described, dt=PERIOD)
    loop = Loop(PlantArm(plant, PERIOD), "hold", of=of, motion=pa.trajectories.Hold())
    loop.ended()
    assert np.abs(plant.measure().q - q0).max() < 1e-9


def test_an_arm_with_its_joints_in_another_order_is_refused():
    own = arm()
    own.facts = replace(own.facts, joints=own.facts.joints[::-1])
    with pytest.raises(pa.InputError, match="order of joints"):
        Loop(own, stage="hold").ended()


def test_a_refused_motion_or_load_leaves_those_before():
    loop = Loop(stage="hold")
    loop.ended()
    loop = loop.loop
    loop._halted = True
    path = loop._path
    with pytest.raises(pa.InputError, match="reference: expected a Trajectory"):
        loop._command("reference", {"kind": "circle"})
    before = loop._state
    with pytest.raises(pa.InputError, match="load: the motors cannot hold"):
        loop._command("load", {"mass": 1500.0})  # grams
    assert loop._path is path and loop._state is before


def test_a_loop_runs_once_and_a_motion_that_fails_damps_the_arm():
    home = robot().position(robot().q0)
    motion = pa.trajectories.Hold(home).as_given()
    motion.at = lambda t: pa.trajectories.Hold(home).at(t) if t < 0.1 else 1 / 0
    loop = Loop(motion=motion)
    loop.ended()
    assert "damping" in loop.phases and "ZeroDivisionError" in " ".join(loop.said)
    with pytest.raises(pa.InputError, match="loop: has run"):
        loop.run()


# --- lateness ---


def late(periods, cycles=1):
    """Return a fault: some cycles in a row take several periods."""

    def fault(arm, m):
        if arm.cycle < arm.at + cycles:
            for _ in range(periods - 1):
                m = PlantArm.read(arm)
        return m

    return fault


def test_a_late_cycle_is_computed_with_its_duration():
    loop = Loop(faulty(late(4)))
    ending = loop.ended()
    assert ending.late == 1 and not ending.failed


def test_many_late_cycles_hold_damp_and_stop_in_this_order():
    loop = Loop(faulty(late(3, cycles=10**6)), seconds=9.0)
    ending = loop.ended()
    assert loop.phases == OUT and ending.failed
    assert "late: too many cycles in a short while were late" in ending.reason
    assert rests(loop)


def test_torques_that_do_not_reach_the_arm_hold_it():
    class Deaf(PlantArm):
        def read(self):
            self.received = 0.98 if self._count < 75 else 0.6
            return super().read()

    loop = Loop(arm(kind=Deaf), "hold")
    ending = loop.ended()
    assert loop.phases == OUT and ending.failed
    assert ending.reason.startswith("commands: 40% of the last torques")


def test_a_read_that_hangs_damps_the_arm_by_the_clock_of_this_computer():
    """By its own clock it takes one period."""
    on = faulty(lambda arm, m: time.sleep(11.0 * PERIOD * (arm.cycle == 20)) or m, at=20)
    on.facts = replace(on.facts, clock="arm")
    loop = Loop(on, safety=Safety(late=10**6))
    assert loop.ended().failed and loop.phases == ["running", "damping", "stopped"]
    assert re.match(r"late: \d+\.?\d* periods passed", loop.loop.result.reason)


def test_two_loops_on_one_arm_are_refused():
    def fault(arm, m):
        if arm.cycle == arm.at:
            with pytest.raises(ArmError, match="is driven by another loop"):
                Loop(arm, "hold").run()
        return m

    assert not Loop(faulty(fault), "hold").ended().failed


def test_an_arm_without_a_cycle_is_paced_by_deadlines():
    """The plant moves by a period in each cycle, of which the clock allows no more."""
    follower = arm()
    follower.facts = replace(follower.facts, paced=False)
    began = time.monotonic()
    loop = Loop(follower, seconds=0.2, safety=Safety(late=10**6))
    ending = loop.ended()
    assert not follower.facts.paced and 0.2 < time.monotonic() - began < 20.0
    assert ending.cycles <= (ending.phases[-1][0]) / PERIOD + 3


# --- signals ---


def interrupts(*cycles):
    """Return a fault: Ctrl-C at some cycles after the first."""

    def fault(arm, m):
        if arm.cycle - arm.at in cycles:
            signal.raise_signal(signal.SIGINT)
        return m

    return fault


@pytest.mark.parametrize(
    ("stage", "cycles", "phases"),
    [
        ("log", (0,), ["running", "stopped"]),
        ("gravity", (0,), ["running", "damping", "stopped"]),
        ("hold", (0,), OUT),
        ("adapt", (0, 5), OUT),  # the second one while it holds
        ("adapt", (0, 5, 10), OUT),  # the third one while it is damped
    ],
)
def test_an_interrupt_in_each_state_ends_in_rest(stage, cycles, phases):
    before = signal.getsignal(signal.SIGINT)
    loop = Loop(faulty(interrupts(*cycles)), stage, seconds=9.0)
    ending = loop.ended()
    assert loop.phases == phases and "interrupt" in ending.reason and not ending.failed
    assert rests(loop) or cycles[-1] == 10  # by the arm's own stop
    assert signal.getsignal(signal.SIGINT) is before


# --- faults of drivers ---


def broken(arm, m):
    raise ArmError("the connection broke: reset by peer.", where="arm")


def with_nan_frames(arm, m):
    return m._replace(x=m.x * np.nan)


def back_in_time(arm, m):
    return m._replace(t=m.t - 0.5)


def frozen(arm, m):
    arm.last = getattr(arm, "last", m)
    return arm.last


@pytest.mark.parametrize(
    ("fault", "words", "stage"),
    [
        (broken, "the connection broke", "log"),
        (broken, "the connection broke", "adapt"),
        (with_nan_frames, "driver: measurement 'x' is not finite", "adapt"),
        (back_in_time, r"clock: the time jumped back by 0\.496 s", "gravity"),
        (frozen, "stale data: the last 4 measurements are of the same instant", "adapt"),
    ],
)
def test_a_driver_that_fails_in_mid_motion_stops_the_arm(fault, words, stage):
    loop = Loop(faulty(fault), stage, seconds=9.0, safety=Safety(stale=3))
    ending = loop.ended()
    assert ending.failed and loop.phases[-1] == "stopped"
    assert rests(loop) or fault is broken  # which leaves it to the arm's own stop
    assert re.search(words, ending.reason)


def test_an_arm_in_error_refuses_before_anything_moves():
    class InError(PlantArm):
        def begin(self):
            raise ArmError("is in error: joint limit.", where="arm", hint="Move it by hand.")

    loop = Loop(arm(kind=InError))
    with pytest.raises(ArmError, match="joint limit"), loop.arm:
        loop.run()
    assert loop.loop.result.failed and moved(loop) == 0.0


def test_an_arm_that_compensates_gravity_is_sent_the_difference():
    plant = pa.plants.PinocchioPlant(robot(), compensation=pa.robot.Gravity(robot()))
    sent = []

    class Listening(PlantArm):
        def send(self, torque):
            sent.append(torque)
            super().send(torque)

    compensated = controller(compensated="nominal")
    loop = Loop(Listening(plant, PERIOD), "hold", 0.1, of=compensated)
    loop.ended()
    assert np.abs(sent[:20]).max() < 1e-6 and moved(loop) < 1e-6


def test_torques_change_at_most_at_their_rate():
    loop = Loop(faulty(None), safety=Safety(torque_rate=50.0))
    loop.ended()
    changes = [np.abs(b - a).max() for a, b in itertools.pairwise(loop.arm.sent)]
    assert 0.0 < max(changes) <= 50.0 * PERIOD * (1.0 + 1e-9)


NONSENSE = {
    "nothing": (lambda m: None, "expected a Measurement, got None"),
    "a tuple": (lambda m: (m.t, m.q, m.v), "expected a Measurement"),
    "no q": (lambda m: m._replace(q=None), "measurement 'q' must be 2 numbers"),
    "short q": (lambda m: m._replace(q=m.q[:1]), "measurement 'q' must be 2 numbers"),
    "complex v": (lambda m: m._replace(v=m.v * 1j), "measurement 'v' must be 2 numbers"),
    "text": (lambda m: m._replace(q=["1.0", "2.0"]), "measurement 'q' must be 2 numbers"),
    "ragged": (lambda m: m._replace(v=[[1.0], [1.0, 2.0]]), "measurement 'v' must be 2 numbers"),
    "infinite q": (lambda m: m._replace(q=m.q * np.inf), "measurement 'q' is not finite"),
    "time nan": (lambda m: m._replace(t=np.nan), "measurement 't' is not finite"),
    "long x": (lambda m: m._replace(x=np.zeros(5)), "measurement 'x' must be 2 numbers"),
    "text x_time": (lambda m: m._replace(x_time="now"), "measurement 'x_time' is not finite"),
    "short tau": (lambda m: m._replace(tau=np.zeros(1)), "measurement 'tau' must be 2 numbers"),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_from_a_driver_is_named_before_anything_moves(name):
    fault, words = NONSENSE[name]
    loop = Loop(faulty(lambda arm, m: fault(m), at=1))
    with pytest.raises(ArmError, match=words), loop.arm:
        loop.run()
    assert not loop.arm.sent


@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize("name", ["no q", "infinite q"])
def test_nonsense_from_a_driver_ends_the_loop_damped_and_says_what_it_was(name, lasting):
    fault, words = NONSENSE[name]
    on = faulty(lambda arm, m: fault(m) if lasting or arm.cycle == arm.at else m)
    loop = Loop(on, seconds=9.0)
    ending = loop.ended()
    assert re.match(f"driver: {words}", ending.reason)
    assert ending.failed and loop.phases == ["running", "damping", "stopped"]
    assert np.isfinite(loop.arm.sent).all() and (rests(loop) or (name, lasting) == ("no q", True))


@pytest.mark.parametrize("name", ["no q", "short q", "complex v"])
def test_without_measurements_the_arm_is_braked_by_its_model_for_15_ms(name):
    seen = []
    gravity = pa.robot.Gravity(robot())
    on = faulty(lambda arm, m: seen.append(m) or NONSENSE[name][0](m), at=20, true=robot())
    assert Loop(on).ended().failed and len(seen) == 4
    for m, torque in zip(seen[1:3], on.sent[-2:], strict=True):  # the first changes by its rate
        assert ((torque - gravity(m.q)) * m.v).max() < 0.0


def test_measurements_that_fail_slowly_stop_the_arm_by_the_clock_of_this_computer():
    def fault(arm, m):
        time.sleep(2.0 * PERIOD)
        return m._replace(q=None)

    on = faulty(fault, at=20)
    on.facts = replace(on.facts, clock="arm")
    assert Loop(on).ended().failed and on.cycle <= 21  # not four periods


def test_a_torque_that_is_not_finite_is_not_sent():
    def fault(arm, m):
        loop.loop._safe = lambda *given, **options: np.array([np.nan, 0.0])
        return m

    loop = Loop(faulty(fault), "gravity")
    ending = loop.ended()
    assert ending.failed and ending.reason == "controller: a torque is not finite"
    assert loop.phases == ["running", "stopped"] and np.isfinite(loop.arm.sent).all()
