"""A tracker that nobody calibrated: the error while its axes are learned, and in the end.

``make tracker.table`` runs the sweep ``tracker.toml``. The tracker is turned against the base by
some angle about a random axis and stands up to a metre away in each coordinate. Unknown are that, a
tool of 5 % of the reach, a load of 5 % of the mass, every inertia (30 % too small in the model) and
friction and rotors, of which the arm has none. The arm follows a circle within its workspace for
8 s, begun at rest, with default gains at 500 Hz. It first wiggles its joints for two seconds, or
begins at once. Sensors are perfect, or the tracker has 30 frames a second that are 60 ms late with
noise of 1 mm.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa

DURATION, PERIOD = 8.0, 2e-3  # [s]
TOOL, LOAD, LIGHTER = 0.05, 0.05, 0.7  # of reach, mass and inertia
SENSORS = {
    "perfect": pa.Sensors(),
    "camera": pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": 1e-3}),
}


def measure(robot: str, angle: float, start: str, sensors: str) -> dict[str, Any]:
    """Return largest errors relative to the radius, and what was found of the tracker."""
    described = pa.load(robot)
    rng = np.random.default_rng(zlib.crc32(robot.encode()))
    axis, place = rng.standard_normal(3), rng.uniform(-1.0, 1.0, 3)
    turn = np.radians(angle) * axis / np.linalg.norm(axis)
    tool = TOOL * described.reach * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    load = pa.Payload(LOAD * described.mass)
    real = described.changed(tool_translation=tool, payload=load, inertial_scale=1.0 / LIGHTER)
    circle = pa.reachable_circle(described).starting_at(real.position(real.q0))
    R = pin.exp3(turn)

    def path(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x_d, xd_d, xdd_d = circle.at(t)
        return R @ x_d + place, R @ xd_d, R @ xdd_d

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light joints; the table has the result
        controller = pa.make_controller(
            described, unknown=pa.Unknown(tracker=True), sensors=SENSORS[sensors], dt=PERIOD
        )
        rollout = pa.simulate(
            real.seen_from(turn, place),
            controller,
            path,
            duration=DURATION,
            start=None if start == "wiggle" else {},
            progress=False,
        )
    radius, t = circle.extent, rollout.t
    if rollout.diverged is not None or not radius:
        return {
            "largest": None,
            "last": None,
            "status": "diverged",
            "reason": f"at {rollout.diverged} s",
        }
    return {
        "largest": float(rollout.distance.max() / radius),
        "last": float(rollout.distance[t > 0.9 * DURATION].max() / radius),
    }


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown: largest error of the run, of its last tenth, % of the radius."""
    angles = sorted({float(row["angle"]) for row in rows})
    head = ["start, sensors", "arm", *(f"{angle:g}°" for angle in angles)]
    lines = [head, ["---"] * len(head)]
    found = {(row["start"], row["sensors"], row["robot"], float(row["angle"])): row for row in rows}
    for start, sensors, robot in dict.fromkeys(key[:3] for key in found):
        cells = [_cell(found[start, sensors, robot, angle]) for angle in angles]
        lines.append([f"{start}, {sensors}", robot, *cells])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(row: Mapping[str, Any]) -> str:
    if row.get("largest") in (None, ""):
        return "lost"
    return f"{100.0 * row['largest']:.2g} / {100.0 * row['last']:.2g}"
