"""One web page: meshcat's viewer, what it shows, curves, and a legend."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import meshcat

from ..exceptions import PinadaptError
from .camera import Camera
from .curves import Curve
from .shapes import ghost
from .window import Window, framed


class Messages(Window):
    """Keeps all messages, for one page that holds them."""

    def __init__(self) -> None:
        """Start empty."""
        self._messages: list[bytes] = []

    def keep(self, key: Any, message: bytes) -> None:
        """Append a message."""
        self._messages.append(message)

    def packed(self) -> str:
        """Return everything as the page unpacks it."""
        return _packed(b"".join(framed(message) for message in self._messages))


@dataclass(frozen=True, eq=False)
class Page:
    """What a page shows around the scene.

    Attributes:
        title: shown above the legend.
        legend: text -> colour.
        camera: from where to look.
        curves: what is drawn over time.
        duration: of the whole run [s].
        marks: time [s] and words of what happens during it.
    """

    title: str
    legend: Mapping[str, int]
    camera: Camera
    curves: Sequence[Curve]
    duration: float
    marks: Sequence[tuple[float, str]] = ()

    def html(self, messages: str | None = None) -> str:
        """Return the page that holds its messages, or that reads them from its server.

        Raises:
            PinadaptError: meshcat's viewer is missing or speaks another language.
        """
        camera = {
            "target": self.camera.target.tolist(),
            "direction": self.camera.direction.tolist(),
            "box": self.camera.box.tolist(),
        }
        settings = {
            "camera": camera,
            "ghost": ghost().lower({}),
            "curves": [curve.settings() for curve in self.curves],
            "duration": self.duration,
            "marks": list(self.marks),
            "live": messages is None,
        }
        rows = (
            f'<div><i style="background:#{colour:06x}"></i>{escape(text)}</div>'
            for text, colour in self.legend.items()
        )
        template = Template((files(__package__) / "page.html").read_text(encoding="utf-8"))
        return template.substitute(
            title=escape(self.title),
            legend="".join(rows),
            viewer=_viewer(),
            messages=messages or "",
            settings=json.dumps(settings).replace("<", "\\u003c"),
        )


def _packed(data: bytes) -> str:
    return b64encode(gzip.compress(data, mtime=0)).decode("ascii")


def _viewer() -> str:
    """Return meshcat's viewer for browsers, packed."""
    path = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    try:
        source = path.read_bytes()
    except OSError as reason:
        raise PinadaptError(
            f"meshcat's viewer cannot be read: {reason}. Reinstall meshcat (0.3.2 or later)."
        ) from reason
    if b"handle_command_bytearray" not in source:
        raise PinadaptError(f"the viewer in {path} is of an unknown kind. Install meshcat 0.3.2.")
    return _packed(source)
