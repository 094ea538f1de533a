"""Rendered pictures of a coloured ball: MuJoCo draws them, OpenCV finds the ball, the loop runs.

``python -m benchmarks.rendered [PICTURE]`` needs the extras ``mujoco`` and ``camera``, and OpenGL:
without a display ``MUJOCO_GL=osmesa`` (Debian's libosmesa6) or ``MUJOCO_GL=egl``.

A UR5 has a green ball at the end of an unknown tool of 5 % of its reach, and an unknown load of 5 %
of its mass. MuJoCo moves it and draws it 30 times a second with a camera of 45 degrees that stands
1.2 m away; a picture of 640 x 480 pixels arrives 60 ms later. OpenCV's centre of the ball is all
that the controller sees: nothing of our projection is between. The joints wiggle for two seconds,
then the ball follows a circle of 50 pixels for 6 s with default gains at 250 Hz. Each centre is
compared with where MuJoCo's own camera has the site in the middle of the ball; the errors of the
loop are those of that projection at every sample. The frames, from 1.5 s on, of a third of a second
are covered up.
"""

from __future__ import annotations

import argparse
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.plants.mujoco_plant import mujoco_module
from pinadapt.plants.sensors import SimulatedSensors
from pinadapt.realtime import ball_centre
from pinadapt.simulation.simulate import wiggled

from .timing import HERE, markdown, save

SIZE, FIELD = (640, 480), 45.0  # pixels; [deg] of the picture's height
BALL, GREEN = 0.025, (90.0, 150.0)  # radius [m]; hue [deg]
RATE, LATE, PERIOD, DURATION = 30.0, 0.06, 0.004, 6.0
COVERED = (1.5, 1.83)  # [s]
RADIUS, TURN = 50.0, 3.0  # of the circle [pixels], [s]
VIEW = {"distance": 1.2, "azimuth": 150.0, "elevation": -20.0}  # of MuJoCo's free camera
CUT = slice(50, 330), slice(120, 480)  # of a picture that is written
FOCAL = 0.5 * SIZE[1] / np.tan(np.radians(FIELD) / 2.0)  # [pixels]
PIXEL = 0.002  # [m], about


class FilmedPlant(pa.plants.MujocoPlant):
    """MuJoCo's arm with a ball at its tool, before MuJoCo's camera.

    ``measure`` gives MuJoCo's projection of the tool in place of ours.
    """

    def __init__(self, robot: pa.Robot, target: np.ndarray, *, drawn: bool = True) -> None:
        """Place the camera's target (3) [m]."""
        super().__init__(robot, drawn=drawn)
        mj = mujoco_module()
        self.model.vis.global_.fovy = FIELD
        self.model.vis.headlight.ambient[:] = 0.45
        self.model.vis.headlight.diffuse[:] = 0.7
        self._camera = mj.MjvCamera()
        self._camera.lookat[:] = target
        for name, value in VIEW.items():
            setattr(self._camera, name, value)
        self._renderer = mj.Renderer(self.model, SIZE[1], SIZE[0])

    def picture(self) -> np.ndarray:
        """Return the picture (h, w, 3) of this moment: blue, green, red."""
        mj, scene = mujoco_module(), self._draw()
        ball, site = scene.geoms[scene.ngeom], self.data.site_xpos[self._chain.site]
        colour = np.array([0.1, 0.8, 0.2, 1.0], dtype=np.float32)
        kind, size = mj.mjtGeom.mjGEOM_SPHERE, np.full(3, BALL)
        mj.mjv_initGeom(ball, kind, size, site, np.eye(3).ravel(), colour)
        scene.ngeom += 1
        return np.ascontiguousarray(self._renderer.render()[:, :, ::-1])

    def close(self) -> None:
        """Free the renderer, of which there is one at a time: two in a process spoil each other."""
        self._renderer.close()

    def _draw(self) -> Any:
        """Return MuJoCo's scene of this moment, with its camera."""
        self._renderer.update_scene(self.data, self._camera)
        return self._renderer.scene

    def projected(self) -> np.ndarray:
        """Return where MuJoCo's camera has the site in the middle of the ball (2) [pixels]."""
        eye = mujoco_module().mjv_averageCamera(*self._draw().camera)
        forward, up = np.array(eye.forward), np.array(eye.up)
        seen = self.data.site_xpos[self._chain.site] - np.array(eye.pos)
        place = np.array([np.cross(forward, up) @ seen, -up @ seen]) / (forward @ seen)
        return FOCAL * place + 0.5 * (np.array(SIZE) - 1.0)

    def measure(self) -> pa.Measurement:
        """Return what ideal sensors measure now, with the picture by MuJoCo."""
        return super().measure()._replace(x=PIXEL * self.projected(), xd=None)


class Film(SimulatedSensors):
    """Sensors whose frames are rendered pictures, in which OpenCV looks for the ball."""

    def __init__(self, plant: FilmedPlant, robot: pa.Robot) -> None:
        """Film a plant from now on."""
        self._plant, self.rows = plant, list[tuple[np.ndarray | None, np.ndarray]]()
        super().__init__(robot, PERIOD, pa.Sensors())

    def reset(self) -> None:
        """Discard the pictures that have not arrived."""
        super().reset()
        self._coming = deque[tuple[float, np.ndarray | None]]()
        self._taken = 0

    def measure(self, truth: pa.Measurement, torque: np.ndarray | None = None) -> pa.Measurement:
        """Return the next sample, with the centre of a ball in a picture that arrives at it."""
        seen = super().measure(truth, torque)._replace(x=None, x_time=None, xd=None)
        if truth.t >= self._taken / RATE - 1e-9:
            self._taken += 1
            picture = self._plant.picture()
            if self.covers(truth.t):
                picture[:] = 0
            found = ball_centre(picture, GREEN)
            self.rows.append((found, self._plant.projected()))
            self._coming.append((truth.t, found))
            if truth.t == 0.0 and found is not None:
                return seen._replace(x=PIXEL * found, x_time=0.0)
        if not self._coming or truth.t < self._coming[0][0] + LATE - 1e-9:
            return seen
        taken, found = self._coming.popleft()
        return seen if found is None else seen._replace(x=PIXEL * found, x_time=taken)

    def covers(self, t: float) -> bool:
        """Return whether something stands before the camera at a time [s]."""
        return bool(COVERED[0] <= t <= COVERED[1])


class Uncovered(Film):
    """The same with nothing before the camera."""

    def covers(self, t: float) -> bool:
        """Nothing does."""
        return False


def filmed(name: str, *, drawn: bool = True) -> tuple[pa.Robot, FilmedPlant]:
    """Return a robot as the controller has it, and the plant with tool, load and ball."""
    robot = pa.load(name)
    tool = 0.05 * robot.reach * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    true = robot.changed(tool_translation=tool, payload=pa.Payload(0.05 * robot.mass))
    plant = FilmedPlant(true, robot.placement(robot.q0).translation, drawn=drawn)
    return robot.filmed_by(pixel=PIXEL), plant


def measure(
    name: str, drawing: Path | None = None, *, duration: float = DURATION, drawn: bool = True
) -> dict[str, Any]:
    """Return how far OpenCV's centres are from the projection, and the errors of the loop.

    Args:
        name: of the robot.
        drawing: file of a picture with the found centre and the desired path, or None.
        duration: of the circle [s].
        drawn: whether the arm is in the pictures, or the ball alone.
    """
    believed, plant = filmed(name, drawn=drawn)
    declared = pa.Sensors(camera=pa.Camera(rate=RATE, delay=LATE), noise={"x": 0.1 * PIXEL})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light joints
        controller = pa.make_controller(believed, sensors=declared, dt=PERIOD)
    a_k = wiggled(plant, controller, PERIOD, Uncovered(plant, believed))["a_k"]
    y_0 = plant.measure().x
    assert y_0 is not None

    def circle(t: float) -> np.ndarray:
        phi = 2.0 * np.pi * t / TURN
        return np.asarray(y_0 + RADIUS * PIXEL * np.array([1.0 - np.cos(phi), np.sin(phi)]))

    motion = pa.reference.starting_from(circle, believed, plant.measure())
    film = Film(plant, believed)
    state, errors, path = controller.init(plant.measure(), a_k=a_k), [], []
    loop = pa.simulation.run(
        plant, controller, motion, dt=PERIOD, state=state, sensors=film, duration=duration
    )
    for sample in loop:
        assert sample.truth.x is not None
        errors.append(np.linalg.norm(sample.truth.x - sample.desired.x_d) / PIXEL)
        path.append(sample.truth.x / PIXEL)
        if drawing is not None and sample.t >= 0.4 * duration:
            _draw(plant.picture(), np.array([circle(0.01 * k) for k in range(300)]), path, drawing)
            drawing = None
    plant.close()
    off = np.array([found - place for found, place in film.rows if found is not None])
    last = errors[-len(errors) // 10 :]
    eye = VIEW["distance"]
    return {
        "name": name,
        "pictures": len(film.rows),
        "unseen": sum(found is None for found, _ in film.rows),
        "mean": off.mean(axis=0).tolist(),
        "deviation": off.std(axis=0).tolist(),
        "off": float(np.linalg.norm(off, axis=1).max()),
        "ball": float(FOCAL * BALL / eye),
        "largest": float(max(errors)),
        "last": float(max(last)),
        "last_mm": float(1e3 * max(last) * eye / FOCAL),
    }


def _draw(picture: np.ndarray, desired: np.ndarray, path: Sequence[np.ndarray], to: Path) -> None:
    """Write a picture with the desired path, the way so far, and the centre that OpenCV finds."""
    import cv2

    fine = 4  # binary digits of fractions of pixels
    found = ball_centre(picture, GREEN)
    for points, colour in ((desired / PIXEL, (90, 90, 90)), (np.array(path), (40, 40, 220))):
        corners = np.round(points * 2**fine).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [corners], False, colour, 1, cv2.LINE_AA, fine)
    if found is not None:
        u, v = (round(each) for each in found)
        for end in ((u - 14, v, u + 14, v), (u, v - 14, u, v + 14)):
            cv2.line(picture, end[:2], end[2:], (255, 255, 255), 1, cv2.LINE_AA)
    rows, columns = CUT
    cv2.imwrite(str(to), picture[rows, columns])


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown."""
    head = [
        "arm",
        "pictures, ball not seen",
        "radius of the ball",
        "centre less projection, mean (u, v)",
        "deviation (u, v)",
        "largest",
        "error of the loop, largest",
        "last tenth",
    ]
    lines = [
        [
            row["name"],
            f"{row['pictures']}, {row['unseen']}",
            f"{row['ball']:.1f} px",
            *(
                ", ".join(f"{each:.2f}" for each in row[key]) + " px"
                for key in ("mean", "deviation")
            ),
            f"{row['off']:.2f} px",
            f"{row['largest']:.2g} px",
            f"{row['last']:.2g} px, {row['last_mm']:.2g} mm",
        ]
        for row in rows
    ]
    return markdown(head, lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, draw, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drawing", nargs="?", type=Path, help="picture to write")
    options = parser.parse_args(arguments)
    rows = [measure("ur5", options.drawing), measure("panda")]
    print(report(rows))
    save(HERE / "rendered.json", rows)


if __name__ == "__main__":
    main()
