"""How well robots are identified from recorded motions of real arms.

``python -m benchmarks.real_logs FOLDER`` identifies each robot whose log is in the folder and
prints the error of the torques in the last quarter of the log, which nothing was learned from: the
root mean square over time and all joints of averages over windows. Its columns are

* described: the description as it is;
* OLS, WLS: base parameters by ordinary and by weighted least squares, with the same effects of the
  joints, unconstrained, from the first three quarters;
* identify: ``pinadapt.identify`` from the first three quarters, and how much larger its error is
  than the better one of OLS and WLS;
* online: the sample by sample estimates of an ``Estimator`` after the first three quarters.

The folder has the files named in ``LOGS``, or says in a ``logs.toml`` what it has::

    [[log]]
    name = "my arm"
    file = "log.csv"           # relative to the folder
    robot = "my_robot.urdf"    # relative to the folder, or a name
    locked = ["torso_joint"]   # optional, as are frame and other arguments of pinadapt.load
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt._output import toml
from pinadapt.identification.report_page import least_squares_errors

LOGS: tuple[dict[str, Any], ...] = (
    {"name": "panda", "file": "panda_unisa.csv", "robot": "panda"},
    {"name": "ur10", "file": "ur10_unisa/ur10_exciting_trajectory.db3", "robot": "ur10"},
    {"name": "tx40", "file": "tx40.csv", "robot": "tx40_link6_inertia.urdf"},
    {
        "name": "tiago",
        "file": "tiago.csv",
        "robot": "tiago.urdf",
        "frame": "arm_7_link",
        "locked": ["torso_lift_joint"],
    },
)


def chosen_logs(description: str) -> Iterator[tuple[str, Path, pa.Robot]]:
    """Return name, file and robot of each log that the command line asks for.

    Args:
        description: of the benchmark; the first line is shown with ``--help``.
    """
    parser = argparse.ArgumentParser(description=description.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="names of logs, separated by commas")
    options = parser.parse_args()
    return _logs_of(options.folder, options.only.split(",") if options.only else [])


def _logs_of(folder: Path, only: list[str]) -> Iterator[tuple[str, Path, pa.Robot]]:
    """Yield the logs in a folder, all of them if no names are given."""
    table = folder / "logs.toml"
    found = toml.loads(table.read_text())["log"] if table.is_file() else LOGS
    for entry in found:
        options = dict(entry)
        name, file, source = (options.pop(key) for key in ("name", "file", "robot"))
        beside = folder / source
        if (folder / file).exists() and (not only or name in only):
            yield name, folder / file, pa.load(beside if beside.exists() else source, **options)


def rms(values: np.ndarray) -> float:
    """Return the root mean square of all numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def effects_of(found: pa.Identification) -> str:
    """Return what cross-validation chose, with the gains."""
    if found.effects is None or found.weight is None:
        return "-"
    gains = [f"{gain.words} {gain.share:.0%}" for gain in found.effects.gains]
    return f"gamma {found.weight.gamma:.1g}; {', '.join(gains) or 'none'}"


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    logs = chosen_logs(__doc__)
    print(
        "log | described | OLS | WLS | identify | to the better | online | "
        "N m of torque | s | effects"
    )
    for name, file, robot in logs:
        start = time.perf_counter()
        found = pa.identify(file, robot, progress=False)
        took, errors = time.perf_counter() - start, found.torque_errors
        described, learned = rms(errors.described_held_out), rms(errors.learned_held_out)
        plain, weighted = (rms(part) for part in least_squares_errors(found))
        print(
            f"{name} | {described:.3g} | {plain:.3g} | {weighted:.3g} | {learned:.3g} | "
            f"{learned / min(plain, weighted) - 1.0:+.1%} | "
            f"{rms(found.online_held_out):.3g} | "
            f"{rms(errors.size):.3g} | {took:.1f} | {effects_of(found)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
