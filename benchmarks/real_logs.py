"""How well robots are identified from recorded motions of real arms.

``make real_logs.table`` runs the sweep ``real_logs.toml`` and writes ``real_logs.csv``, for the
logs in the folder that the environment variable ``REAL_LOGS`` names. Errors of torques are those of
the last quarter of a log, which nothing was learned from: root mean squares over time and all
joints of averages over windows. Of each log are measured

* identified: ``pinadapt.identify`` from the first three quarters, the description as it is, and
  base parameters by ordinary and by weighted least squares with the same effects of the joints;
* viscous and Coulomb: the same with viscous and Coulomb friction and rotors alone.

The folder has the files named in ``LOGS``, or says in a ``logs.toml`` what it has::

    [[log]]
    name = "my arm"
    file = "log.csv"           # relative to the folder
    robot = "my_robot.urdf"    # relative to the folder, or a name
    locked = ["torso_joint"]   # optional, as are frame and other arguments of pinadapt.load
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt._output import toml
from pinadapt.identification import Identification

from .shared import Row, grouped, markdown, quiet, rms

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


def logs_of(folder: Path, *only: str) -> Iterator[tuple[str, Path, pa.Robot]]:
    """Yield name, file and robot of the logs in a folder, all of them if no names are given."""
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


def least_squares_errors(found: Identification) -> tuple[float, float]:
    """Return the held-out errors of base parameters by ordinary and weighted least squares.

    They have the same effects of the joints, no prior, and need not be physical: what is usual in
    the literature.
    """
    dynamics = found.controller.dynamics
    chosen = pa.models.base_parameters(dynamics, found.described).chosen
    first = found.windows.between(-np.inf, found.split)
    last = found.windows.between(found.split, np.inf)
    W = first.W[:, :, chosen]
    errors = []
    noise = np.ones(W.shape[1])
    for _ in range(2):
        A = (W / noise[:, None]).reshape(-1, len(chosen))
        a = np.linalg.lstsq(A, (first.y / noise).ravel(), rcond=1e-10)[0]
        errors.append(rms(last.y - last.W[:, :, chosen] @ a))
        noise = np.sqrt(np.mean((first.y - W @ a) ** 2, axis=0))
    return errors[0], errors[1]


@quiet()
def measure(log: str, what: str) -> dict[str, Any]:
    """Return the figures of a log."""
    ((_, file, robot),) = logs_of(folder(), log)
    simple = pa.Unknown(friction=True, armature=True)
    found = pa.identify(
        file, robot, unknown=None if what == "identified" else simple, progress=False
    )
    errors = found.torque_errors
    numbers = {
        "described": rms(errors.described_held_out),
        "learned": rms(errors.learned_held_out),
    }
    if what == "identified":
        numbers["plain"], numbers["weighted"] = least_squares_errors(found)
    return numbers


# --- tables ---

NAMES = {"panda": "Panda", "ur10": "UR10", "tx40": "TX40", "tiago": "TIAGo, torso locked"}


def report(rows: Sequence[Row]) -> str:
    """Return the errors of what was identified, beside those of least squares."""
    cells = []
    for log, own in grouped(rows, "log").items():
        found = {row["what"]: row for row in own}
        numbers = [
            found["identified"][key] for key in ("described", "plain", "weighted", "learned")
        ]
        numbers.append(found["viscous and Coulomb"]["learned"])
        cells.append([NAMES[log], *(f"{number:.3g}" for number in numbers)])
    head = ["log", "described", "OLS", "WLS", "identified", "viscous and Coulomb friction alone"]
    return markdown(head, cells)
