"""Exit statuses."""

from __future__ import annotations

from collections.abc import Sequence
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
