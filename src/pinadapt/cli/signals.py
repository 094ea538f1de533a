"""Signals that ask a process to end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_ENDING = [
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
]


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Let a request to end, or a terminal that is closed, stop the work as Ctrl-C does.

    A signal that somebody has decided about, ``nohup`` for example, is left as it is.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        free = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
        before = {number: signal.signal(number, signal.default_int_handler) for number in free}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
