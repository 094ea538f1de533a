"""The arm of ``tracker.py`` and ``image.py``, whose sensor of the tool is in unknown axes."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

import pinadapt as pa

from .shared import CAMERA, Row, diverged

DURATION, PERIOD = 8.0, 2e-3  # [s]
TOOL, LOAD, LIGHTER = 0.05, 0.05, 0.7  # of reach, mass and inertia


def random_of(robot: str) -> np.random.Generator:
    """Return the random numbers of a robot."""
    return np.random.default_rng(zlib.crc32(robot.encode()))


def spoiled(described: pa.Robot) -> pa.Robot:
    """Return the real robot of a described one."""
    tool = TOOL * described.reach * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    load = pa.Payload(LOAD * described.mass)
    return described.changed(tool_translation=tool, payload=load, inertial_scale=1.0 / LIGHTER)


def sensors_of(name: str, noise: float) -> pa.Sensors:
    """Return perfect sensors, or a camera with noise [m]."""
    return pa.Sensors(camera=CAMERA, noise={"x": noise}) if name == "camera" else pa.Sensors()


def errors(rollout: pa.Rollout, radius: float, duration: float) -> dict[str, Any]:
    """Return the largest error of a run and of its end, relative to the radius of the circle."""
    if rollout.diverged is not None:
        return diverged(rollout)
    late = rollout.t > duration - 0.1 * DURATION
    return {
        "largest": float(rollout.distance.max() / radius),
        "last": float(rollout.distance[late].max() / radius),
    }


def in_percent(row: Row) -> str:
    """Return the errors in per cent; "" without a row."""
    if not row:
        return ""
    if row["largest"] is None:
        return "lost"
    return f"{100.0 * row['largest']:.2g} / {100.0 * row['last']:.2g}"
