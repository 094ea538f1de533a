"""The geometry of a real arm, calibrated on one day and tested on another.

``make real_calibration.table`` runs the sweep ``real_calibration.toml`` and writes
``real_calibration.csv``: the static postures of a TIAGo that figaroh-examples publishes
(``examples/tiago/data/calibration/mocap``), in the folder that the environment variable
``TIAGO_POSTURES`` names, have eight joints and the position of a point of the hand, in the axes of
a tracked body on the base. What is unknown is
estimated from the training file alone, and the distances of the measured points are those of both
files. FIGAROH's own numbers are those of its protocol
(``docs/development/tiago-mocap-heldout-protocol.md`` there).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.identification import Calibration, calibrate
from pinadapt.identification.calibration import ALL, OFFSETS
from pinadapt.logs import read_log
from pinadapt.models.translations import TOOL

from .shared import Row, markdown, rms

TRAINING = "qualisys_2021-11-30_static_postures.csv"
TEST = "qualisys_2021-11-26_static_postures.csv"
LEVELS = {
    "the tracker and the tool": TOOL,
    "offsets of the encoders too": (TOOL, OFFSETS),
    "everything": ALL,
}
FIGAROH = {  # combinations, mm
    "the tracker and the tool": (9, 3.37, 4.87),
    "offsets of the encoders too": (14, 2.88, 4.23),
    "everything": (31, 1.64, 3.07),
}
READ = {"columns": {"x": ["x1", "y1", "z1"]}}


def distances(found: Calibration, log: pa.Log) -> np.ndarray:
    """Return how far each measured point (N) is from that of the calibrated robot [m]."""
    assert found.tracker is not None and log.x is not None
    q = log.configurations(found.robot)
    seen = [found.tracker.act(found.robot.placement(each).translation) for each in q]
    return np.asarray(np.linalg.norm(log.x - seen, axis=1))


def measure(unknown: str) -> dict[str, Any]:
    """Return the rms distances in both files [m]."""
    folder = Path(os.environ["TIAGO_POSTURES"])
    robot = pa.load("tiago_arm")
    logs = [
        read_log(folder / name, robot, import_options=READ, torques=False)
        for name in (TRAINING, TEST)
    ]
    found = calibrate(logs[0], robot, unknown=LEVELS[unknown], tracker=True)
    training, test = (distances(found, log) for log in logs)
    return {
        "combinations": len(found.combinations),
        "training": rms(training),
        "test": rms(test),
    }


def report(rows: Sequence[Row]) -> str:
    """Return a table in Markdown, ours beside FIGAROH's."""
    cells = [
        [
            row["unknown"],
            f"{row['combinations']:.0f}",
            *(f"{1e3 * row[key]:.2f}" for key in ("training", "test")),
            *FIGAROH[row["unknown"]],
        ]
        for row in rows
    ]
    head = ["unknown", "combinations", "training", "another day", "FIGAROH: combinations"]
    return markdown([*head, "training", "another day"], cells)
