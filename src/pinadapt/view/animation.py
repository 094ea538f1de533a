"""A rollout as a web page: the true robot, the estimated one as a ghost, and the desired path."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .._checks import positive
from .._output import write_text
from ..controller.controller import Controller
from ..information.information import MotionTorques
from ..robot.succession import Succession
from .page import (
    Curve,
    Messages,
    Moment,
    Page,
    curves_of,
    not_excited_words,
    reading_of,
    viewpoint_for,
)
from .scene import Scene, ShownEstimates, desired_tip, motion_in_time, motion_of
from .shapes import DESIRED, TRUE
from .window import Keyframes

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


class Animatable(Protocol):
    """What the animation needs of a run of N samples; ``Rollout`` has it."""

    @property
    def title(self) -> str:
        """Title of the page."""

    @property
    def t(self) -> np.ndarray:
        """Time (N) [s]."""

    @property
    def q(self) -> np.ndarray:
        """True configurations (N, nq)."""

    @property
    def x(self) -> np.ndarray:
        """True task coordinates (N, .)."""

    @property
    def x_d(self) -> np.ndarray:
        """Desired task coordinates (N, .)."""

    @property
    def a_k(self) -> np.ndarray:
        """Kinematic estimates (N, p_k) [m]."""

    @property
    def a_d(self) -> np.ndarray:
        """Dynamic estimates (N, p_d)."""

    def motion_torques(self) -> MotionTorques | None:
        """Return the torques since the last event, and which parameters they depend on."""

    @property
    def marks(self) -> tuple[tuple[float, str], ...]:
        """Time [s] and description of each event during the run."""


def animation_of(
    rollout: Animatable,
    robots: Succession,
    controller: Controller,
    *,
    frames_per_second: float = 30.0,
) -> Animation:
    """Return the animation of a rollout; with fewer than two samples it does not move.

    The true robot moves along ``rollout.q``. The estimated robot is a ghost at the same q, with the
    translations that are estimated at that moment. Curves show the errors of task and estimates.

    Args:
        rollout: the run.
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
    drawn = ShownEstimates(robots, kinematics).at(t[frames], a_k[frames])
    estimated = motion_of(kinematics.robot, q[frames], kinematics, drawn)
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
        scene.add_path("true", traced, TRUE, 0.005)
        window.note("reveal", reveal=scene.root["paths"]["true"].path.lower())
    curves = _curves(rollout, robots, controller, window)
    keys.play(scene.root)
    title, end = rollout.title or true.name, float(t[-1] - t[0])
    page = Page(title, scene.legend, viewpoint, curves, end, rollout.marks)
    return Animation(page.html(window.packed()))


def _curves(
    rollout: Animatable, robots: Succession, controller: Controller, window: Messages
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
    rollout: Animatable, robots: Succession, controller: Controller
) -> Callable[[int], dict[str, Any]]:
    """Return a function from a sample to the two errors of its dynamic estimate, as of ``Moment``.

    They belong to the last true robot, and there is none before the last event.
    """
    torques, robot = rollout.motion_torques(), robots.robots[int(robots.index(rollout.t[-1]))]
    truth = controller.dynamics.value(robot)
    since = max((at for at, _ in rollout.marks), default=-np.inf)

    def read(k: int) -> dict[str, Any]:
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
