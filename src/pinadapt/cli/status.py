"""Exit statuses, and signals that end a command."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..rollout.rollout import Rollout

DONE, REFUSED, DIVERGED, INCOMPLETE, INTERRUPTED = 0, 2, 3, 4, 130


def status_of(*rollouts: Rollout) -> int:
    """Return the exit status of a command that ran these rollouts."""
    if interrupted(rollouts):
        return INTERRUPTED
    return DONE if all(rollout.diverged is None for rollout in rollouts) else DIVERGED


def interrupted(rollouts: Sequence[Rollout]) -> bool:
    """Tell whether the last rollout was interrupted, so that no other should start."""
    return bool(rollouts) and rollouts[-1].interrupted is not None


_ENDING = [
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
]


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Let SIGTERM, or the SIGHUP of a closed terminal, stop the work as Ctrl-C does.

    Signals that already have a handler, for example by ``nohup``, are left unchanged.
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
