"""Pictures in uncalibrated cameras: the error while they are learned, and in the end.

``make image.table`` runs the sweep ``image.toml``. One fixed camera sees a point of the tool, or
two do. They stand two reaches away from it, look at it from somewhere above, and the reach covers
500 pixels. Unknown are the cameras, the tool (5 % of the reach), a load of 5 % of the mass, every
inertia (30 % too small in the model), friction and rotors. The picture of the point follows that of
a circle within the workspace for 8 s, begun at rest, with default gains at 500 Hz, after a wiggle
of two seconds. Sensors are perfect, or there are 30 pictures a second that are 60 ms late, with
noise of half a pixel.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import pinadapt as pa

from .timing import markdown, run_errors

DURATION, PERIOD = 8.0, 2e-3  # [s]
TOOL, LOAD, LIGHTER = 0.05, 0.05, 0.7  # of reach, mass and inertia
AWAY, PIXELS = 2.0, 500.0  # reaches; a reach


def camera_at(robot: pa.Robot, direction: np.ndarray) -> np.ndarray:
    """Return a camera (3, 4) that looks at the frame at home from a direction (3), v upwards."""
    p, away = robot.placement(robot.q0).translation, AWAY * robot.reach
    eye = p + away * direction / np.linalg.norm(direction)
    return np.diag([1.0, -1.0, 1.0]) @ pa.tasks.pinhole_camera(eye, p, away)


def measure(robot: str, cameras: int, sensors: str) -> dict[str, Any]:
    """Return largest errors relative to the radius of the circle's picture, and in pixels."""
    described = pa.load(robot)
    rng = np.random.default_rng(zlib.crc32(robot.encode()))
    eyes = [
        camera_at(described, np.append(rng.standard_normal(2), rng.uniform(0.3, 1.5)))
        for _ in range(cameras)
    ]
    tool = TOOL * described.reach * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    load = pa.Payload(LOAD * described.mass)
    real = described.changed(tool_translation=tool, payload=load, inertial_scale=1.0 / LIGHTER)
    circle = pa.reachable_circle(described).starting_at(real.position(real.q0))
    filmed = real.filmed_by(*eyes)
    rest, place = real.placement(real.q0), slice(0, circle.at(0.0).x_d.size)
    rows = np.arange(3)[getattr(real.task, "place", place)]

    def path(t: float) -> np.ndarray:
        seen = rest.copy()
        seen.translation[rows] = circle.at(t).x_d
        return np.asarray(filmed.task.of(seen))  # type: ignore[attr-defined]

    pixel = described.reach / PIXELS
    camera = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": 0.5 * pixel})
    believed = described.filmed_by(count=cameras)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the table has the result
        controller = pa.make_controller(
            believed, sensors=camera if sensors == "camera" else pa.Sensors(), dt=PERIOD
        )
        rollout = pa.simulate(filmed, controller, path, duration=DURATION, progress=False)
    if rollout.diverged is not None:
        return {
            "largest": None,
            "last": None,
            "pixels": None,
            "status": "diverged",
            "reason": f"at {rollout.diverged} s",
        }
    radius, late = rollout.extent, rollout.t > 0.9 * DURATION
    return {
        "largest": float(rollout.distance.max() / radius),
        "last": float(rollout.distance[late].max() / radius),
        "pixels": float(rollout.distance[late].max() / pixel),
    }


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown: largest error of the run, of its last tenth, and in pixels."""
    robots = list(dict.fromkeys(row["robot"] for row in rows))
    head = ["cameras, sensors", *robots]
    lines = []
    found = {(int(row["cameras"]), row["sensors"], row["robot"]): row for row in rows}
    for cameras, sensors in dict.fromkeys(key[:2] for key in found):
        cells = [_cell(found.get((cameras, sensors, robot), {})) for robot in robots]
        lines.append([f"{cameras}, {sensors}", *cells])
    return markdown(head, lines)


def _cell(row: Mapping[str, Any]) -> str:
    pixels = row.get("pixels")
    return run_errors(row) if pixels in (None, "") else f"{run_errors(row)} ({pixels:.2g} px)"
