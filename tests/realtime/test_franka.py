"""A Franka by its vendor's client, against ``franky-sim``: the protocol is real, the arm is not."""

from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli import main
from pinadapt.realtime import ArmFacts, CycleLog, RealtimeLoop, Recorder, Safety
from tests.support.arms import ORDINARY
from tests.support.franka_server import TOOL, Franka

pytestmark = pytest.mark.slow
pytest.importorskip("pylibfranka", reason="the extra franka is not installed")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
from pinadapt.realtime.franka import FrankaArm  # noqa: E402


@cache
def robot():
    """Return the description: a Panda, whose kinematics are those of the simulated FR3."""
    return pa.load("panda")


@cache
def controller():
    """Return a controller of the arm, which adds gravity by itself."""
    return pa.make_controller(
        robot(),
        adaptation="natural",
        unknown=pa.Unknown(tool=True),
        sensors=pa.Sensors(camera=pa.Camera(rate=30.0)),
        compensated="nominal",
    )


@pytest.fixture(scope="module")
def franka():
    """Return a server whose time goes on with the torques it gets."""
    server = Franka("127.0.0.1")
    yield server
    server.close()


@pytest.fixture(autouse=True)
def ended_sooner(monkeypatch):
    """Hold and damp the arm for a moment; how long that takes is tested in this process."""
    monkeypatch.setattr("pinadapt.realtime.realtime_loop._HOLD", 0.05)
    monkeypatch.setattr("pinadapt.cli.drive.Scheduling", lambda **_: ORDINARY)
    facts = SimpleNamespace(of=partial(ArmFacts.of, clock="simulated"))  # stepped by torques
    monkeypatch.setattr("pinadapt.realtime.franka.ArmFacts", facts)


def drive(server, stage, seconds, **options):
    """Return ending, and positions (N, 7) and torques (N, 7) of a run.

    It ends as by a second Ctrl-C, which damps at once: a path comes to rest in half a second.
    """
    q, sent = [], []
    circle = pa.trajectories.Circle(robot().position(robot().q0), 0.04, 3.0)
    server.camera()  # frames of an earlier connection, on another clock
    with FrankaArm(server.address, robot(), camera=server.camera) as arm:
        read, send = arm.read, arm.send

        def reading():
            m = read()
            q.append(m.q)
            if m.t - loop._begin >= seconds:
                loop._signals = 2
            return m

        arm.read, arm.send = reading, lambda torque: (sent.append(torque), send(torque))
        safety = Safety(late=10**6, contact=1.0)
        options |= {"safety": safety, "scheduling": ORDINARY, "say": lambda words: None}
        loop = RealtimeLoop(arm, controller(), circle, stage=stage, **options)
        ending = loop.run()
    return ending, np.array(q), np.array(sent)


def test_log_only_sends_nothing(franka):
    ending, q, sent = drive(franka, "log", 0.1)
    assert not len(sent) and np.ptp(q, axis=0).max() < 1e-3
    assert not ending.failed or ending.reason.startswith("late: ")


def test_tool_and_load_are_learned_on_a_circle(franka, tmp_path):
    path, of = tmp_path / "franka.mcap", controller()
    with Recorder(path, of) as recorder:
        ending, *_ = drive(franka, "adapt", 1.0, recorder=recorder)
    assert not ending.failed, ending
    log, model = CycleLog.read(path), robot().changed(tool_translation=TOOL)
    assert log.replay(of).same
    at = np.flatnonzero(log.stepped)[:1000:50]
    x = np.array([model.position(q) for q in log.cycles.q[at]])
    error = np.linalg.norm(x - log.cycles.x_d[at], axis=1)
    assert error[-8:].max() < 2e-3, error
    truth = of.kinematics.value(model)
    assert (
        np.abs(ending.state.a_k - truth).max() < 1e-3 < np.abs(of.kinematics.initial - truth).max()
    )


def test_one_command_identifies_the_load(franka, tmp_path, capsys):
    """Without a scenario its joints move; the load hangs on it, and is no contact."""
    log = ["--log", str(tmp_path / "run.mcap"), "--safety", "late=1000000"]
    assert main(["drive", "franka", franka.address, "--adapt", "--duration", "0.25", *log]) == 0
    out = capsys.readouterr().out
    assert "worst" in out and "learned parameters in" in out
    log_of = CycleLog.read(tmp_path / "run.mcap")
    cycles = log_of.cycles
    assert np.abs((cycles.q - cycles.x_d)[log_of.stepped]).max() < 5e-3
    assert main(["drive", "franka", "--hold", *log]) == 2
    assert "ADDRESS: is needed" in capsys.readouterr().err
