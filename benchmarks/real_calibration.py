"""The geometry of a real arm, calibrated on one day and tested on another.

``python -m benchmarks.real_calibration FOLDER`` reads the static postures of a TIAGo that
figaroh-examples publishes (``examples/tiago/data/calibration/mocap``): eight joints and the
position of a point of the hand, in the axes of a tracked body on the base. What is unknown is
estimated from the training file alone, and the distances of the measured points are those of both
files. FIGAROH's own numbers are those of its protocol
(``docs/development/tiago-mocap-heldout-protocol.md`` there).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import pinadapt as pa
from pinadapt.identification import Calibration, calibrate
from pinadapt.identification.calibration import ALL, OFFSETS
from pinadapt.logs import read_log
from pinadapt.models.translations import TOOL

TRAINING = "qualisys_2021-11-30_static_postures.csv"
TEST = "qualisys_2021-11-26_static_postures.csv"
LEVELS = {"the tracker and the tool": TOOL, "offsets too": (TOOL, OFFSETS), "everything": ALL}
FIGAROH = ((3.37, 4.87), (2.88, 4.23), (1.64, 3.07))  # mm
READ = {"columns": {"x": ["x1", "y1", "z1"]}}


def distances(found: Calibration, log: pa.Log) -> np.ndarray:
    """Return how far each measured point (N) is from that of the calibrated robot [m]."""
    assert found.tracker is not None and log.x is not None
    q = log.configurations(found.robot)
    seen = [found.tracker.act(found.robot.placement(each).translation) for each in q]
    return np.asarray(np.linalg.norm(log.x - seen, axis=1))


def main() -> None:
    """Print the rms distances in both files, ours and FIGAROH's."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    folder: Path = parser.parse_args().folder
    robot = pa.load("tiago_arm")
    logs = [read_log(folder / name, robot, intake=READ, torques=False) for name in (TRAINING, TEST)]
    print("| unknown | combinations | training [mm] | another day | largest | FIGAROH |")
    print("|---|---|---|---|---|---|")
    for (words, unknown), theirs in zip(LEVELS.items(), FIGAROH, strict=True):
        found = calibrate(logs[0], robot, unknown=unknown, tracker=True)
        errors = [1e3 * distances(found, log) for log in logs]
        size = [f"{np.sqrt(np.mean(each**2)):.2f}" for each in errors]
        cells = [words, f"{len(found.combinations)}", *size, f"{errors[1].max():.1f}"]
        print(f"| {' | '.join(cells)} | {theirs[0]}, {theirs[1]} |")


if __name__ == "__main__":
    main()
