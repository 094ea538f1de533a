"""Whether memory holds the samples that a run is to keep."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ..controller.controller import Controller
from ..exceptions import InputError

_OBJECTS = 1800  # [B] a sample, besides the numbers
_PER_JOINT = 20  # numbers a sample


def check_memory(controller: Controller, samples: int, record_every: int) -> None:
    """Refuse a run whose samples do not fit into the memory that there is.

    Raises:
        InputError: they do not.
    """
    kept = -(-samples // record_every)
    parameters = controller.kinematics.size + controller.dynamics.size
    joints = len(controller.kinematics.joint_names)
    needed = kept * (_OBJECTS + 8 * (parameters + _PER_JOINT * joints))
    room = min(_room(), default=sys.maxsize)
    if needed > room:
        raise InputError(
            f"{kept} samples to keep take about {needed / 1e9:.3g} GB, there are {room / 1e9:.3g}.",
            where="duration",
            hint="Take a shorter duration or a longer dt; in Python record_every keeps fewer.",
        )


def _room() -> Iterator[int]:
    """Return the bounds on this process's memory that the system tells [B], if any."""
    with suppress(OSError, ValueError, AttributeError):  # not every system has these names
        yield os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with suppress(OSError, ValueError, IndexError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        yield next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable")) * 1024
    with suppress(OSError, ValueError):  # "max" where a container has no limit
        yield int(Path("/sys/fs/cgroup/memory.max").read_text())
    with suppress(ImportError):
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY:
            yield soft
