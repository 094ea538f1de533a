"""Processes that work side by side, and end with the one that started them, however it ends."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection


@contextmanager
def workers(processes: int | None) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of new processes, by default one a core.

    Each listens to a pipe whose other end is here. It closes when this process ends, killed or not,
    or when the work is broken off, and then they end too, in the middle of whatever they do.
    """
    context = get_context("spawn")
    listen, alive = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, context, _end_with, (listen,))
    try:
        with pool:
            try:
                yield pool
            except BaseException:
                alive.close()
                raise
    finally:
        alive.close()
        listen.close()


@contextmanager
def deaf() -> Iterator[None]:
    """Let processes that are started meanwhile never see Ctrl-C, which is for this one to decide.

    It reaches this process afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(pipe: Connection) -> None:
    threading.Thread(target=_wait, args=(pipe,), daemon=True).start()


def _wait(pipe: Connection) -> None:
    """End this process when the other end of a pipe closes."""
    try:
        pipe.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)
