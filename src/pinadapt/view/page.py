"""One web page: meshcat's viewer with a scene, a legend, and curves over time; a rollout as one."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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
from ..controller.controller import Controller
from ..exceptions import PinadaptError
from ..models.excited import Excited, names_together
from ..robot.robot import Robot, Succession
from ..tasks.frame import ImageTask
from ..tasks.task import RowGroup
from .drawing import DESIRED, TRUE, Keyframes, Window, framed, ghost
from .scene import Scene, desired_tip, estimated_axes, motion_in_time, motion_of


class Moment(NamedTuple):
    """What the curves are computed from.

    Attributes:
        t: time [s].
        x, x_d: true and desired task coordinates.
        a_k, a_d: (p_k), (p_d) estimates.
        torque_error: error of the torques that a_d predicts along the motion, relative to them.
        identifiable_error: error of a_d along what the motion excites, relative to the first one.
    """

    t: float
    x: np.ndarray
    x_d: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    torque_error: float | None = None
    identifiable_error: float | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """One number over time.

    Attributes:
        label, unit: shown with the number.
        read: returns the number at a moment; None where there is none.
    """

    label: str
    unit: str
    read: Callable[[Moment], float | None]

    def settings(self) -> dict[str, str]:
        """Return label and unit for the page."""
        return {"label": self.label, "unit": self.unit}


def curves_of(robots: Succession, controller: Controller, *, torques: bool = True) -> list[Curve]:
    """Return the curves of a loop: errors of the task, of translations, and of the torques."""
    task = robots.robots[0].task
    curves = [_error(task, group) for group in task.groups]
    if isinstance(task, ImageTask):
        curves.append(_at_tool(robots.robots[0], task))
    truths = [controller.kinematics.value(robot) for robot in robots.robots]
    known = all(truth is not None for truth in truths)
    if controller.kinematics.size and controller.kinematics.calibrated and known:
        curves.append(_translations(robots, truths))
    if not torques or not controller.dynamics.size:
        return curves
    curves.append(Curve("error of predicted torque", "%", _percent("torque_error")))
    truths = [controller.dynamics.value(robot) for robot in robots.robots]
    if all(truth is not None for truth in truths):
        read = _percent("identifiable_error")
        curves.append(Curve("identifiable parameters", "% of the start", read))
    return curves


def _percent(name: str) -> Callable[[Moment], float | None]:
    """Return a function that reads a share of a moment, in per cent."""

    def read(moment: Moment) -> float | None:
        """Return the share of a moment, in per cent."""
        share: float | None = getattr(moment, name)
        return None if share is None else 100.0 * share

    return read


def reading_of(curves: Sequence[Curve], moment: Moment) -> dict[str, Any]:
    """Return time and values of the curves at a moment; None for values that are not finite."""
    values = [curve.read(moment) for curve in curves]
    finite = [v if v is not None and np.isfinite(v) else None for v in map(_rounded, values)]
    return {"t": round(float(moment.t), 4), "values": finite}


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _error(task: Any, group: RowGroup) -> Curve:
    shown = group.shown

    def read(moment: Moment) -> float:
        """Return the size of the error at a moment."""
        return shown.scale * float(np.linalg.norm(task.error(moment.x, moment.x_d)[group.rows]))

    return Curve(f"{group.name} error", shown.unit, read)


def _at_tool(true: Robot, task: ImageTask) -> Curve:
    """Return about how far the tool is from where its picture is the desired one."""
    back = np.linalg.pinv(task.jacobian(true.placement(true.q0), np.eye(6)[:, :3]))

    def read(moment: Moment) -> float:
        """Return the distance at a moment [mm]."""
        return 1e3 * float(np.linalg.norm(back @ (moment.x - moment.x_d)))

    return Curve("at the tool, about", "mm", read)


def _translations(robots: Succession, truths: list[Any]) -> Curve:
    def read(moment: Moment) -> float:
        """Return the size of the error at a moment [mm]."""
        return 1e3 * float(np.linalg.norm(moment.a_k - truths[int(robots.index(moment.t))]))

    return Curve("error of tool and length estimates", "mm", read)


def not_excited_words(excited: Excited) -> str:
    """Return which parameters a motion does not excite, for the page."""
    still = [name for name, no in zip(excited.names, excited.still, strict=True) if no]
    return f"not excited by this motion: {names_together(still)}" if still else ""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Where the scene is seen from.

    Attributes:
        target: (3) centre of the box that is in the picture [m], world axes.
        direction: (3) unit vector from the centre towards the eye, world axes.
        box: (3) half the box's extent to the right, upwards and towards the eye [m].
    """

    target: np.ndarray
    direction: np.ndarray
    box: np.ndarray

    @property
    def size(self) -> float:
        """Half the larger side of the picture [m]."""
        return float(self.box[:2].max())


def viewpoint_for(points: np.ndarray, path: np.ndarray) -> Viewpoint:
    """Return a view from the front and somewhat from the side, chosen to show the path well.

    Args:
        points: (N, 3) points that must be in the picture [m].
        path: (M, 3) the tool's path [m].
    """
    right, up, direction = _axes(path)
    seen = points @ np.stack([right, up, direction], axis=1)  # (N, 3) along the picture's axes
    low, high = seen.min(axis=0), seen.max(axis=0)
    target = np.stack([right, up, direction], axis=1) @ (0.5 * (low + high))
    half = 0.5 * (high - low)
    margin = 0.2 * max(float(half.max()), 1e-3)  # bodies extend beyond the joints' origins
    return Viewpoint(target, direction, half + margin)


def _axes(path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (3) to the right, upwards and to the eye, chosen by the path's plane."""
    centre = path.mean(axis=0)
    normal = np.linalg.svd(path - centre)[2][-1] if len(path) > 2 else np.array([0.0, 0.0, 1.0])
    front = centre[:2] if np.linalg.norm(centre[:2]) > 1e-6 else np.array([1.0, 0.0])
    upright = abs(normal[2]) < 0.7
    if upright:
        front = normal[:2] * (1.0 if normal[:2] @ front >= 0.0 else -1.0)
    azimuth = np.arctan2(front[1], front[0]) - np.radians(35.0)
    elevation = np.radians(20.0 if upright else 50.0)
    c, s = np.cos(azimuth), np.sin(azimuth)
    direction = np.array([np.cos(elevation) * c, np.cos(elevation) * s, np.sin(elevation)])
    right = np.array([-s, c, 0.0])
    return right, np.cross(direction, right), direction


class Messages(Window):
    """Keeps all messages, for a page that contains them."""

    def __init__(self) -> None:
        """Make a window without messages."""
        self._messages: list[bytes] = []

    def keep(self, key: Any, message: bytes) -> None:
        """Append a message."""
        self._messages.append(message)

    def packed(self) -> str:
        """Return all messages, compressed, as text for the page."""
        return _packed(b"".join(framed(message) for message in self._messages))


@dataclass(frozen=True, eq=False)
class Page:
    """What a page shows around the scene.

    Attributes:
        title: shown above the legend.
        legend: text -> colour.
        viewpoint: where the scene is seen from.
        curves: drawn over time.
        duration: of the whole run [s].
        marks: time [s] and description of each event.
    """

    title: str
    legend: Mapping[str, int]
    viewpoint: Viewpoint
    curves: Sequence[Curve]
    duration: float
    marks: Sequence[tuple[float, str]] = ()

    def html(self, messages: str | None = None) -> str:
        """Return the page with these messages in it; None: it reads them from its server.

        Raises:
            PinadaptError: meshcat's viewer is missing, or of another version.
        """
        viewpoint = {
            "target": self.viewpoint.target.tolist(),
            "direction": self.viewpoint.direction.tolist(),
            "box": self.viewpoint.box.tolist(),
        }
        settings = {
            "viewpoint": viewpoint,
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


_LEVEL = 5  # of compression: higher ones take up to five times longer and save 1 % of a page


def _packed(data: bytes) -> str:
    return b64encode(gzip.compress(data, _LEVEL, mtime=0)).decode("ascii")


@cache
def _viewer() -> str:
    """Return meshcat's viewer for browsers, compressed, as text."""
    path = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    try:
        source = path.read_bytes()
    except OSError as reason:
        raise PinadaptError(
            f"meshcat's viewer cannot be read: {reason}. Reinstall meshcat (0.3.2 or later)."
        ) from reason
    if b"handle_command_bytearray" not in source:
        raise PinadaptError(
            f"the viewer in {path} is of an unknown version. Install meshcat 0.3.2."
        )
    return _packed(source)


# A rollout as a web page

_MOST_FRAMES = 900  # longer rollouts get fewer frames per second
_LINE_RATE = 60.0  # [1/s] samples of the paths
_MOST_POINTS = 2000  # of a path
_MOST_READINGS = 500  # of the curves


class Animation:
    """A page that shows a rollout in real time and repeats it; Jupyter displays it.

    The page contains everything it needs and works without a server or network.

    Attributes:
        html: the page.
        height: of the frame in a notebook [pixels].
    """

    def __init__(self, html: str, height: int = 480) -> None:
        """Take the page, and its height in a notebook [pixels]."""
        self.html, self.height = html, height

    def save(self, path: Path | str) -> Path:
        """Write the page to a file and return its path; a missing folder is made."""
        path = Path(path)
        write_text(path, self.html)
        return path

    def _repr_html_(self) -> str:
        """Return a frame that contains the page and separates it from the notebook."""
        style = f"width: 100%; height: {self.height}px; border: none"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}"></iframe>'

    def __repr__(self) -> str:
        """Return the size, as the page is too long to print."""
        return f"<Animation of {len(self.html) / 1e6:.1f} MB, .save(path) writes it>"


def animation_of(
    rollout: Any,
    robots: Succession,
    controller: Controller,
    *,
    frames_per_second: float = 30.0,
) -> Animation:
    """Return the animation of a rollout; with fewer than two samples it does not move.

    The true robot moves along ``rollout.q``. The estimated robot is a ghost at the same q, with the
    translations that are estimated at that moment. Curves show the errors of task and estimates.

    Args:
        rollout: a ``Rollout``, whose class imports this module.
        robots: the true robot, and what it changed to.
        controller: the controller of the run.
        frames_per_second: of the animation; there is at most one frame per sample.

    Raises:
        InputError: frames_per_second is not positive.
        PinadaptError: meshcat's viewer cannot be used.
    """
    rate = positive(frames_per_second, "frames_per_second")
    true, kinematics = robots.robots[0], controller.kinematics
    some = len(rollout.t) > 0
    t, q = (rollout.t, rollout.q) if some else (np.zeros(1), true.q0[None])
    a_k = rollout.a_k if some else np.asarray(kinematics.initial)[None]
    frames, line = _samples(t, rate, _MOST_FRAMES), _samples(t, _LINE_RATE, _MOST_POINTS)
    truth = motion_in_time(robots, t[frames], q[frames])
    estimated = motion_of(kinematics.robot, q[frames], kinematics, a_k[frames])
    traced = motion_in_time(robots, t[line], q[line]).tip
    desired = desired_tip(true, rollout.x_d[line], traced) if some else traced
    viewpoint = viewpoint_for(np.vstack([truth.points, desired]), desired)
    window, keys = Messages(), Keyframes(t[frames])
    scene = Scene(window, robots, kinematics, viewpoint.size)
    scene.place(t[frames], truth, estimated, keys)
    if some:
        scene.add_point()
        scene.move_point(desired[np.searchsorted(line, frames).clip(max=len(line) - 1)], keys)
        scene.add_path("desired", desired, DESIRED, 0.004)
        if (axes := estimated_axes(true, kinematics, a_k[frames])) is not None:
            scene.add_estimated_path(desired, 0.004)
            scene.move_estimated_path(axes, keys)
        scene.add_path("true", traced, TRUE, 0.005)
        window.note("reveal", reveal=scene.root["paths"]["true"].path.lower())
    curves = _curves(rollout, robots, controller, window)
    keys.play(scene.root)
    title, end = rollout.title or true.name, float(t[-1] - t[0])
    page = Page(title, scene.legend, viewpoint, curves, end, rollout.marks)
    return Animation(page.html(window.packed()))


def _curves(
    rollout: Any, robots: Succession, controller: Controller, window: Messages
) -> list[Curve]:
    """Return the curves of a rollout, and send their values to a window."""
    if not len(rollout.t):
        return []
    t = rollout.t
    readings = np.unique(np.linspace(0, len(t) - 1, _MOST_READINGS).astype(int))
    arrays = rollout.x, rollout.x_d, rollout.a_k, rollout.a_d
    predicted = _predictions(rollout, robots, controller)
    moments = [
        Moment(t[k], *(array[k] for array in arrays))._replace(**predicted(k)) for k in readings
    ]
    if (torques := rollout.motion_torques()) is not None:
        window.note("still", still=not_excited_words(torques.excited))
    curves = curves_of(robots, controller)
    for moment in moments:
        window.note(("reading", moment.t), reading=reading_of(curves, moment))
    return curves


def _predictions(
    rollout: Any, robots: Succession, controller: Controller
) -> Callable[[int], dict[str, Any]]:
    """Return a function from a sample to the two errors of its dynamic estimate, as of ``Moment``.

    They belong to the last true robot, and there is none before the last event.
    """
    torques, robot = rollout.motion_torques(), robots.robots[int(robots.index(rollout.t[-1]))]
    truth = controller.dynamics.value(robot)
    since = max((at for at, _ in rollout.marks), default=-np.inf)

    def read(k: int) -> dict[str, Any]:
        """Return the errors at a recorded sample."""
        if torques is None or rollout.t[k] < since:
            return {}
        a = rollout.a_d[k]
        left = None if truth is None else torques.left(a, truth)
        return {"torque_error": torques.share(a), "identifiable_error": left}

    return read


def _samples(t: np.ndarray, rate: float, most: int) -> np.ndarray:
    """Return the indices of about ``rate`` samples per second, with the first and the last."""
    wanted = int(np.clip(np.ceil((t[-1] - t[0]) * rate), 0, most - 1)) + 1
    return np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], wanted)))
