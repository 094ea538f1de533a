"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from tqdm import tqdm

Row = TypeVar("Row")


def rows_bar(rows: Iterable[Row], total: int) -> Iterable[Row]:
    """Return the rows with a bar over them, when standard error is a terminal."""
    bar: Iterable[Row] = tqdm(
        rows, total=total, desc="zoo", unit="robot", disable=None, leave=False
    )
    return bar
