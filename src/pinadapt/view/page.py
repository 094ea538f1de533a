"""One web page: meshcat's viewer with a scene, a legend, and curves over time; a rollout as one."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import meshcat
import numpy as np

from .._checks import positive
from .._output import write_text
from .drawing import ghost
from .scene import Scene, desired_tips, motion_in_time


class Curve(NamedTuple):
    """What a curve over time shows."""

    label: str
    unit: str


Curves = dict[Curve, np.ndarray]
"""One number a sample (N) for each curve."""


def task_curves(
    scene: Scene, t: np.ndarray, x: np.ndarray, x_d: np.ndarray, a_k: np.ndarray
) -> Curves:
    """Return the errors of the task and of estimated translations.

    Args:
        scene: of the page.
        t: (N) time [s].
        x: (N, .) true task coordinates.
        x_d: (N, .) desired ones.
        a_k: (N, p_k) estimates.
    """
    robots, kinematics = scene.robots, scene.kinematics
    task, found = robots.robots[0].task, Curves()
    error = np.array([task.error(*both) for both in zip(x, x_d, strict=True)])
    for group in task.groups:
        unit, scale = group.shown
        size = np.linalg.norm(error[:, group.rows], axis=1)
        found[Curve(f"{group.name} error", unit)] = scale * size
    truths = [kinematics.value(robot) for robot in robots.robots]
    known = not any(truth is None for truth in truths)
    if known and kinematics.size and kinematics.calibrated:
        off = np.linalg.norm(a_k - np.array(truths)[robots.index(t)], axis=1)
        found[Curve("error of tool and length estimates", "mm")] = 1e3 * off
    return found


def note_readings(scene: Scene, t: np.ndarray, curves: Curves) -> None:
    """Note the values of the curves at times t (N) [s]; null where they are not finite."""
    for moment, values in zip(t.round(4).tolist(), np.array([*curves.values()]).T, strict=True):
        shown = [float(f"{v:.4g}") if np.isfinite(v) else None for v in values]
        scene.window.note(("reading", moment), reading={"t": moment, "values": shown})


def page(
    scene: Scene,
    title: str,
    curves: Iterable[Curve],
    duration: float,
    *,
    marks: Sequence[tuple[float, str]] = (),
    live: bool = False,
) -> str:
    """Return a page in HTML.

    Args:
        scene: what it shows.
        title: shown above the legend.
        curves: drawn over time.
        duration: of the whole run [s].
        marks: time [s] and description of each event.
        live: whether the page asks its server for messages, in place of containing them.
    """
    settings = {
        "viewpoint": {name: part.tolist() for name, part in scene.viewpoint._asdict().items()},
        "ghost": ghost().lower({}),
        "curves": [curve._asdict() for curve in curves],
        "duration": duration,
        "marks": marks,
        "live": live,
    }
    rows = (
        f'<div><i style="background:#{colour:06x}"></i>{escape(text)}</div>'
        for text, colour in scene.legend.items()
    )
    template = Template((files(__package__) / "page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(title),
        legend="".join(rows),
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
    path = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    return _packed(path.read_bytes())


# A rollout as a web page

_MOST = 2000  # frames and points of a path; half: of runs from 30 s on, twice: from 130 s on


class Animation:
    """A page that shows a rollout in real time and repeats it; Jupyter displays it.

    The page contains everything it needs and works without a server or network.

    Attributes:
        html: the page.
    """

    def __init__(self, html: str) -> None:
        """Take the page."""
        self.html = html

    def save(self, path: Path | str) -> Path:
        """Write the page to a file and return its path; a missing folder is made."""
        write_text(Path(path), self.html)
        return Path(path)

    def _repr_html_(self) -> str:
        """Return a frame that contains the page and separates it from the notebook."""
        style = "width: 100%; height: 480px; border: none"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}"></iframe>'

    def __repr__(self) -> str:
        """Return the size, as the page is too long to print."""
        return f"<Animation of {len(self.html) / 1e6:.1f} MB, .save(path) writes it>"


def animation_of(rollout: Any, *, frames_per_second: float = 30.0) -> Animation:
    """Return the animation of a rollout; with fewer than two samples it does not move.

    The true robot moves along ``rollout.q``. The estimated robot is a ghost at the same q, with the
    translations that are estimated at that moment. Curves show the errors of task and estimates.

    Args:
        rollout: the ``Rollout``, whose class imports this module.
        frames_per_second: of the animation; there is at most one frame per sample.

    Raises:
        InputError: frames_per_second is not positive, or the rollout has no robots.
    """
    rate, run = positive(frames_per_second, "frames_per_second"), rollout.evaluated()
    robots, kinematics = run.true, run.controller.kinematics
    true = robots.robots[0]
    t, q, x, x_d, a_k = rollout.t, rollout.q, rollout.x, rollout.x_d, rollout.a_k
    if not len(t):  # it diverged at once
        home, here = true.q0, true.position(true.q0)
        t, q, x, x_d, a_k = (
            np.array([each]) for each in (0.0, home, here, here, kinematics.initial)
        )
    line = np.unique(np.linspace(0, len(t) - 1, _MOST).astype(int))
    traced = motion_in_time(robots, t[line], q[line])
    wanted = int(np.clip(np.ceil((t[-1] - t[0]) * rate), 0, _MOST - 1)) + 1
    frames = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], wanted)))
    path = desired_tips(true, x_d[line], traced.tips)
    scene = Scene(robots, kinematics, traced, path, t[frames])
    t, q, x, x_d, a_k = (part[frames] for part in (t, q, x, x_d, a_k))
    scene.show(t, q, x_d, a_k)
    if len(traced.tips) > 1:
        for node in scene.add_traces("true", traced.tips):
            scene.window.note(("reveal", node.path), reveal=node.path.lower())
    curves = task_curves(scene, t, x, x_d, a_k)
    note_readings(scene, t, curves)
    scene.poses.play(scene.root)
    title = rollout.title or true.name
    html = page(scene, title, curves, rollout.duration, marks=rollout.marks)
    return Animation(html)
