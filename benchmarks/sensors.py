"""The default law with realistic sensors, on six arms.

``python -m benchmarks.sensors [--save FILE] [--duration S]`` runs the case of the zoo (tool, load,
every inertia and the friction unknown, a circle) with perfect sensors, three cameras, two encoders
and a slow controller. The sensors are declared to each controller. Errors are rms and largest of
the last tenth of the run.
"""

from __future__ import annotations

import argparse
import math
import os
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.zoo.experiment import zoo_case

from .timing import HERE, save

ROBOTS = ("panda", "ur5", "ur10", "xarm7", "kinova", "tiago_arm")


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


def measure(robot: str, column: str, duration: float) -> dict[str, Any]:
    """Return the errors of one robot with the sensors of one column."""
    case, zoo = CASES[column], zoo_case(robot)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of descriptions with unphysical bodies
        controller = pa.make_controller(zoo.estimated, dt=case.dt, sensors=case.sensors)
        rollout = pa.simulate(
            zoo.true,
            controller,
            zoo.motion,
            duration=duration,
            engine=pa.Engine(torque_limits=zoo.efforts_suffice),
            record_every=10,
        )
    last = rollout.distance[rollout.t > 0.9 * duration]
    lost = rollout.diverged is not None
    return {
        "name": f"{robot}, {column}",
        "robot": robot,
        "sensors": column,
        "radius_mm": 1e3 * zoo.radius,
        "rms_mm": None if lost else 1e3 * float(np.sqrt(np.mean(last**2))),
        "max_mm": None if lost else 1e3 * float(last.max()),
        "diverged": rollout.diverged,
    }


def main() -> None:
    """Print the table and save it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "sensors.json")
    parser.add_argument("--duration", type=float, default=60.0)
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        coming = [
            pool.submit(measure, robot, column, options.duration)
            for robot in ROBOTS
            for column in CASES
        ]
        rows = [future.result() for future in coming]
    print("rms / max of the last tenth [mm]")
    print(f"{'':10}" + "".join(f"{column:>18}" for column in CASES))
    for i, robot in enumerate(ROBOTS):
        own = rows[i * len(CASES) : (i + 1) * len(CASES)]
        cells = [
            "lost" if row["rms_mm"] is None else f"{row['rms_mm']:.3f} / {row['max_mm']:.3f}"
            for row in own
        ]
        print(f"{robot:10}" + "".join(f"{cell:>18}" for cell in cells))
    save(options.save, rows)


if __name__ == "__main__":
    main()
