"""Live views: what a browser receives, timing, and the end of the server."""

import socket
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from pinadapt.view import LiveView
from pinadapt.view.drawing import Window
from pinadapt.view.live import Server
from tests.support.streams import parted

pytestmark = pytest.mark.slow

PLANAR = str(robots_folder() / "planar_2r" / "wang_xie_2009.toml")


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    """Open no browser."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


def loop(duration, changes=None):
    """Return plant, controller, path and what a live view of them takes."""
    robot = pa.load("planar_2r")
    true = robot.changed(tool_translation=[0.1, 0.0, 0.0], payload=pa.Payload(0.5))
    controller = pa.make_controller(robot, adaptation="natural", unknown=pa.Unknown(tool=True))
    start = true.position(true.q0)
    path = pa.trajectories.Circle(np.zeros(2), 0.2, 2.0).starting_at(start)
    view = LiveView(true, controller, path, duration=duration, changes=changes, title="<two> & two")
    return pa.plants.PinocchioPlant(true), controller, path, view


def watched(duration, **options):
    """Run a loop with one reader; return what it received, the samples, and the view."""
    plant, controller, path, view = loop(duration, **options)
    received = [b""]

    def read():
        count = 0
        while b'{"end"' not in received[0]:
            answer = urllib.request.urlopen(f"{view.url}messages?{count}", timeout=20)
            count = answer.headers["Count"]
            received[0] += answer.read()
            time.sleep(0.01)

    reader = threading.Thread(target=read)
    reader.start()
    with view:
        samples = list(view.watch(pa.run(plant, controller, path, duration=duration)))
    reader.join(20)
    return received[0], samples, view


def test_a_browser_receives_scene_motion_and_curves():
    stream, samples, _ = watched(0.3)
    commands, notes = parted(stream)
    objects = {path for kind, path in commands if kind == "set_object"}
    for part in (
        "true/tip",
        "estimated/tip",
        "paths/desired",
        "paths/true/0",
        "desired point",
        "true/joint 2/load 0/0",
    ):
        assert f"/meshcat/{part}" in objects, part
    last = samples[-1]
    tip = np.array(commands["set_transform", "/meshcat/desired point"]["matrix"])
    assert np.allclose(tip[12:14], last.desired.x_d, atol=1e-6)
    estimated = commands["set_transform", "/meshcat/estimated/tip"]["matrix"]
    believed = loop(0.3)[1].kinematics
    believed.update(last.state.a_k, last.truth.q, last.truth.v)
    assert np.allclose(estimated[12:14], believed.p_hat[:2], atol=1e-6)
    readings = [note["reading"] for note in notes if "reading" in note]
    assert len(readings) == 10 and readings[-1]["t"] == pytest.approx(last.t)
    error = 1e3 * np.linalg.norm(last.truth.x - last.desired.x_d)
    assert readings[-1]["values"][0] == pytest.approx(error, rel=1e-3)
    assert readings[0]["values"][1:] == [pytest.approx(100.0)]
    assert notes[-1] == {"end": "the run has ended"}


def test_a_live_view_changes_no_sample_and_leaves_no_thread_or_port():
    before = set(threading.enumerate())
    _, samples, view = watched(0.05)
    plant, controller, path, other = loop(0.05)
    other.close()
    plain = list(pa.run(plant, controller, path, duration=0.05))
    assert all(np.array_equal(a.truth.q, b.truth.q) for a, b in zip(samples, plain, strict=True))
    port = int(view.url.rsplit(":", 1)[1].strip("/"))
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(view.url, timeout=5)
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        free.bind(("127.0.0.1", port))
    left = [thread for thread in set(threading.enumerate()) - before if thread.is_alive()]
    for thread in left:
        thread.join(5)
    assert not [thread for thread in left if thread.is_alive()]


# --- the commands ---


def test_run_live_prints_the_address_and_writes_the_usual_files(tmp_path, capsys, blank_pictures):
    assert (
        main(["run", PLANAR, "--live", "--out", str(tmp_path), "--set", "simulation.duration=0.1"])
        == 0
    )
    out, err = capsys.readouterr()
    assert "live view: http://127.0.0.1:" in err and "live view" not in out
    assert (tmp_path / "animation.html").is_file()


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "localhost:1"]
)
def test_requests_of_other_sites_are_refused(host):
    """DNS rebinding: a foreign name that points to this machine."""
    server = Server("the page", Window())
    port = int(server.url.rsplit(":", 1)[1].strip("/"))
    request = urllib.request.Request(server.url, headers={"Host": host.format(port=port)})
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=5)
    assert refused.value.code == 421
    at_home = urllib.request.Request(server.url, headers={"Host": f"localhost:{port}"})
    assert urllib.request.urlopen(at_home, timeout=5).read() == b"the page"
    server.close()
