"""A bar over the samples of a run."""

from __future__ import annotations

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
    if progress is False:
        return indices
    from tqdm.auto import tqdm  # here, because the library is imported without it

    silent = None if progress is None else False  # None: unless it is a terminal
    bar: Iterable[int] = tqdm(
        indices, desc=title, unit="step", disable=silent, leave=False, mininterval=0.2
    )
    return bar
