"""The log of every cycle, its replay, and commands and state for other processes.

The processes of arm and log are copies of the test's own, but where a loop is killed: as for users,
they are new ones there, as in ``tests/cli/test_drive.py``.
"""

import json
import os
import signal
import time
from functools import partial

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.realtime import (
    CycleLog,
    ProcessArm,
    RealtimeLoop,
    Recorder,
    Safety,
    tell,
)
from tests.support.arms import (
    ORDINARY,
    PERIOD,
    Loop,
    circle,
    controller,
    faulty,
    forking,
    heavy,
    robot,
)
from tests.support.processes import forked


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the log of a run with a camera, a load that is announced, and many commands."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    sensors = pa.Sensors(camera=pa.Camera(rate=50.0, delay=0.02))
    of = controller(sensors=sensors)
    answers = {}

    def at(cycle, m, arm):
        commands = {
            30: ("state", None),
            40: ("load", {"mass": 0.5}),
            60: ("hold", None),
            61: ("fly", None),
            130: ("go", None),  # the path comes to rest at 135
            140: ("reference", {"kind": "hold"}),
            150: ("adapt", False),
            160: ("frame", {"x": robot().position(m.q).tolist(), "age": 0.0}),
        }
        if cycle in commands:
            name, value = commands[cycle]
            try:
                answers[name] = tell(recorder.port, name, value, timeout=20.0)
            except pa.InputError as error:
                answers[name] = str(error)
        if cycle == 170:  # Ctrl-C, of which both processes hear
            os.kill(recorder.pid, signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        return m

    on = faulty(lambda arm, m: at(arm.cycle, m, arm), at=0, sensors=sensors)
    hold = pa.trajectories.Hold
    translate = {"reference": lambda table, m: hold(robot().position(m.q))}
    with (
        forking(),
        Recorder(path, of, port=0, translate=translate, about={"by": "test"}) as recorder,
    ):
        loop = Loop(on, of=of, seconds=60.0, recorder=recorder)
        ending = loop.ended()
    return path, of, loop, ending, answers


# --- the log ---


def test_every_cycle_is_in_the_log(run):
    path, _, loop, ending, _ = run
    assert any("go: not" in note and "before the path rests" in note for note in ending.notes)
    log = CycleLog.read(path)
    assert log.whole and len(log) == ending.cycles and log.about["by"] == "test"
    t = log.cycles.t
    assert np.allclose(np.diff(t), PERIOD) and log.about["robot"] == robot().name
    assert np.array_equal(log.cycles.sent[:-1], loop.arm.sent)
    phases = [event["phase"] for event in log.events if "phase" in event]
    held = ["running", "holding"]  # by a command, or for good
    assert phases == [*held, *held, "damping", "stopped"]
    assert ending.reason == "interrupt: Ctrl-C or a signal" and not ending.failed


def test_a_replay_gives_the_same_torques_bit_for_bit_and_those_of_another_controller(run):
    path, of, *_ = run
    log = CycleLog.read(path)
    found = log.replay(of)
    assert found.same and len(found.torque) > 200 and not found.difference.any()
    for other in (
        pa.make_controller(robot(), dt=PERIOD, adaptation="none", sensors=of.sensors),
        pa.make_controller(robot(), dt=PERIOD, adaptation="natural", Kv=5.0, sensors=of.sensors),
    ):
        found = log.replay(other)
        assert not found.same and (found.difference > 1e-3).any()
    with pytest.raises(pa.PinadaptError, match="expected 7 numbers"):
        log.replay(pa.make_controller(pa.load("panda"), adaptation="none"))


def test_mcap_reads_it(run):
    """Foxglove's own reader decodes every message by the definition that its topic carries."""
    reader = pytest.importorskip("mcap.reader", reason="mcap-ros2-support is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is missing")
    found = {}
    with run[0].open("rb") as file:
        made = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, message, decoded in made.iter_decoded_messages():
            found.setdefault((channel.topic, schema.name), []).append((message.log_time, decoded))
    cycles = CycleLog.read(run[0]).cycles
    events = CycleLog.read(run[0]).events
    rows = [decoded for _, decoded in found["/pinadapt/cycle", "pinadapt_msgs/msg/Cycle"]]
    for name in ("t", "q", "x_d", "asked", "residual", "a_d"):
        read = np.array([getattr(row, name) for row in rows]).reshape(getattr(cycles, name).shape)
        assert read.tobytes() == getattr(cycles, name).tobytes(), name
    stamps, states = zip(*found["/joint_states", "sensor_msgs/msg/JointState"], strict=True)
    assert states[0].name == list(robot().joint_names)
    assert np.array_equal([state.position for state in states], cycles.q)
    assert np.allclose(np.diff(stamps), 1e9 * PERIOD) and stamps[0] > 1.6e18
    texts = [decoded.data for _, decoded in found["/pinadapt/events", "std_msgs/msg/String"]]
    assert list(map(json.loads, texts)) == events and "begun" in events[0]


@pytest.mark.usefixtures("forked")
def test_a_writer_that_is_killed_leaves_all_but_the_last_tenth_of_a_second(tmp_path):
    """After kill -9 of everything nobody ends the file; and a loop whose writer dies stops."""
    path = tmp_path / "killed.mcap"
    with Recorder(path, controller(), port=0) as recorder:
        seen = []

        def kill(arm, m):
            if arm.cycle == 200:
                seen.append(tell(recorder.port, "state", timeout=20.0)["cycle"])
                time.sleep(0.1)
                os.kill(recorder.pid, signal.SIGKILL)
                recorder._process.join(60.0)  # a busy machine may let it live on for long
            return m

        loop = Loop(faulty(kill), recorder=recorder, seconds=60.0)
        ending = loop.ended()
    assert "log: the process has died" in ending.reason
    log = CycleLog.read(path)
    assert not log.whole and len(log) >= seen[0] - 0.1 / PERIOD > 120
    assert log.replay(controller()).same


# --- processes that are killed ---


@pytest.mark.slow
def test_a_killed_loop_leaves_its_log_and_an_arm_at_rest(tmp_path):
    """kill -9: the log is whole, and the arm stops by itself. At 50 Hz, as below."""
    of = pa.make_controller(robot(), dt=20e-3, adaptation="none")
    said, say = os.pipe()

    def driven():
        def told(words):
            os.write(say, f"{words}\n".encode())

        make = partial(pa.plants.PinocchioPlant, heavy())
        with Recorder(tmp_path / "run.mcap", of) as recorder, ProcessArm(make, 20e-3) as arm:
            told(f"{arm.pid} {recorder.pid}")
            options = {"recorder": recorder, "scheduling": ORDINARY, "say": told}
            safety = Safety(late=10**6, error=10.0)
            RealtimeLoop(arm, of, circle(), stage="adapt", safety=safety, **options).run()

    loop = forked(driven)
    os.close(say)
    with open(said) as lines:
        children = [int(number) for number in lines.readline().split()]
        assert any("running" in line for line in lines)
        time.sleep(0.6)
        os.kill(loop, signal.SIGKILL)
        os.waitpid(loop, 0)
    until = time.monotonic() + 30.0
    while any(map(runs, children)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(runs, children))  # both have ended by themselves
    log = CycleLog.read(tmp_path / "run.mcap")
    assert log.whole and len(log) > 10
    assert log.events[-1]["lost"] == "the process of the loop has died"
    assert log.replay(of).same


def runs(pid):
    """Return whether a process runs."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_a_plant_in_a_process_of_its_own_that_dies_is_noticed(tmp_path):
    """At 50 Hz: ten periods, after which the loop ends as late, are then more than a stall."""
    of = pa.make_controller(robot(), dt=20e-3, adaptation="none")
    with ProcessArm(partial(pa.plants.PinocchioPlant, heavy()), 20e-3) as on:
        assert on.facts.joints == tuple(robot().joint_names)
        loop = Loop(on, of=of, seconds=30.0, safety=Safety(late=10**6, error=10.0))
        sending = on.send
        count = iter(range(10**9))

        def send(torque):
            if next(count) == 10:
                os.kill(on.pid, signal.SIGKILL)
            sending(torque)

        on.send = send
        ending = loop.run()
    assert ending.failed and loop.phases[-1] == "stopped"
    assert "the connection broke" in ending.reason or "has ended its connection" in ending.reason
