"""What stands in for the window of a ``meshcat.Visualizer``: messages, in their order.

A message is a command of meshcat, in its own wire format, or a note to the page, in JSON, which
alone begins with a brace. No server is started.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from typing import Any

import umsgpack

from .keyframes import Node


class Window(ABC):
    """Takes what ``meshcat.Visualizer(window=...)`` sends, and notes to the page."""

    def send(self, command: Any) -> None:
        """Take a meshcat command."""
        lowered = command.lower()
        key = lowered["type"], lowered["path"], lowered.get("property")
        self.keep(key, umsgpack.packb(lowered, force_float_precision="single"))

    def note(self, key: Any, **content: Any) -> None:
        """Take a note; the names in it say what the page does, see ``page.html``."""
        self.keep(("note", key), json.dumps(content, allow_nan=False).encode())

    def copy(self, source: Node, target: Node, *, as_ghost: bool = False) -> None:
        """Show the object of one node at another one as well, perhaps in the ghost's material."""
        paths = {"source": source.path.lower(), "target": target.path.lower()}
        self.note(paths["target"], copy={**paths, "ghost": as_ghost})

    @abstractmethod
    def keep(self, key: Any, message: bytes) -> None:
        """Keep a message; ``key`` is the same for one that takes the place of another."""


def framed(message: bytes) -> bytes:
    """Return a message with its length before it, as the page reads them."""
    return len(message).to_bytes(4, "big") + message
