"""A Franka by its vendor's client, against ``franky-sim``: the protocol is real, the arm is not."""

import json
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli import main
from pinadapt.realtime import ArmFacts, CycleLog, RealtimeLoop, Recorder, Safety
from tests.support.arms import ORDINARY
from tests.support.franka_server import FINGERS, MASS, TOOL, Franka
from tests.support.paths import page_module

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("forked")]
pytest.importorskip("pylibfranka", reason="the extra franka is not installed")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
from franky_sim.urdf import FR3_URDF  # noqa: E402

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
    monkeypatch.setattr("pinadapt.realtime.realtime_loop._SETTLED", 0.05)
    monkeypatch.setattr("pinadapt.cli.drive.Scheduling", lambda **_: ORDINARY)
    facts = SimpleNamespace(of=partial(ArmFacts.of, clock="simulated"))  # stepped by torques
    monkeypatch.setattr("pinadapt.realtime.franka.ArmFacts", facts)


class Seeing(FrankaArm):
    """An arm with a camera."""

    def read(self):
        m = super().read()
        frame = self.camera()
        return m if frame is None else m._replace(x=frame[0], x_time=min(frame[1], m.t))


def test_tool_and_load_are_learned_on_a_circle(franka, tmp_path):
    path = tmp_path / "franka.mcap"
    of = controller()
    franka.camera()  # frames of an earlier connection, on another clock
    circle = pa.trajectories.Circle(robot().position(robot().q0), 0.04, 3.0)
    options = {"safety": Safety(late=10**6, contact=1.0), "scheduling": ORDINARY}
    with Recorder(path, of) as recorder, Seeing(franka.address, robot()) as arm:
        arm.camera = franka.camera
        loop = RealtimeLoop(arm, of, circle, stage="adapt", recorder=recorder, **options)
        ending = loop.run(1.0)
    assert not ending.failed, ending
    log = CycleLog.read(path)
    model = robot().changed(tool_translation=TOOL)
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


def test_a_load_that_is_told_is_compensated(franka, tmp_path):
    """The hand is turned against the flange, in whose axes the load is given."""
    x, y, z = TOOL + np.array([0.0, 0.0, 0.1034])
    load = json.dumps({"mass": MASS, "com": [(x + y) / 2**0.5, (y - x) / 2**0.5, z]})
    path = str(tmp_path / "run.mcap")
    given = ["--gravity", "--duration", "0.2", "--load", load, "--log", path]
    assert main(["drive", "franka", franka.address, *given, "--safety", "late=1000000"]) == 0
    q = CycleLog.read(path).cycles.q
    assert np.abs(q - q[0]).max() < 1e-3


def test_the_example_finds_a_load_and_tells_it(franka, tmp_path):
    (tmp_path / "fr3.urdf").write_text(FR3_URDF)
    found = page_module("loops", "franka_load")
    other = found.franka.Robot(franka.address, found.franka.RealtimeConfig.kIgnore)
    other.set_load(0.0, [0.0] * 3, [0.0] * 9)  # in place of the one above
    del other
    seconds = iter([2.4, 1.6])  # to find the load, and to see its effect
    move = found.move
    found.move = lambda *given: move(*given, next(seconds))
    load, before, after = found.run(franka.address, tmp_path / "fr3.urdf")
    heavy = MASS + FINGERS  # the robot states its hand without the fingers
    assert abs(load.mass - heavy) < min(2.0 * load.mass_known_to, 0.06)
    assert after[800:].max() < 0.9 * before[800:].max()
