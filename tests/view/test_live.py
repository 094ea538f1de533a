"""Live views: what a browser receives, timing, and the end of the server."""

import io
import os
import re
import signal
import socket
import threading
import time
import urllib.error
import urllib.request
from contextlib import suppress

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from pinadapt.view import LiveView
from pinadapt.view.live import Broadcast, Server
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
    received = []

    def read():
        received.append(urllib.request.urlopen(view.url + "messages", timeout=20).read())

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
        "true/joint 2/tip",
        "estimated/joint 2/tip",
        "paths/desired",
        "paths/true/0",
        "desired point",
        "true/joint 2/load 0/0",
    ):
        assert f"/meshcat/{part}" in objects, part
    last = samples[-1]
    tip = np.array(commands["set_transform", "/meshcat/desired point"]["matrix"])
    assert np.allclose(tip[12:14], last.desired.x_d, atol=1e-6)
    estimated = commands["set_transform", "/meshcat/estimated/joint 2/tip"]["matrix"]
    assert np.allclose(estimated[12:14], last.state.a_k[:2], atol=1e-6)
    readings = [note["reading"] for note in notes if "reading" in note]
    assert len(readings) == 10 and readings[-1]["t"] == pytest.approx(last.t)
    error = 1e3 * np.linalg.norm(last.truth.x - last.desired.x_d)
    assert readings[-1]["values"][0] == pytest.approx(error, rel=1e-3)
    assert readings[0]["values"][1:] == [pytest.approx(100.0), None, None]
    assert 0.0 < readings[-1]["values"][2] < 100.0 and readings[-1]["values"][3] > 0.0
    still = [note["still"] for note in notes if "still" in note]
    assert len(still) == 1 and still[0].startswith("not excited by this motion: ")
    assert notes[-1] == {"end": "the run has ended"}


def test_live_view_does_not_change_the_samples():
    _, samples, _ = watched(0.05)
    plant, controller, path, view = loop(0.05)
    view.close()
    plain = list(pa.run(plant, controller, path, duration=0.05))
    assert all(np.array_equal(a.truth.q, b.truth.q) for a, b in zip(samples, plain, strict=True))


def test_live_view_runs_at_most_in_real_time():
    import time

    begun = time.perf_counter()
    watched(0.4)
    assert time.perf_counter() - begun > 0.36


def test_closing_a_live_view_leaves_no_thread_or_port():
    before = set(threading.enumerate())
    stream, _, view = watched(0.05)
    assert stream
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


def test_the_page_is_self_contained():
    _, _, _, view = loop(0.1)
    with view:
        page = urllib.request.urlopen(view.url, timeout=10).read().decode()
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(view.url + "../../etc/passwd", timeout=10)
    assert "&lt;two&gt; &amp; two" in page and "<two>" not in page
    own = page.split('id="viewer"')[0] + page.rsplit("<script>", 1)[1]
    assert "http:" not in own and "https:" not in own and 'src="' not in own


def test_a_late_reader_gets_the_latest_messages():
    messages = Broadcast()
    for k in range(3):
        messages.keep("a", f"a{k}".encode())
        messages.keep(("b", k), f"b{k}".encode())
    messages.close()
    framed = b"".join(messages.read())
    assert framed == b"".join(len(m).to_bytes(4, "big") + m for m in (b"b0", b"b1", b"a2", b"b2"))


def test_a_reader_that_does_not_read_does_not_block_closing():
    messages = Broadcast()
    server = Server("page", messages)
    port = int(server.url.rsplit(":", 1)[1].strip("/"))
    with socket.create_connection(("127.0.0.1", port)) as idle:
        idle.sendall(b"GET /messages HTTP/1.0\r\nHost: localhost:%d\r\n\r\n" % port)
        assert messages.wait_for_reader(5.0)
        for k in range(50):
            messages.keep(k, bytes(1_000_000))
        server.close()  # would hang here


def test_the_page_says_that_a_run_diverged():
    plant, controller, path, view = loop(1.0)

    def diverging():
        yield next(pa.run(plant, controller, path))
        raise pa.DivergedError("lost", 0.25)

    with view, pytest.raises(pa.DivergedError):
        list(view.watch(diverging()))
    _, notes = parted(b"".join(view._window.read()))
    assert notes[-1] == {"end": "diverged at 0.25 s"}


def test_a_load_is_shown_while_it_is_carried():
    robot = pa.load("planar_2r")
    loaded = robot.changed(payload=pa.Payload(2.0, com=[0.1, 0.0, 0.0]))
    (load,) = loaded.loads
    assert load.mass == 2.0 and not robot.loads and not robot.changed(inertial_scale=2.0).loads
    controller = pa.make_controller(robot, adaptation="natural")
    path = pa.trajectories.Hold(robot.position(robot.q0))
    view = LiveView(robot, controller, path, duration=0.1, changes={0.05: loaded})
    with view:
        list(view.watch(pa.run(pa.plants.PinocchioPlant(robot), controller, path, duration=0.1)))
    commands, _ = parted(b"".join(view._window.read()))
    shown = commands["set_transform", "/meshcat/true/joint 2/load 1"]["matrix"]
    assert shown[0] == pytest.approx(1.0)
    assert ("set_object", "/meshcat/true/joint 2/load 1/0") in commands


# --- the commands ---


def test_run_live_prints_the_address_and_writes_the_usual_files(tmp_path, capsys, blank_pictures):
    assert (
        main(["run", PLANAR, "--live", "--out", str(tmp_path), "--set", "simulation.duration=0.1"])
        == 0
    )
    out, err = capsys.readouterr()
    assert "live view: http://127.0.0.1:" in err and "live view" not in out
    assert (tmp_path / "animation.html").is_file()


@pytest.mark.parametrize("visited", [True, False])
def test_without_a_display_a_run_waits_for_a_visitor_at_a_terminal(visited, monkeypatch, capsys):
    monkeypatch.setattr("pinadapt.view.live.on_terminal", lambda: True)
    monkeypatch.setattr("pinadapt.view.live._PATIENT", 5.0 if visited else 0.05)
    if visited:
        waited = Broadcast.wait_for_reader

        readers = []

        def come(window, timeout):
            readers.append(window.read())
            threading.Thread(target=next, args=(readers[-1],), daemon=True).start()
            return waited(window, timeout)

        monkeypatch.setattr(Broadcast, "wait_for_reader", come)
    view = loop(0.1)[-1]
    if visited:
        readers[0].close()
    view.close()
    said = capsys.readouterr().err
    assert "the run starts with the first visitor" in " ".join(said.lower().split())
    assert ("No browser has connected" in said) != visited


def test_without_display_and_terminal_a_run_says_how_to_look_afterwards(monkeypatch, capsys):
    monkeypatch.setattr("pinadapt.view.live.on_terminal", lambda: False)
    loop(0.1)[-1].close()
    assert "`pinadapt view FOLDER`" in capsys.readouterr().err


def test_view_of_a_scenario_runs_it_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["view", PLANAR, "--set", "simulation.duration=0.1"]) == 0
    assert "live view: http" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_view_of_a_folder_names_its_animation(tmp_path, capsys):
    (tmp_path / "animation.html").write_text("x")
    assert main(["view", str(tmp_path)]) == 0
    assert capsys.readouterr().out.strip() == (tmp_path / "animation.html").as_uri()


def test_view_of_a_folder_without_one_is_refused(tmp_path, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert "animation.html" in capsys.readouterr().err


@pytest.mark.usefixtures("interruptible")
def test_an_interrupted_live_run_is_130_and_frees_its_port(monkeypatch):
    """A page is asked for while it runs, then Ctrl-C."""
    told, asked = io.StringIO(), []

    def asking():
        while not (url := re.search(r"http://127\.0\.0\.1:\S+", told.getvalue())):
            time.sleep(0.01)
        asked.append((url[0], urllib.request.urlopen(url[0], timeout=10).status))
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("sys.stderr", told)
    thread = threading.Thread(target=asking)
    thread.start()
    assert main(["view", PLANAR]) == 130
    thread.join(10.0)
    ((url, status),) = asked
    assert status == 200
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(url, timeout=5)


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "localhost:1"]
)
def test_requests_of_other_sites_are_refused(host):
    """DNS rebinding: a foreign name that points to this machine."""
    server = Server("the page", Broadcast())
    port = int(server.url.rsplit(":", 1)[1].strip("/"))
    request = urllib.request.Request(server.url, headers={"Host": host.format(port=port)})
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=5)
    assert refused.value.code == 421
    at_home = urllib.request.Request(server.url, headers={"Host": f"localhost:{port}"})
    assert urllib.request.urlopen(at_home, timeout=5).read() == b"the page"
    server.close()


def test_the_number_of_simultaneous_visitors_is_limited():
    """Of sixty connections that never end, 32 are answered and the others are closed."""
    messages = Broadcast()
    messages.keep("a", b"message")
    server = Server("page", messages)
    port = int(server.url.rsplit(":", 1)[1].strip("/"))
    idle = [socket.create_connection(("127.0.0.1", port), timeout=10.0) for _ in range(60)]
    try:
        answered = 0
        for visitor in idle:
            with suppress(OSError):
                visitor.sendall(b"GET /messages HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % port)
                answered += visitor.recv(12).startswith(b"HTTP/1.0 200")
        assert answered == 32
    finally:
        for visitor in idle:
            visitor.close()
        server.close()
