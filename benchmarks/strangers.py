"""The README's lines on third-party robots, for which nothing was tuned.

``make strangers.table`` runs the sweep ``strangers.toml``, whose robots are named by package and
file. ``python -m pip install --no-deps --target DIR`` with the packages of ``PACKAGES`` gets the
descriptions, and ``PYTHONPATH=DIR`` finds them; no package is imported.

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
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.exceptions import InputError
from pinadapt.sweep.table import DIVERGED, DONE, REFUSED

from .timing import markdown

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
CAMERA = pa.Camera(rate=30.0, delay=0.06)
SENSORS = {
    "perfect": pa.Sensors(),
    "camera": pa.Sensors(CAMERA),
    "noisy": pa.Sensors(CAMERA, encoder=2.0 * np.pi / 2**17, noise={"x": 1e-3}),
}
ADAPTATIONS = {"natural": "natural", "unadapted": "none"}  # by words of a run
WIDTH = 160  # of a reason in the table


def measure(robot: str, run: str) -> dict[str, Any]:
    """Run the README's lines on one description, as a case of a sweep.

    Args:
        robot: a name of the catalogue, a file, or "package/path" of one in a package.
        run: words for the sensors and the controller, as above.

    Returns:
        frame, joints (number), radius [m] and period [s] of the circle, error [m] of the last
        tenth, the largest one of the whole run [m]; for what is refused or diverges status and
        reason.

    Raises:
        FileNotFoundError: there is no such file; it names the package to install.
        ValueError: an unknown word.
    """
    words = _words(run)
    path = robot if "/" not in robot else located(robot)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bodies that are not physical, for example
        try:
            return _followed(pa.load(path), **words)
        except InputError as error:
            return {"status": REFUSED, "reason": str(error).replace(str(path), robot)}
        except pa.PinadaptError as error:  # in the wiggle before a motion
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


def _words(run: str) -> dict[str, Any]:
    """Return the arguments of ``_followed`` for the words of a run."""
    found: dict[str, Any] = {"sensors": pa.Sensors(), "tracker": None, "adaptation": None}
    for word in run.split(", "):
        if word in SENSORS:
            found["sensors"] = SENSORS[word]
        elif word.startswith("tracker "):
            found["tracker"] = float(word.removeprefix("tracker "))
        elif word in ADAPTATIONS:
            found["adaptation"] = ADAPTATIONS[word]
        else:
            known = f"{', '.join(SENSORS)}, tracker DEGREES, {', '.join(ADAPTATIONS)}"
            raise ValueError(f"'{word}' is not one of {known}.")
    return found


def _followed(
    robot: pa.Robot,
    sensors: pa.Sensors,
    tracker: float | None,
    adaptation: str | None,
) -> dict[str, Any]:
    circle = pa.reachable_circle(robot)
    duration = TURNS * circle.period
    tool = robot.reach * TOOL
    load = pa.Payload(mass=LOAD * robot.mass, com=tool)
    true = robot.changed(tool_translation=tool, payload=load)
    model = robot.changed(inertial_scale=INERTIAS)
    motion: Any = circle.starting_at(true.position(true.q0))
    if tracker is not None:
        if robot.task.size < 3:
            raise InputError(
                "turned axes need a task in space, this one is planar.", where="tracker"
            )
        R, seen = pin.exp3(np.radians(tracker) * AXIS), motion
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
    found: dict[str, Any] = {
        "frame": robot.frame,
        "joints": robot.model.nv,
        "radius": circle.radius,
        "period": circle.period,
        "error": None,
    }
    if rollout.diverged is not None:
        reason = f"at {rollout.diverged:.3g} s: {rollout.reason}"
        return found | {"status": DIVERGED, "reason": reason}
    last = rollout.distance[rollout.t > 0.9 * duration]
    return found | {"error": float(last.max()), "largest": float(rollout.distance.max())}


# --- tables ---


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown, a line for each robot."""
    runs = list(dict.fromkeys(row["run"] for row in rows))
    lines = []
    for robot in dict.fromkeys(row["robot"] for row in rows):
        own = {row["run"]: row for row in rows if row["robot"] == robot}
        reasons = dict.fromkeys(_shortened(row) for row in own.values() if row["status"] != DONE)
        lines.append([f"`{Path(robot).name}`", *map(_cell, own.values()), "; ".join(reasons)])
    shown = slice(None) if any(line[-1] for line in lines) else slice(-1)
    return markdown(["robot", *runs, "remark"][shown], [line[shown] for line in lines])


def counts(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown of how the runs ended, a line for each kind of run."""
    lines, ends = (
        [],
        list(dict.fromkeys([DONE, DIVERGED, REFUSED, *(row["status"] for row in rows)])),
    )
    for run in dict.fromkeys(row["run"] for row in rows):
        own = [row for row in rows if row["run"] == run]
        shares = [
            (100.0 * row["error"] / row["radius"], Path(row["robot"]).name)
            for row in own
            if row["status"] == DONE
        ]
        worst = "" if not shares else "{:.2g} % (`{}`)".format(*max(shares))
        middle = "" if not shares else f"{median(share for share, _ in shares):.2g} %"
        ended = (sum(row["status"] == end for row in own) for end in ends)
        lines.append([run, len(own), *ended, middle, worst])
    return markdown(["run", "robots", *ends, "error, median", "largest"], lines)


def _cell(row: Mapping[str, Any]) -> str:
    if row["status"] != DONE:
        return str(row["status"])
    return f"{1e3 * row['error']:.2g} mm, {100.0 * row['error'] / row['radius']:.2g} %"


def _shortened(row: Mapping[str, Any]) -> str:
    return textwrap.shorten(str(row["reason"]), WIDTH, placeholder=" ...")
