"""A run shown in a browser while it goes on, at most in real time."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from time import perf_counter, sleep
from typing import Any

import numpy as np

from ..controller.controller import Controller
from ..controller.state import Sample
from ..robot.robot import Robot, Succession
from ..trajectories.given import TrajectoryLike, as_trajectory
from .drawing import Window
from .page import page
from .scene import RATE, Scene


def open_in_browser(address: str) -> bool:
    """Open an address in a browser if there is a display; return whether one was started."""
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not display:  # a text browser would take the terminal
        return False
    return webbrowser.open(address)


# [s] for a browser to come, or to read the last messages; half: a slow one misses start and end,
# twice: a hung one delays the program
_PATIENCE = 5.0


class Server(ThreadingHTTPServer):
    """Serves one page and its messages, to this machine only.

    A page of another site whose name was made to point here sends that name as Host, and is
    refused (DNS rebinding).

    Attributes:
        url: of the page.
        page: in HTML.
        messages: that the page asks for; one that connects late gets the whole scene.
        read: how many of them a browser has got.
        hosts: names by which it may be asked for.
    """

    daemon_threads = True

    def __init__(self, page: str, messages: Window) -> None:
        """Start the server on a free port."""
        super().__init__(("127.0.0.1", 0), _Handler)
        self.page = page.encode()
        self.messages = messages
        self.read = 0
        self.hosts = {f"{name}:{self.server_port}" for name in ("127.0.0.1", "localhost")}
        self.url = f"http://127.0.0.1:{self.server_port}/"
        Thread(target=self.serve_forever, args=(0.05,), daemon=True).start()

    def wait_until_read(self) -> None:
        """Wait a while for a browser to read all messages."""
        end = perf_counter() + _PATIENCE
        while self.read < self.messages.count and perf_counter() < end:
            sleep(0.02)

    def close(self) -> None:
        """Let a browser read the remaining messages, stop, and free the port."""
        if self.read:
            self.wait_until_read()
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = _PATIENCE  # for a browser that does not read

    def do_GET(self) -> None:
        """Send the page, or the messages after the number in the query."""
        place, _, query = self.path.partition("?")
        if self.headers.get("Host") not in self.server.hosts:
            self.send_error(421, "this page is served to the same machine only")
        elif place == "/":
            self._send("text/html; charset=utf-8", self.server.page)
        elif place == "/messages" and query.isdecimal():
            count, new = self.server.messages.since(int(query))
            self._send("application/octet-stream", new, count)
            self.server.read = count
        else:
            self.send_error(404)

    def _send(self, kind: str, body: bytes, count: int = 0) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Count", f"{count}")
        self.end_headers()
        with suppress(OSError):  # the browser has disconnected
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""


class LiveView:
    """A page that shows a run while it goes on; close it, or use it in a ``with`` statement.

    The server is a thread of this process and answers this machine only. If there is a display, a
    browser is opened, and the run waits for it. The address is printed to standard error; browsers
    may connect and leave at any time.

    ```
    with LiveView(true, controller, trajectory, duration=10.0) as view:
        for sample in view.watch(pa.run(plant, controller, trajectory, duration=10.0)):
            ...
    ```

    Attributes:
        url: of the page.
    """

    def __init__(
        self,
        true: Robot,
        controller: Controller,
        trajectory: TrajectoryLike,
        *,
        duration: float,
        changes: Mapping[float, Robot] | None = None,
        title: str = "",
    ) -> None:
        """Draw the scene and start its server.

        Args:
            true: the true robot.
            controller: its controller.
            trajectory: the desired motion, as in ``simulate``.
            duration: of the run [s]; the desired path is drawn for this time.
            changes: time [s] -> the true robot from then on.
            title: of the page.
        """
        self._last: Sample | None = None
        self._traced: list[np.ndarray] = []
        t = np.linspace(0.0, duration, 600)
        self._scene = Scene(
            Succession.of(true, changes),
            controller,
            t,
            true.q0[None],
            as_trajectory(trajectory, true.task).positions(t),
            t[:1],
        )
        html = page(self._scene, title or true.name, duration, live=True)
        self._server = Server(html, self._scene.window)
        self.url = self._server.url
        print(f"live view: {self.url}", file=sys.stderr, flush=True)
        if open_in_browser(self.url):
            self._server.wait_until_read()

    def watch(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        """Yield the samples of a run, at most in real time, and show them."""
        due = 0.0
        started = None
        for sample in samples:
            self._last = sample
            if sample.t >= due:
                now = perf_counter()
                if started is None:
                    started = now - sample.t
                sleep(max(0.0, started + sample.t - now))
                due = sample.t + 1.0 / RATE
                self._draw(sample)
            yield sample

    def _draw(self, sample: Sample) -> None:
        if np.isfinite([*sample.truth.q, *sample.state.a_k]).all():
            self._traced += [*self._scene.show([sample])]
            first = max(len(self._traced) - 2, 0) // 30 * 30  # the last second is drawn again
            self._scene.add_paths(f"true/{first}", np.array(self._traced[first:]))

    def close(self) -> None:
        """Show the last sample and stop the server; open pages stay as they are."""
        if self._last is not None:
            self._draw(self._last)
        self._scene.window.note("end", end="the run has ended")
        self._server.close()

    def __enter__(self) -> LiveView:
        """Return this view."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the view."""
        self.close()
