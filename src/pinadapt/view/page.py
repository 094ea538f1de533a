"""One web page: meshcat's viewer with a scene, a legend, and curves over time; a rollout as one."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from math import ceil
from pathlib import Path
from string import Template
from typing import Any

import meshcat
import numpy as np

from .._output import write_text
from .drawing import ghost
from .scene import RATE, Scene


def page(
    scene: Scene,
    title: str,
    duration: float,
    *,
    marks: Sequence[tuple[float, str]] = (),
    live: bool = False,
) -> str:
    """Return a page in HTML.

    Args:
        scene: what it shows, and the curves that it noted.
        title: shown above the legend.
        duration: of the whole run [s].
        marks: time [s] and description of each event.
        live: whether the page asks its server for messages, in place of containing them.
    """
    settings = {
        "viewpoint": scene.viewpoint,
        "ghost": ghost().lower({}),
        "curves": [{"label": label, "unit": unit} for label, unit in scene.units.items()],
        "duration": duration,
        "marks": marks,
        "live": live,
    }
    return Template((files(__package__) / "page.html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        legend="".join(
            f'<div><i style="background:#{colour:06x}"></i>{escape(text)}</div>'
            for text, colour in scene.legend.items()
        ),
        viewer=_viewer(),
        messages=_packed(b"" if live else scene.window.since(0)[1]),
        settings=json.dumps(settings).replace("<", "\\u003c"),
    )


def _packed(data: bytes) -> str:
    """Return data compressed, as text; higher levels take five times longer and save 1 %."""
    return b64encode(gzip.compress(data, 5, mtime=0)).decode("ascii")


@cache
def _viewer() -> str:
    """Return meshcat's viewer for browsers, compressed, as text."""
    return _packed((files(meshcat) / "viewer" / "dist" / "main.min.js").read_bytes())


# A rollout as a web page

_MOST = 2000  # frames and points of a path; half: of runs from 30 s on, twice: from 130 s on


@dataclass
class Animation:
    """A page that shows a rollout in real time and repeats it; Jupyter displays it.

    The page contains everything it needs and works without a server or network.

    Attributes:
        html: the page.
    """

    html: str

    def save(self, path: Path | str) -> Path:
        """Write the page to a file and return its path; a missing folder is made."""
        write_text(Path(path), self.html)
        return Path(path)

    def _repr_html_(self) -> str:
        """Return a frame that contains the page and separates it from the notebook."""
        return (
            f'<iframe srcdoc="{escape(self.html)}" '
            'style="width: 100%; height: 480px; border: none"></iframe>'
        )

    def __repr__(self) -> str:
        """Return the size, as the page is too long to print."""
        return f"<Animation of {len(self.html) / 1e6:.1f} MB, .save(path) writes it>"


def animation_of(rollout: Any) -> Animation:
    """Return the animation of a rollout; with fewer than two samples it does not move.

    The true robot moves along ``rollout.q``. The estimated robot is a ghost at the same q, with the
    translations that are estimated at that moment. Curves show the errors of task and estimates.

    Args:
        rollout: the ``Rollout``, whose class imports this module.

    Raises:
        InputError: the rollout has no robots.
    """
    run = rollout.evaluated()
    t, q, x_d, true = rollout.t, rollout.q, rollout.x_d, run.true.robots[0]
    if not len(t):  # it diverged at once
        t = np.zeros(1)
        q = true.q0[None]
        x_d = true.position(true.q0)[None]
    line = slice(None, None, ceil(len(t) / _MOST))
    wanted = min(ceil((t[-1] - t[0]) * RATE), _MOST - 1) + 1
    frames = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], wanted)))
    scene = Scene(run.true, run.controller, t[line], q[line], x_d[line], t[frames])
    if run.samples:
        scene.show([run.samples[k] for k in frames])
    for node in scene.add_paths("true", scene.traced):
        scene.window.note(("reveal", node.path), reveal=node.path.lower())
    scene.poses.play(scene.root)
    return Animation(page(scene, rollout.title or true.name, rollout.duration, marks=rollout.marks))
