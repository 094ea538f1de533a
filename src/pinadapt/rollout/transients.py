"""How a run bears what happens during it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..robot.succession import EARLY

if TYPE_CHECKING:
    from .rollout import Rollout

CLOSE = 1e-3  # [m or rad] error below which a run counts as back


class Transient(NamedTuple):
    """The error norm, ``Rollout.distance``, from one mark of a run to the next.

    Attributes:
        at: time of the mark [s].
        what: its words.
        worst: largest error until the next mark or the end [m or rad].
        back: time from the mark after which the error stays below ``CLOSE`` [s], zero where it
            never leaves, None where it has not come back by then.
    """

    at: float
    what: str
    worst: float
    back: float | None


def transients(rollout: Rollout) -> list[Transient]:
    """Return one a mark of a rollout that has samples after it."""
    ends = np.searchsorted(rollout.t, [at - EARLY for at, _ in rollout.marks] + [np.inf])
    distance, found = rollout.distance, []
    for (at, what), first, last in zip(rollout.marks, ends, ends[1:], strict=False):
        if first == last:
            continue
        far = np.flatnonzero(~(distance[first:last] < CLOSE))  # NaN is far
        back: float | None = 0.0
        if far.size:
            after = first + far[-1] + 1
            back = round(float(rollout.t[after] - at), 6) if after < last else None
        found.append(Transient(at, what, float(distance[first:last].max()), back))
    return found
