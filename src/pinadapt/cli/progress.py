"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

from tqdm import tqdm

Row = TypeVar("Row")


def samples_bar(name: str) -> Callable[[range], Iterable[int]]:
    """Return a wrapper that shows a bar over samples when standard error is a terminal."""
    return partial(tqdm, desc=name, unit="step", disable=None, leave=False, mininterval=0.2)


def rows_bar(rows: Iterable[Row], total: int) -> Iterable[Row]:
    """Return the rows with a bar over them, when standard error is a terminal."""
    bar: Iterable[Row] = tqdm(
        rows, total=total, desc="zoo", unit="robot", disable=None, leave=False
    )
    return bar
