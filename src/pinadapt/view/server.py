"""The messages of a running scene for any number of browsers, from a thread of this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Condition, Thread
from typing import Any

from .window import Window, framed

_PATIENCE = 2.0  # [s] for browsers to read the rest when everything ends


class Broadcast(Window):
    """Keeps the latest message of each key, in the order of their arrival, until it is closed.

    A browser that comes late gets the whole scene, one that is slow leaves out what was replaced
    meanwhile.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._latest: dict[Any, tuple[int, bytes]] = {}
        self._count = self._readers = 0
        self._closed = False
        self._changed = Condition()

    def keep(self, key: Any, message: bytes) -> None:
        """Keep a message in place of an older one of the same key."""
        with self._changed:
            self._latest.pop(key, None)
            self._count += 1
            self._latest[key] = self._count, message
            self._changed.notify_all()

    def read(self) -> Iterator[bytes]:
        """Yield the messages so far, framed, and what comes, until everything is closed."""
        seen, closed = 0, False
        with self._changed:
            self._readers += 1
            self._changed.notify_all()
        try:
            while not closed:
                with self._changed:
                    while self._count == seen and not self._closed:
                        self._changed.wait()
                    new = self._since(seen)
                    seen, closed = self._count, self._closed
                if new:
                    yield b"".join(framed(message) for message in new)
        finally:
            with self._changed:
                self._readers -= 1
                self._changed.notify_all()

    def wait_for_reader(self, timeout: float) -> bool:
        """Wait until somebody reads, at most so long [s]; return whether somebody does."""
        with self._changed:
            return self._changed.wait_for(lambda: self._readers > 0, timeout)

    def close(self) -> None:
        """Let all readers read the rest and end."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._readers == 0, _PATIENCE)

    def _since(self, seen: int) -> list[bytes]:
        new: list[bytes] = []
        for number, message in reversed(self._latest.values()):
            if number <= seen:
                break
            new.append(message)
        return new[::-1]


class Server:
    """Serves one page and its messages to this machine alone.

    Attributes:
        url: of the page.
    """

    def __init__(self, page: str, messages: Broadcast, port: int = 0) -> None:
        """Start; port 0 is any free one."""
        self._messages = messages

        class Handler(_Handler):
            content, source = page.encode(), messages

        self._http = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._http.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._http.server_port}/"
        self._thread = Thread(target=self._http.serve_forever, args=(0.05,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let browsers read the rest, and stop; the port is free afterwards."""
        self._messages.close()
        self._http.shutdown()
        self._thread.join()
        self._http.server_close()


class _Handler(BaseHTTPRequestHandler):
    content: bytes
    source: Broadcast
    timeout = _PATIENCE  # of a browser that takes nothing

    def do_GET(self) -> None:
        """Answer with the page, or with the messages as they come."""
        if self.path == "/":
            self._begin("text/html; charset=utf-8")
            self._give(iter([self.content]))
        elif self.path == "/messages":
            self._begin("application/octet-stream")
            self._give(self.source.read())
        else:
            self.send_error(404)

    def _begin(self, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.end_headers()

    def _give(self, parts: Iterator[bytes]) -> None:
        with suppress(OSError):  # the browser has gone
            for part in parts:
                self.wfile.write(part)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""
