"""Processes beside each other on one machine: how they are scheduled, started and ended."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from ..exceptions import PinadaptError

# [s] that a process may take to start, or to end before it is killed; half or twice: one that
# hangs is given up as much sooner or later
_PATIENCE = 60.0
MAIN = "In a script, what starts processes stands below `if __name__ == '__main__':`."


@dataclass(frozen=True)
class Scheduling:
    """Real-time settings requested of the operating system; those denied are noted.

    Attributes:
        priority: real-time priority (SCHED_FIFO), 1 to 99; None: that of any program.
        core: processor core to stay on; None: any.
        lock: whether all memory is kept from being paged out.
    """

    priority: int | None = 80
    core: int | None = None
    lock: bool = True

    @contextmanager
    def applied(self) -> Iterator[list[str]]:
        """Schedule this process so, yield notes on what is not allowed, and undo it at the end."""
        notes = []
        with ExitStack() as back:
            try:
                if self.core is not None:
                    back.callback(os.sched_setaffinity, 0, os.sched_getaffinity(0))
                    os.sched_setaffinity(0, {self.core})
                if self.priority is not None:
                    former = os.sched_getscheduler(0), os.sched_getparam(0)
                    back.callback(os.sched_setscheduler, 0, *former)
                    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self.priority))
            except (OSError, ValueError, OverflowError, AttributeError) as error:
                notes.append(
                    f"no core of its own or real-time priority ({error}): other programs will make "
                    "cycles late; add '@realtime - rtprio 99' to /etc/security/limits.conf and "
                    "yourself to the group"
                )
            if self.lock:
                system = ctypes.CDLL(None)
                back.callback(system.munlockall)
                if system.mlockall(3):  # MCL_CURRENT | MCL_FUTURE
                    notes.append(
                        "memory is not locked: paging may make cycles late; raise 'memlock' in "
                        "/etc/security/limits.conf"
                    )
            yield notes


ORDINARY = Scheduling(None, None, False)  # as any program


def start_process(
    serve: Callable[..., None], failure: PinadaptError, *arguments: Any
) -> tuple[SpawnProcess, Connection, Any]:
    """Start a process that serves one end of a pipe.

    Returns:
        The process, the other end, and the first that comes from there.

    Raises:
        PinadaptError: this comes first, or ``failure``, where nothing does.
    """
    context = get_context("spawn")
    link, there = context.Pipe()
    process = context.Process(target=serve, args=(there, *arguments), daemon=True)
    process.start()
    there.close()
    try:
        first = link.recv() if link.poll(_PATIENCE) else failure
    except (OSError, EOFError):
        first = failure
    if isinstance(first, PinadaptError):
        end_process(process, link)
        raise first
    return process, link, first


def end_process(process: SpawnProcess, link: Connection) -> None:
    """Wait until a process ends that was told to; kill it if it does not."""
    process.join(_PATIENCE)
    process.kill()
    process.join(1.0)
    link.close()
