"""A run watched in a browser while it goes on, at most in real time."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from time import perf_counter, sleep
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from ..controller.controller import Controller
from ..exceptions import DivergedError
from ..robot.robot import Robot
from ..robot.succession import Succession
from ..trajectories.trajectory import Trajectory
from .browser import open_in_browser
from .camera import camera_for
from .curves import Moment, curves_of, reading_of
from .keyframes import Poses
from .motion import desired_tip, motion_in_time, motion_of
from .page import Page
from .scene import Scene
from .server import Broadcast, Server
from .shapes import DESIRED, TRUE

if TYPE_CHECKING:
    from ..rollout.sample import Sample

_RATE = 30.0  # [1/s] frames
_PIECE = 30  # frames of the traced path that are drawn as one
_ARRIVAL = 10.0  # [s] for a browser that was opened to show the page
_DESIRED_POINTS = 600


class LiveView:
    """A page that shows a run as it goes on; close it, or use it in a ``with`` statement.

    The server is a thread of this process and answers this machine alone. Where there is a display
    a browser is opened; the address is told on standard error in any case, and browsers may come
    and go at any time.

    ```
    with LiveView(true, controller, trajectory, duration=10.0) as view:
        for sample in view.watch(pa.run(plant, controller, trajectory, duration=10.0)):
            ...
    ```

    Attributes:
        url: of the page.
    """

    def __init__(
        self,
        true: Robot,
        controller: Controller,
        trajectory: Trajectory,
        *,
        duration: float,
        changes: Mapping[float, Robot] | None = None,
        title: str = "",
        browser: bool = True,
        port: int = 0,
    ) -> None:
        """Draw the scene and start its server.

        Args:
            true: the robot that is driven.
            controller: what drives it.
            trajectory: the desired motion.
            duration: of the run, or of what is shown of the desired path [s].
            changes: time [s] -> the true robot from then on.
            title: of the page.
            browser: whether to open one where there is a display.
            port: of the server, 0 for any free one.

        Raises:
            PinadaptError: meshcat's viewer cannot be used.
            OSError: the port cannot be had.
        """
        self._robots, self._controller = Succession.of(true, changes), controller
        self._curves = curves_of(self._robots, controller)
        self._window, self._poses = Broadcast(), Poses()
        self._started: float | None = None
        self._next = 0.0
        self._last: Sample | None = None
        self._end = "the run has ended"
        self._traced: list[np.ndarray] = []
        here = motion_of(true, true.q0[None])
        t = np.linspace(0.0, duration, _DESIRED_POINTS)
        path = desired_tip(true, np.array([trajectory.at(at).x_d for at in t]), here.tip[0])
        camera = camera_for(np.vstack([here.points, path]), path)
        self._scene = Scene(self._window, self._robots, controller.kinematics, camera.size)
        self._scene.add_point()
        self._scene.add_path("desired", path, DESIRED, 0.004)
        page = Page(title or true.name, self._scene.legend, camera, self._curves, duration)
        self._server = Server(page.html(), self._window, port)
        self.url = self._server.url
        print(f"live view: {self.url}", file=sys.stderr, flush=True)
        if browser and open_in_browser(self.url):
            self._window.wait_for_reader(_ARRIVAL)

    def watch(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        """Yield the samples of a run as they come, at most in real time, and show them."""
        try:
            for sample in samples:
                self._last = sample
                if sample.t >= self._next:
                    self.show(sample)
                yield sample
        except DivergedError as error:
            self._end = f"diverged at {error.time:.2f} s"
            raise
        except KeyboardInterrupt:
            self._end = "interrupted"
            raise

    def show(self, sample: Sample) -> None:
        """Show one sample, not before its time."""
        now = perf_counter()
        if self._started is None:
            self._started = now - sample.t
        sleep(max(0.0, self._started + sample.t - now))
        self._next = sample.t + 1.0 / _RATE
        self._draw(sample)

    def _draw(self, sample: Sample) -> None:
        q, a_k = sample.truth.q, sample.state.a_k
        if not (np.isfinite(q).all() and np.isfinite(a_k).all()):
            return
        t = np.array([sample.t])
        truth = motion_in_time(self._robots, t, q[None])
        kinematics = self._controller.kinematics
        belief = motion_of(kinematics.robot, q[None], kinematics, a_k[None])
        self._scene.place(t, truth, belief, self._poses)
        desired = desired_tip(self._robots.robots[0], sample.desired.x_d[None], truth.tip)
        self._scene.move_point(desired, self._poses)
        self._trace(truth.tip[0])
        assert sample.truth.x is not None  # perfect sensors see the task
        moment = Moment(sample.t, sample.truth.x, sample.desired.x_d, a_k, sample.state.a_d)
        self._window.note(("reading", sample.t), reading=reading_of(self._curves, moment))

    def close(self) -> None:
        """Show the last sample, let browsers read the rest, and end the server.

        The page stays as it is.
        """
        if self._last is not None:
            self._draw(self._last)
        self._window.note("end", end=self._end)
        self._server.close()

    def __enter__(self) -> LiveView:
        """Return this view."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the view."""
        if error is not None:
            self._end = "the run has stopped"
        self.close()

    def _trace(self, tip: np.ndarray) -> None:
        """Draw the traced path up to a point (3) [m], the last piece of it anew."""
        self._traced.append(tip)
        first = (len(self._traced) - 2) // _PIECE * _PIECE
        piece = np.array(self._traced[max(first, 0) :])
        self._scene.add_path(f"true/{first}", piece, TRUE, 0.005)
