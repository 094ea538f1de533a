"""How well robots are identified from recorded motions of real arms.

``make real_logs.table`` runs the sweep ``real_logs.toml`` and writes ``real_logs.csv``, for the
logs in the folder that the environment variable ``REAL_LOGS`` names. Errors of torques are those of
the last quarter of a log, which nothing was learned from: root mean squares over time and all
joints of averages over windows. Of each log are measured

* check: factors and correlations of the torques with those of the description;
* identified: ``pinadapt.identify`` from the first three quarters, the description as it is, and
  base parameters by ordinary and by weighted least squares with the same effects of the joints; the
  sample by sample estimates of an ``Estimator`` after the first three quarters;
* viscous and Coulomb: the same with viscous and Coulomb friction and rotors alone.

The folder has the files named in ``LOGS``, or says in a ``logs.toml`` what it has::

    [[log]]
    name = "my arm"
    file = "log.csv"           # relative to the folder
    robot = "my_robot.urdf"    # relative to the folder, or a name
    locked = ["torso_joint"]   # optional, as are frame and other arguments of pinadapt.load
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt._output import toml
from pinadapt.identification import Identification, check_torques

from .timing import markdown

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
    return logs_of(options.folder, options.only.split(",") if options.only else [])


def logs_of(folder: Path, only: list[str]) -> Iterator[tuple[str, Path, pa.Robot]]:
    """Yield the logs in a folder, all of them if no names are given."""
    table = folder / "logs.toml"
    found = toml.loads(table.read_text())["log"] if table.is_file() else LOGS
    for entry in found:
        options = dict(entry)
        name, file, source = (options.pop(key) for key in ("name", "file", "robot"))
        beside = folder / source
        if (folder / file).exists() and (not only or name in only):
            yield name, folder / file, pa.load(beside if beside.exists() else source, **options)


def folder() -> Path:
    """Return the folder of the logs."""
    return Path(os.environ["REAL_LOGS"])


def rms(values: np.ndarray) -> float:
    """Return the root mean square of all numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def least_squares_errors(found: Identification) -> tuple[float, float]:
    """Return the held-out errors of base parameters by ordinary and weighted least squares.

    They have the same effects of the joints, no prior, and need not be physical: what is usual in
    the literature.
    """
    dynamics = found.controller.dynamics
    chosen = pa.models.base_parameters(dynamics, found.described).chosen
    first = found.windows.between(-np.inf, found.split)
    last = found.windows.between(found.split, np.inf)
    W, errors = first.W[:, :, chosen], []
    noise = np.ones(W.shape[1])
    for _ in range(2):
        A = (W / noise[:, None]).reshape(-1, len(chosen))
        a = np.linalg.lstsq(A, (first.y / noise).ravel(), rcond=1e-10)[0]
        errors.append(rms(last.y - last.W[:, :, chosen] @ a))
        noise = np.sqrt(np.mean((first.y - W @ a) ** 2, axis=0))
    return errors[0], errors[1]


def measure(log: str, what: str) -> dict[str, Any]:
    """Return the figures of a log."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ((_, file, robot),) = logs_of(folder(), [log])
        if what == "check":
            check = check_torques(pa.read_log(file, robot), robot)
            judged = [(one.factor, one.correlation) for one in check.joints if one.judged]
            factors = ", ".join(f"{factor:.2f} ({close:.2f})" for factor, close in judged)
            return {"factors": factors}
        options: dict[str, Any] = {}
        if what == "viscous and Coulomb":
            options["unknown"] = pa.Unknown(friction=True, armature=True)
        found = pa.identify(file, robot, progress=False, **options)
        errors = found.torque_errors
        numbers: dict[str, Any] = {
            "described": rms(errors.described_held_out),
            "learned": rms(errors.learned_held_out),
            "online": rms(found.online_held_out),
            "torque": rms(errors.size),
        }
        if what == "identified":
            plain, weighted = least_squares_errors(found)
            gains = [] if found.effects is None else found.effects.gains
            numbers |= {"plain": plain, "weighted": weighted}
            numbers["effects"] = ", ".join(f"{one.words} {one.share:.0%}" for one in gains)
        return numbers


# --- tables ---

NAMES = {"panda": "Panda", "ur10": "UR10", "tx40": "TX40", "tiago": "TIAGo, torso locked"}
Rows = Sequence[Mapping[str, Any]]


def of_kind(rows: Rows, what: str) -> dict[str, Mapping[str, Any]]:
    """Return the rows of one kind, by log."""
    return {row["log"]: row for row in rows if row["what"] == what}


def report(rows: Rows) -> str:
    """Return the errors of what was identified, beside those of least squares."""
    before = of_kind(rows, "viscous and Coulomb")
    cells = [
        [
            NAMES[name],
            *(f"{row[key]:.3g}" for key in ("described", "plain", "weighted", "learned")),
            f"{before[name]['learned']:.3g}",
        ]
        for name, row in of_kind(rows, "identified").items()
    ]
    head = ["log", "described", "OLS", "WLS", "identified", "viscous and Coulomb friction alone"]
    return markdown(head, cells)
