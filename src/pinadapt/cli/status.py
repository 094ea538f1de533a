"""Exit statuses."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..rollout.rollout import Rollout

DONE, REFUSED, DIVERGED, INTERRUPTED = 0, 2, 3, 130


def status_of(*rollouts: Rollout) -> int:
    """Return the status of a command that ran these."""
    if interrupted(rollouts):
        return INTERRUPTED
    return DONE if all(rollout.diverged is None for rollout in rollouts) else DIVERGED


def interrupted(rollouts: Sequence[Rollout]) -> bool:
    """Tell whether the last of some rollouts was interrupted, so that none is to follow."""
    return bool(rollouts) and rollouts[-1].interrupted is not None


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
