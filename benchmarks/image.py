"""Pictures in uncalibrated cameras: the error while they are learned, and in the end.

``make image.table`` runs the sweep ``image.toml``. One fixed camera sees a point of the tool, or
two do. They stand two reaches away from it, look at it from somewhere above, and the reach covers
500 pixels. Unknown are the cameras, the tool (5 % of the reach), a load of 5 % of the mass, every
inertia (30 % too small in the model), friction and rotors. The picture of the point follows that of
a circle within the workspace for 8 s, begun at rest, with default gains at 500 Hz, after an
excitation of two seconds. Sensors are perfect, or there are 30 pictures a second that are 60 ms
late, with noise of half a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import pinadapt as pa

from .shared import Row, markdown, quiet
from .uncalibrated import DURATION, PERIOD, errors, in_percent, random_of, sensors_of, spoiled

AWAY, PIXELS = 2.0, 500.0  # reaches; a reach


def camera_at(robot: pa.Robot, direction: np.ndarray) -> np.ndarray:
    """Return a camera (3, 4) that looks at the frame at home from a direction (3), v upwards."""
    p = robot.placement(robot.q0).translation
    away = AWAY * robot.reach
    eye = p + away * direction / np.linalg.norm(direction)
    return np.diag([1.0, -1.0, 1.0]) @ pa.tasks.pinhole_camera(eye, p, away)


@quiet()
def measure(robot: str, cameras: int, sensors: str) -> dict[str, Any]:
    """Return largest errors relative to the radius of the circle's picture, and in pixels."""
    described = pa.load(robot)
    rng = random_of(robot)
    eyes = [
        camera_at(described, np.append(rng.standard_normal(2), rng.uniform(0.3, 1.5)))
        for _ in range(cameras)
    ]
    real = spoiled(described)
    circle = pa.reachable_circle(described).starting_at(real.position(real.q0))
    filmed = real.filmed_by(*eyes)
    rest = real.placement(real.q0)
    place = slice(0, circle.at(0.0).x_d.size)
    rows = np.arange(3)[getattr(real.task, "place", place)]

    def path(t: float) -> np.ndarray:
        seen = rest.copy()
        seen.translation[rows] = circle.at(t).x_d
        return np.asarray(filmed.task.of(seen))  # type: ignore[attr-defined]

    pixel = described.reach / PIXELS
    controller = pa.make_controller(
        described.filmed_by(count=cameras), sensors=sensors_of(sensors, 0.5 * pixel), dt=PERIOD
    )
    rollout = pa.simulate(filmed, controller, path, duration=DURATION, progress=False)
    found = errors(rollout, rollout.extent, DURATION)
    if rollout.diverged is None:
        found["pixels"] = found["last"] * rollout.extent / pixel
    return found


def report(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: largest error of the run, of its last tenth, and in pixels."""
    robots = list(dict.fromkeys(row["robot"] for row in rows))
    found = {(row["cameras"], row["sensors"], row["robot"]): row for row in rows}
    lines = []
    for cameras, sensors in dict.fromkeys(key[:2] for key in found):
        cells = [_cell(found.get((cameras, sensors, robot), {})) for robot in robots]
        lines.append([f"{cameras:g}, {sensors}", *cells])
    return markdown(["cameras, sensors", *robots], lines)


def _cell(row: Row) -> str:
    pixels = row.get("pixels")
    return in_percent(row) if pixels is None else f"{in_percent(row)} ({pixels:.2g} px)"
