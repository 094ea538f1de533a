"""A rollout as a web page: the true robot, the believed one as a ghost, and what they follow."""

from __future__ import annotations

from pathlib import Path

import meshcat
import numpy as np
from meshcat.geometry import Sphere

from .._checks import positive
from .._files import write_text
from ..exceptions import InputError
from ..models.task_kinematics import TaskKinematics
from ..robot.chain import configuration_from_angles
from ..robot.robot import Robot
from ..robot.succession import Succession
from ..rollout.rollout import Rollout
from ..tasks.task import FrameTask
from .camera import Camera, camera_for
from .figure import Figure
from .keyframes import Keyframes
from .motion import Motion, motion_in_time, motion_of
from .page import Page
from .shapes import BELIEVED, BONES, DESIRED, TRUE, ghost, solid, tube

_MOST_FRAMES = 3000  # longer rollouts get fewer frames a second
_LINE_RATE = 60.0  # [1/s] samples of the paths


def write_animation(
    rollout: Rollout,
    true: Robot | Succession,
    believed: Robot,
    kinematics: TaskKinematics,
    path: Path,
    *,
    frames_per_second: int = 30,
) -> Path:
    """Write a self-contained page that shows a rollout in real time, over and over.

    The true robot moves along ``rollout.q`` in its own colours. The believed robot is a translucent
    ghost at the same measured q, its unknown translations at the estimate of that moment; it is
    visible where it differs. Each has a rod from its last joint to its tool. The desired path is
    green, the true tool and its path are red. All in world axes. Neither robot is written to, no
    server is started and no browser opened.

    Args:
        rollout: the run; with one sample or none the picture is still.
        true: the robot that was driven, with what it became where it changed.
        believed: the robot that the controller was made for.
        kinematics: the controller's unknown translations, which ``rollout.a_k`` (N, p_k) [m]
            estimates.
        path: file to write, whole or not at all; its folder is made if it is missing.
        frames_per_second: of the animation, at most one a sample.

    Returns:
        The path of the page.

    Raises:
        InputError: the rollout belongs to other robots, or frames_per_second is not positive.
        PinadaptError: meshcat's viewer cannot be used.
    """
    robots = true if isinstance(true, Succession) else Succession.of(true)
    true = robots.robots[0]
    _check(rollout, true, believed, kinematics)
    rate = positive(frames_per_second, "frames_per_second")
    some = len(rollout.t) > 0
    t, q = (rollout.t, rollout.q) if some else (np.zeros(1), true.q0[None])
    a_k = rollout.a_k if some else np.asarray(kinematics.initial)[None]
    frames, line = _samples(t, rate), _samples(t, max(rate, _LINE_RATE))
    truth = motion_in_time(robots, t[frames], q[frames])
    belief = motion_of(believed, q[frames], kinematics, a_k[frames])
    traced = motion_in_time(robots, t[line], q[line]).tip
    desired = traced.copy()  # coordinates outside of the task have no desired value
    if some:
        desired = _desired_path(true, desired, rollout.x_d[line])
    scene = _Scene(t[frames], camera_for(np.vstack([truth.points, desired]), desired))
    scene.draw_robots(true, believed, truth, belief)
    scene.lay_floor(float(min(traced[:, 2].min(), desired[:, 2].min())))
    if some:
        scene.draw_paths(traced, desired, np.searchsorted(line, frames))
    path = Path(path)
    write_text(path, scene.html(rollout.title or true.name))
    return path


class _Scene:
    """What is drawn on one page."""

    def __init__(self, t: np.ndarray, camera: Camera) -> None:
        self.page = Page()
        self.root = meshcat.Visualizer(window=self.page)
        self.keys = Keyframes(t)
        self.camera = camera
        self.size = camera.size

    def draw_robots(self, true: Robot, believed: Robot, truth: Motion, belief: Motion) -> None:
        """Draw the true robot and the ghost of the believed one."""
        solid_figure = Figure(self.root["true"], truth, self.keys, self.size)
        ghost_figure = Figure(self.root["believed"], belief, self.keys, self.size)
        meshed = true.visual is not None and len(true.visual.geometryObjects) > 0
        shared = meshed and believed.visual is true.visual
        if meshed:
            solid_figure.add_visuals(true.visual, true.model)
        else:
            solid_figure.stick_figure(solid(BONES), 0.025)
        if shared:
            ghost_figure.share_visuals(solid_figure, true.visual, self.page)
            ghost_figure.stick_figure(ghost(), 0.01, _elsewhere(truth, belief))
        else:
            ghost_figure.stick_figure(ghost(), 0.025)
        solid_figure.tool(solid(TRUE), 0.01)
        ghost_figure.tool(ghost(0.6), 0.01)
        solid_figure.move()
        ghost_figure.move()

    def draw_paths(self, traced: np.ndarray, desired: np.ndarray, reached: np.ndarray) -> None:
        """Draw the true and the desired path (L, 3) [m], and the desired point.

        Args:
            traced: (L, 3) where the true tool went.
            desired: (L, 3) where it should have gone.
            reached: (F) which of these points belongs to each frame.
        """
        paths = self.root["paths"]
        if len(traced) > 1:
            paths["desired"].set_object(tube(desired, 0.004 * self.size), solid(DESIRED))
            paths["true"].set_object(tube(traced, 0.005 * self.size), solid(TRUE))
            self.page.reveal(paths["true"].path.lower())
        paths["desired point"].set_object(Sphere(0.034 * self.size), ghost(0.5, DESIRED))
        self.keys.move(paths["desired point"], desired[reached])

    def lay_floor(self, lowest: float) -> None:
        """Put the grid to z = 0, or below the lowest point of the paths [m]."""
        wanted = self.size / 8.0
        decade = 10.0 ** np.floor(np.log10(wanted))
        spacing = decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted)
        floor = np.diag(
            [2.0 * spacing, 2.0 * spacing, 1.0, 1.0]
        )  # the viewer's own lines are 0.5 m apart
        floor[2, 3] = min(0.0, lowest - 0.05 * self.size)
        self.root["/Grid"].set_transform(floor)
        self.root["/Grid/<object>"].set_property("color", [1.0, 1.0, 1.0, 0.35])

    def html(self, title: str) -> str:
        """Return the page."""
        self.root["/Axes"].set_property("visible", False)
        self.root["/Background"].set_property("top_color", [0.97, 0.98, 0.99])
        self.root["/Background"].set_property("bottom_color", [0.84, 0.87, 0.91])
        self.root["/Lights/AmbientLight/<object>"].set_property("intensity", 0.4)
        self.keys.play(self.root)
        legend = {
            "true tool and its path": TRUE,
            "believed tool, and robot where it differs": BELIEVED,
            "desired point and path": DESIRED,
        }
        return self.page.html(title, legend, self.camera, ghost())


def _elsewhere(truth: Motion, belief: Motion) -> list[int]:
    """Return the joints whose origin, seen from their parent, is not where it truly is."""
    distance = np.abs(truth.origins - belief.origins).max(axis=(0, 2))
    return [int(index) for index in np.flatnonzero(distance > 1e-6)]


def _desired_path(true: Robot, traced: np.ndarray, x_d: np.ndarray) -> np.ndarray:
    """Return where the tool should have gone (L, 3) [m]; coordinates off the task as it went."""
    if isinstance(true.task, FrameTask):
        traced[:, true.task.place] = x_d[:, : true.task.positions]
        return traced
    return motion_of(true, np.array([configuration_from_angles(true.model, x) for x in x_d])).tip


def _samples(t: np.ndarray, rate: float) -> np.ndarray:
    """Return the indices of about ``rate`` samples a second, first and last among them."""
    wanted = int(np.clip(np.ceil((t[-1] - t[0]) * rate), 0, _MOST_FRAMES - 1)) + 1
    return np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], wanted)))


def _check(rollout: Rollout, true: Robot, believed: Robot, kinematics: TaskKinematics) -> None:
    if rollout.q.shape[1] != true.model.nq or believed.model.nq != true.model.nq:
        raise InputError(
            f"the rollout has {rollout.q.shape[1]} numbers a configuration, the true robot "
            f"{true.model.nq} and the believed one {believed.model.nq}.",
            where="rollout",
        )
    if rollout.a_k.shape[1] != kinematics.size:
        raise InputError(
            f"the rollout has {rollout.a_k.shape[1]} kinematic estimates, the parameters are "
            f"{kinematics.size}.",
            where="kinematics",
            hint="Take controller.kinematics of the controller that ran.",
        )
