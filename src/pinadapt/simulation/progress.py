"""A bar over the samples of a run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable

Progress = Callable[[range], Iterable[int]]


def watched(indices: range, progress: Progress | bool | None, title: str) -> Iterable[int]:
    """Return the indices of a run's samples, with a bar that grows as they are taken.

    Args:
        indices: of the samples.
        progress: None: a bar where standard error is a terminal, and nothing elsewhere; True: a bar
            everywhere, in a notebook as a widget; False: none; or a function that wraps the
            indices.
        title: stands in front of the bar.
    """
    if callable(progress):
        return progress(indices)
    if not progress and (progress is False or not _on_terminal()):
        return indices
    from tqdm.auto import tqdm  # here, because the library is imported without it

    bar: Iterable[int] = tqdm(indices, desc=title, unit="step", leave=False, mininterval=0.2)
    return bar


def _on_terminal() -> bool:
    """Tell whether standard error is a terminal; a windowed program has none at all."""
    return sys.stderr is not None and sys.stderr.isatty()
