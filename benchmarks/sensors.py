"""The default law with realistic sensors, on six arms.

``make sensors.table`` runs the sweep ``sensors.toml`` and writes ``sensors.csv``: the case of the
zoo (tool, load, every inertia and the friction unknown, a circle) with perfect sensors, three
cameras, two encoders and a slow controller. The sensors are declared to each controller. Errors are
rms and largest of the last tenth of the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.zoo.experiment import zoo_case


@dataclass(frozen=True)
class Case:
    """Sensors and period of one column.

    Attributes:
        sensors: of the robot.
        dt: period [s].
    """

    sensors: pa.Sensors = field(default_factory=pa.Sensors)
    dt: float = 1e-3


CAMERA = pa.Camera(rate=30.0, delay=0.06)
CASES = {
    "1 kHz": Case(),
    "30 Hz 60 ms": Case(pa.Sensors(CAMERA)),
    "10 Hz 100 ms": Case(pa.Sensors(pa.Camera(rate=10.0, delay=0.1))),
    "30 Hz 60 ms 1 mm": Case(pa.Sensors(CAMERA, noise={"x": 1e-3})),
    "17 bit": Case(pa.Sensors(encoder=2.0 * math.pi / 2**17)),
    "14 bit": Case(pa.Sensors(encoder=2.0 * math.pi / 2**14)),
    "4 ms": Case(dt=4e-3),
}


def measure(robot: str, sensors: str, adaptation: str, duration: float) -> dict[str, Any]:
    """Return the errors of one robot with some sensors; the adaptation "" is the default."""
    case, zoo = CASES[sensors], zoo_case(robot)
    controller = pa.make_controller(
        zoo.estimated, adaptation=adaptation or None, dt=case.dt, sensors=case.sensors
    )
    rollout = pa.simulate(
        zoo.true,
        controller,
        zoo.motion,
        duration=duration,
        engine=pa.Engine(torque_limits=zoo.efforts_suffice),
        record_every=10,
        progress=False,
    )
    found: dict[str, Any] = {"radius_mm": 1e3 * zoo.radius}
    if rollout.diverged is not None:
        return found | {"status": "diverged", "reason": f"at {rollout.diverged:.1f} s"}
    last = rollout.distance[rollout.t > 0.9 * duration]
    return found | {
        "rms_mm": 1e3 * float(np.sqrt(np.mean(last**2))),
        "max_mm": 1e3 * float(last.max()),
    }


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown, by robot and sensors: rms and largest error [mm]."""
    columns = list(dict.fromkeys(row["sensors"] for row in rows))
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for robot in dict.fromkeys(row["robot"] for row in rows):
        own = [
            f"{row['rms_mm']:.2f} / {row['max_mm']:.2f}" if row["status"] == "done" else "lost"
            for row in rows
            if row["robot"] == robot
        ]
        lines.append(f"| {robot} | " + " | ".join(own) + " |")
    return "\n".join(lines)
