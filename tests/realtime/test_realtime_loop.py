"""The loop on an arm: stages, phases, late cycles, signals, faults of drivers."""

import copy
import dataclasses
import gc
import itertools
import os
import re
import signal
import time

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.exceptions import ArmError
from pinadapt.realtime import (
    ArmFacts,
    PlantArm,
    RealtimeLoop,
    Safety,
    Scheduling,
    Stage,
    realtime_loop,
)
from pinadapt.realtime.realtime_loop import Histogram
from tests.support.arms import (
    ORDINARY,
    PERIOD,
    Loop,
    arm,
    circle,
    controller,
    faulty,
    heavy,
    robot,
)

OUT = ["running", "holding", "damping", "stopped"]


def moved(loop):
    """Return how far the arm is from its home [rad]."""
    return float(np.abs(loop.arm.plant.measure().q - robot().q0).max())


# --- stages ---


def test_log_only_computes_torques_and_sends_none():
    loop = Loop(faulty(None), "log")
    ending = loop.ended()
    assert loop.arm.sent == [] and ending.step.count > 75 and not ending.failed
    assert loop.phases == ["running", "stopped"] and moved(loop) == 0.0


def test_in_unknown_axes_the_joints_are_held():
    """Turned by 180 degrees against the description, the feedback of x would drive the arm away."""
    true = heavy().changed(tool_translation=[0.03, 0.02, 0.0]).seen_from([0.0, 0.0, np.pi])
    unknown = controller(unknown=pa.Unknown(tracker=True))
    described = unknown.kinematics.initial_at(true.q0, true.position(true.q0))
    for start, held in ((None, True), ({"a_k": described}, False)):
        loop = Loop(arm(true), "hold", 0.2, of=unknown, start=start)
        ending = loop.ended()
        assert (moved(loop) < 0.01) is held
        waits = ending.state.path is not None and ending.state.path.cause == "unknown axes"
        assert waits is held


def test_without_adaptation_a_motion_in_unknown_axes_is_refused():
    unknown = controller(unknown=pa.Unknown(tracker=True))
    with pytest.raises(pa.InputError, match="without adaptation"):
        Loop(stage="slow", of=unknown)
    Loop(stage="slow", of=unknown, start={"a_k": unknown.kinematics.initial})


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


def test_gravity_compensation_holds_what_was_learned():
    dynamics = controller().dynamics
    a_d = np.where(dynamics.initial > 0.0, dynamics.initial, dynamics.value(heavy()))
    bodies = dynamics.inertial.size
    a_d[:bodies] = dynamics.value(heavy())[:bodies]
    for start, holds in (({"a_d": a_d}, True), ({}, False)):
        loop = Loop(arm(heavy()), "gravity", 0.2, start=start)
        loop.ended()
        assert (moved(loop) < 1e-3) is holds


def test_a_hold_stays_and_does_not_learn():
    loop = Loop(arm(robot()), "hold")
    ending = loop.ended()
    assert moved(loop) < 1e-4 and loop.phases == OUT
    assert np.array_equal(ending.state.a_d, controller().dynamics.initial)


def test_a_slow_motion_is_the_motion_and_slower():
    slow, quick = (Loop(arm(robot()), stage, 0.3) for stage in ("slow", "adapt"))
    slow.ended(), quick.ended()
    assert 0.0 < moved(slow) < 0.5 * moved(quick)


def test_adaptation_learns_the_load():
    loop = Loop(stage="adapt", seconds=1.5)
    ending = loop.ended()
    truth = controller().dynamics.value(heavy())
    before = np.abs(controller().dynamics.initial - truth).max()
    assert np.abs(ending.state.a_d - truth).max() < before
    assert "adapt" in ending.phases[0][2] and "the time is over" in str(ending)


def test_the_stages_are_checked():
    with pytest.raises(pa.InputError, match="must be one of log, gravity, hold, slow, adapt"):
        Loop(stage="fly")
    assert [stage.value for stage in Stage] == ["log", "gravity", "hold", "slow", "adapt"]


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
    assert "late: 10 cycles in a short while were late" in ending.reason
    assert np.abs(loop.arm.plant.measure().v).max() < 1e-2


def test_a_very_late_cycle_damps_at_once():
    loop = Loop(faulty(late(15)))
    assert "15 periods" in loop.ended().reason and loop.phases == ["running", "damping", "stopped"]


class Wall(PlantArm):
    """An arm on the wall clock of ``Time``, whose own time goes on by a period whatever happens."""

    clock, took = None, staticmethod(lambda count: PERIOD)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.facts = dataclasses.replace(self.facts, clock="arm")
        self.count, self.due = 0, 0.0

    def read(self):
        self.count += 1
        self.due += self.took(self.count)
        self.clock.now = max(self.clock.now, self.due)
        return super().read()


@pytest.mark.parametrize(
    ("took", "phases", "words"),
    [
        (lambda count: PERIOD, OUT, "the time is over"),
        (lambda count: PERIOD * (4.0 if count % 100 == 0 else 0.97), OUT, "the time is over"),
        (
            lambda count: 3.0 if count == 80 else PERIOD,
            ["running", "damping", "stopped"],
            r"late: 3 s passed between two measurements, 750 periods; by the arm's clock 0\.004 s",
        ),
        (lambda count: 2.0 * PERIOD, OUT, "late: 10 cycles in a short while were late"),
    ],
)
def test_this_computers_clock_is_compared_with_the_period(took, phases, words, monkeypatch):
    clock = Time()
    monkeypatch.setattr(realtime_loop, "time", clock)
    on = arm(kind=Wall)
    on.clock, on.took = clock, took
    loop = Loop(on, "hold", 1.0)
    ending = loop.ended()
    late = sum(took(count) > 1.5 * PERIOD for count in range(1, on.count + 1))
    assert loop.phases == phases and re.match(words, ending.reason)
    assert ending.late == pytest.approx(late, abs=4)  # of which some reads came before the loop
    assert ending.arm_period.worst == pytest.approx(PERIOD)
    assert ending.period.worst == pytest.approx(max(map(took, range(5, on.count))), abs=1e-3)
    assert "period, here" in str(ending) and "period, arm" in str(ending)


def test_a_simulated_arm_takes_any_time(monkeypatch):
    clock = Time()
    monkeypatch.setattr(realtime_loop, "time", clock)
    on = arm(kind=Wall)
    on.clock, on.took = clock, lambda count: 5.0
    on.facts = arm().facts
    ending = Loop(on, "hold").ended()
    assert on.facts.clock == "simulated" and not ending.failed and ending.late == 0


def test_torques_that_do_not_reach_the_arm_hold_it():
    class Deaf(PlantArm):
        def read(self):
            self.received = 0.98 if self._count < 75 else 0.6
            return super().read()

    loop = Loop(arm(kind=Deaf), "hold")
    ending = loop.ended()
    assert loop.phases == OUT and ending.failed and ending.received == 0.6
    assert ending.reason == "commands: the arm has received 60% of the last torques, least 90%"
    assert "at least 60% of the last torques" in str(ending)
    silent = Loop().ended()
    assert np.isnan(silent.received) and "received" not in str(silent)


def test_a_histogram_has_the_shares_of_its_times():
    times = np.random.default_rng(1).exponential(2e-4, 5000)
    histogram = Histogram()
    for each in times:
        histogram.add(each)
    for share in (0.5, 0.99, 0.999):
        assert histogram.share(share) == pytest.approx(np.quantile(times, share), abs=3e-5)
    assert histogram.worst == times.max() and histogram.above(1e-3) == (times >= 1e-3).sum()
    histogram.add(3.0)
    assert histogram.row()[-1] == "3000000"


def test_an_arm_without_a_cycle_is_paced_by_deadlines():
    """The plant follows the clock, so measurements would reveal a loop that drifts."""
    follower = arm(clock=time.monotonic)
    began = time.monotonic()
    loop = Loop(follower, seconds=0.2, safety=Safety(late=10**6))
    ending = loop.ended()
    assert not follower.facts.paced and 0.2 < time.monotonic() - began < 20.0
    assert ending.cycles <= (ending.phases[-1][0]) / PERIOD + 3


class Time:
    """A clock that advances by 10 us when it is read, and by sleeping."""

    now = 0.0

    def perf_counter(self):
        self.now += 1e-5
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.mark.parametrize("waits", [True, False])
def test_a_step_is_rehearsed_while_the_loop_waits_and_changes_nothing(waits, monkeypatch):
    """An arm that does not wait for the clock leaves no time for it."""
    clock, kept, of = Time(), [], copy.deepcopy(controller())
    step = of.step

    def kept_step(state, m, desired, dt):
        found = step(state, m, desired, dt)
        kept.append((state, m, desired, found[0]))
        return found

    monkeypatch.setattr(realtime_loop, "time", clock)
    monkeypatch.setattr(of, "step", kept_step)
    options = {"clock": lambda: clock.now} if waits else {}
    Loop(arm(**options), of=of, seconds=0.2).ended()
    pairs = list(itertools.pairwise(kept[60:]))  # after those by which all code has run
    rehearsed = [pair for pair in pairs if pair[0][0] is pair[1][0]]
    assert (len(rehearsed) > 0.45 * len(pairs)) is waits and (waits or not rehearsed)
    for (_, before, _, _), (state, m, desired, torque) in rehearsed:
        assert before.t == pytest.approx(m.t) and np.abs(before.q - m.q).max() < 1e-4
        assert np.array_equal(step(state, m, desired, PERIOD)[0], torque)


def test_denied_system_settings_are_reported(monkeypatch):
    def refused(*arguments):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused, raising=False)
    monkeypatch.setattr(os, "sched_setaffinity", refused, raising=False)
    with Scheduling(80, 0, False).applied() as notes:
        assert len(notes) == 2 and "rtprio" in notes[0] and "core 0" in notes[1]


def test_the_scheduling_is_restored():
    before = os.sched_getaffinity(0), os.sched_getscheduler(0)
    with Scheduling(1, min(before[0]), False).applied():
        assert os.sched_getaffinity(0) == {min(before[0])}
    assert (os.sched_getaffinity(0), os.sched_getscheduler(0)) == before


def test_the_loop_disables_and_restores_the_garbage_collector():
    seen, frozen = [], gc.get_freeze_count()
    Loop(faulty(lambda arm, m: seen.append(gc.isenabled()) or m)).ended()
    assert not any(seen) and gc.isenabled()
    assert frozen - 100 < gc.get_freeze_count() <= frozen  # a few may have died meanwhile
    gc.disable()
    try:
        Loop(seconds=0.02).ended()
        assert not gc.isenabled()
    finally:
        gc.enable()


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
        ("slow", (0,), OUT),
        ("adapt", (0,), OUT),
        ("adapt", (0, 5), OUT),  # the second one while it holds
        ("adapt", (0, 5, 10), OUT),  # the third one while it is damped
    ],
)
def test_an_interrupt_in_each_state_ends_in_rest(stage, cycles, phases):
    before = signal.getsignal(signal.SIGINT)
    loop = Loop(faulty(interrupts(*cycles)), stage, seconds=9.0)
    ending = loop.ended()
    assert loop.phases == phases and "interrupt" in ending.reason and not ending.failed
    assert np.abs(loop.arm.plant.measure().v).max() < 1e-2
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_before_the_first_cycle_is_one(monkeypatch):
    loop = Loop(faulty(interrupts(0), at=1))
    with pytest.raises(KeyboardInterrupt), loop.arm:
        loop.run()
    assert loop.arm.stopped and not loop.arm.sent


# --- faults of drivers ---


def broken(arm, m):
    raise ArmError("the connection broke: reset by peer.", where="arm")


def with_nan(arm, m):
    return m._replace(v=m.v * np.nan)


def back_in_time(arm, m):
    return m._replace(t=m.t - 0.5)


def frozen(arm, m):
    arm.last = getattr(arm, "last", m)
    return arm.last


def test_nonsense_from_a_camera_is_reported():
    nonsense = faulty(lambda arm, m: m._replace(x=m.x * np.nan))
    loop = Loop(nonsense, seconds=9.0)
    ending = loop.ended()
    assert ending.failed and loop.phases == ["running", "damping", "stopped"]
    assert "controller: measurement 'x' is not finite" in ending.reason


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (broken, "the connection broke"),
        (with_nan, "driver: measurement 'v' is not finite"),
        (back_in_time, r"clock: the time jumped back by 0\.496 s"),
        (frozen, "stale data: the last 4 measurements are of the same instant"),
    ],
)
@pytest.mark.parametrize("stage", ["log", "gravity", "adapt"])
def test_a_driver_that_fails_in_mid_motion_stops_the_arm(fault, words, stage):
    loop = Loop(faulty(fault), stage, seconds=9.0, safety=Safety(stale=3))
    ending = loop.ended()
    assert ending.failed and loop.phases[-1] == "stopped"
    assert pytest.approx(0.0, abs=1e-2) == np.abs(loop.arm.plant.measure().v).max()
    assert re.search(words, ending.reason)


def stuck(later):
    """Return a fault: the first joint's encoder stops, and its v is zero, then or at once."""

    def fault(arm, m):
        arm.last = getattr(arm, "last", m)
        if later and m is arm.last:
            return m
        q, v = m.q.copy(), m.v.copy()
        q[0], v[0] = arm.last.q[0], 0.0
        return m._replace(q=q, v=v)

    return fault


@pytest.mark.parametrize(
    ("later", "at", "soon", "said"),
    [
        (
            True,
            175,
            0.02,
            "unseen: neither q nor v of joint1 is measured any more; it needs brakes",
        ),
        (False, 150, 1.6, r"contact: \S+ N m at joint1 that the model does not explain"),
    ],
)
def test_an_arm_with_unmeasured_joints_is_left_to_its_brakes(later, at, soon, said):
    """In the second case the encoder seems to be that of a joint that stands, against a torque."""
    loop = Loop(faulty(stuck(later), at=at), "adapt", seconds=9.0)
    ending = loop.ended()
    (damped, _, _), (stopped, _, why) = ending.phases[-2:]
    assert ending.failed and loop.phases == ["running", "damping", "stopped"]
    assert re.fullmatch(said, why) and stopped - damped < soon
    assert pytest.approx(0.0, abs=1e-2) == np.abs(loop.arm.plant.measure().v).max()


def test_an_arm_in_error_refuses_before_anything_moves():
    class InError(PlantArm):
        def begin(self):
            raise ArmError("is in error: joint limit.", where="arm", hint="Move it by hand.")

    loop = Loop(arm(kind=InError))
    with pytest.raises(ArmError, match="joint limit"), loop.arm:
        loop.run()
    assert loop.loop.ending.failed and moved(loop) == 0.0


def test_engaged_brakes_are_detected():
    class Braked(PlantArm):
        def send(self, torque):
            super().send(torque)
            self._sent = None  # it does not move

        def begin(self):
            self.plant.step = lambda torque, dt: None

    ending = Loop(arm(kind=Braked), seconds=3.0).ended()
    assert ending.failed and ending.phases[-1][0] < 2.9
    words = r"torque: joint\d at its limit for 0\.3 s; brakes, or a heavy load\?"
    assert re.fullmatch(words, ending.reason)


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"joints": ("a", "b", "c"), "torque": 9.0, "velocity": 9.0}, "3 joints .* robot 2"),
        ({"side": "motor"}, "before its gears"),
        ({"period": 1e-3}, "made for 0.004 s"),
        ({"compensation": lambda q: 0.0 * q}, 'adds its gravity .*compensated="nominal"'),
    ],
)
def test_an_arm_that_does_not_match_the_controller_is_refused(facts, words):
    other = arm()
    other.facts = ArmFacts.of(robot(), **{"period": PERIOD, **facts})
    with pytest.raises(pa.InputError, match=words):
        RealtimeLoop(other, controller(), circle(), scheduling=ORDINARY)


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


def test_a_missing_camera_is_reported():
    class Blind(PlantArm):
        def read(self):
            return super().read()._replace(x=None, xd=None)

    with pytest.raises(ArmError, match="no position of the task frame came for 2 s"):
        Loop(arm(kind=Blind)).ended()


def test_torques_change_at_most_at_their_rate():
    loop = Loop(faulty(None), safety=Safety(torque_rate=50.0))
    loop.ended()
    changes = [np.abs(b - a).max() for a, b in itertools.pairwise(loop.arm.sent)]
    assert 0.0 < max(changes) <= 50.0 * PERIOD * (1.0 + 1e-9)


@pytest.mark.parametrize("ratio", [20.0, -50.0, np.nan])
def test_a_driver_that_writes_into_what_it_gets_changes_no_later_torque(ratio):
    class Scaling(PlantArm):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.got = []

        def send(self, torque):
            self.got.append(torque.copy())
            super().send(torque)
            torque *= ratio

    def run(kind):
        loop = Loop(arm(robot(), kind), "hold", of=controller(), safety=Safety(torque_rate=100.0))
        loop.ended()
        return loop

    scaled = run(Scaling)
    got, limits = np.array(scaled.arm.got), scaled.loop._checks.limit
    assert len(got) > 100 and (np.abs(got) <= limits).all()
    assert np.abs(np.diff(got, axis=0)).max() <= 100.0 * PERIOD * (1.0 + 1e-9)
    assert moved(scaled) == moved(run(PlantArm))


class Writing(pa.plants.PinocchioPlant):
    """A plant that writes into its torque once it has moved."""

    def step(self, torque, dt):
        super().step(torque, dt)
        torque[:] = np.nan


def test_a_plant_that_writes_into_its_torque_changes_no_other():
    now, on = [0.0], PlantArm(Writing(robot()), PERIOD, clock=lambda: now[0])
    on.read()
    torque = np.array([1.0, -2.0])
    on.send(torque)
    for periods in (1, 3):
        now[0] += periods * PERIOD
        assert np.isfinite(on.read().q).all() and torque.tolist() == [1.0, -2.0]
    of = controller(limits=pa.Limits())
    samples = list(itertools.islice(pa.run(Writing(robot()), of, circle(), dt=PERIOD), 5))
    assert np.isfinite([sample.torque for sample in samples]).all()


def test_two_loops_do_not_drive_one_arm():
    refused, on = [], faulty(None)

    def second(arm, m):
        if arm.cycle == arm.at:
            with pytest.raises(
                ArmError, match=r"planar_2r: is driven by another loop\. Let that end"
            ):
                RealtimeLoop(arm, controller(), circle(), scheduling=ORDINARY).run(0.1)
            refused.append(arm.cycle)
        return m

    on.fault = second
    assert not Loop(on, "hold").ended().failed and refused == [75]
    once_more = arm()
    for _ in range(2):
        assert not Loop(once_more, "log", 0.02).run().failed
        once_more.stopped = ""  # as if it were switched on again


def test_lists_and_integers_from_a_driver_are_numbers():
    def listed(arm, m):
        return m._replace(t=np.float32(m.t), q=m.q.tolist(), v=tuple(m.v), x=m.x.tolist())

    assert not Loop(faulty(listed, at=1)).ended().failed


NONSENSE = {
    "nothing": (lambda m: None, "`read` returned None; expected a pinadapt.Measurement"),
    "a tuple": (lambda m: (m.t, m.q, m.v), r"`read` returned \(.*expected a pinadapt.Measurement"),
    "no q": (lambda m: m._replace(q=None), "measurement 'q': expected 2 numbers, got None"),
    "short q": (lambda m: m._replace(q=m.q[:1]), "measurement 'q': expected 2 numbers, got"),
    "complex v": (lambda m: m._replace(v=m.v * 1j), "measurement 'v': expected 2 numbers, got"),
    "text": (lambda m: m._replace(q=["1.0", "2.0"]), "measurement 'q': expected 2 numbers, got"),
    "ragged": (lambda m: m._replace(v=[[1.0], [1.0, 2.0]]), "measurement 'v': expected 2 numbers"),
    "infinite q": (lambda m: m._replace(q=m.q * np.inf), "measurement 'q' is not finite"),
    "no time": (lambda m: m._replace(t=None), "measurement 't': expected a time, got None"),
    "time nan": (lambda m: m._replace(t=np.nan), "measurement 't': expected a time, got nan"),
    "long x": (lambda m: m._replace(x=np.zeros(5)), "measurement 'x': expected 2 numbers"),
    "text x_time": (lambda m: m._replace(x_time="now"), "measurement 'x_time': expected a time"),
    "short tau": (lambda m: m._replace(tau=np.zeros(1)), "measurement 'tau': expected 2 numbers"),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_from_a_driver_ends_the_loop_damped_and_says_what_it_was(name):
    fault, words = NONSENSE[name]

    def once(arm, m):
        return fault(m) if arm.cycle == arm.at else m

    lasting = Loop(faulty(lambda arm, m: fault(m)), seconds=9.0)
    for loop in (Loop(faulty(once), seconds=9.0), lasting):
        ending = loop.ended()
        assert re.match(f"driver: {words}", ending.reason)
        assert ending.failed and loop.phases == ["running", "damping", "stopped"]
        assert np.isfinite(loop.arm.sent).all()
        assert np.abs(loop.arm.plant.measure().v).max() < 1e-2
    first = Loop(faulty(lambda arm, m: fault(m), at=1))
    with pytest.raises(ArmError, match=f"planar_2r: {words}"), first.arm:
        first.run()
    assert not first.arm.sent


def test_a_torque_that_is_not_finite_is_not_sent():
    loop = Loop(faulty(None), "gravity")
    loop.loop._safe = lambda *given, **options: np.array([np.nan, 0.0])
    ending = loop.ended()
    assert ending.failed and ending.reason == "controller: a torque is not finite"
    assert loop.phases == ["running", "stopped"] and not loop.arm.sent
