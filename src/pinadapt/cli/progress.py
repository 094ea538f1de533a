"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from tqdm import tqdm


def samples_bar(name: str) -> Callable[[range], Iterable[int]]:
    """Return a wrapper that shows a bar over the samples of a run, when standard error is a terminal."""

    def wrap(samples: range) -> Iterable[int]:
        bar: Iterable[int] = tqdm(samples, desc=name, unit="step", disable=None, leave=False, mininterval=0.2)
        return bar

    return wrap
