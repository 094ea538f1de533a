"""A command of the command line, whose arguments wait until it is chosen."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any


class Command(argparse.ArgumentParser):
    """A command that is told its arguments when it is chosen: some need what is slow to import.

    Attributes:
        fill: adds them, once.
    """

    fill: Callable[[argparse.ArgumentParser], None] | None = None

    def parse_known_args(  # type: ignore[override]  # of several overloads
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Return options and what is left over, as the class."""
        if self.fill is not None:
            fill, self.fill = self.fill, None
            fill(self)
        return super().parse_known_args(args, namespace)
