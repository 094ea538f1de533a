"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


def rows_bar(rows: Iterable[Item], total: int) -> Iterable[Item]:
    """Return the rows of the zoo with a bar over them, when standard error is a terminal."""
    return _bar(rows, total, "zoo", "robot")


def steps_bar(steps: Sequence[Item], name: str) -> Iterable[Item]:
    """Return the steps of some work with a bar over them, when standard error is a terminal."""
    return _bar(steps, len(steps), name, "step")


def _bar(items: Iterable[Item], total: int, name: str, unit: str) -> Iterable[Item]:
    bar: Iterable[Item] = tqdm(items, total=total, desc=name, unit=unit, disable=None, leave=False)
    return bar
