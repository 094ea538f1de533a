"""The first moments of a run: torques and errors of a start at full speed and of one from rest.

``python -m benchmarks.first_moments [PATH...] [--robots NAMES] [--save FILE]`` runs arms of the
catalogue, and further descriptions by their paths, on the circle that ``reachable_circle`` finds,
with the default law, adaptation and gains at 1 kHz, each as given (at full speed
from the first sample) and from rest, as ``simulate`` does by default. Rows of other robots in the
file are kept.

Torques: a tool of 5 % of the reach and a load of 5 % of the mass are unknown, every inertia of the
model is 30 % too small. The largest torque of the first 0.3 s, relative to the effort limit of its
joint, is compared with the largest share of a limit that gravity takes at home. Torques are
clipped, so 100 % is a motor at its limit.

With the truth known, and no adaptation, what remains is due to the start alone: the largest torque
of the first 0.3 s beside that of gravity, relative to the limit, and the largest error of the first
tenth of four turns.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import effort_limits

from .timing import HERE, save, saved

ROBOTS = (
    "panda",
    "ur5",
    "ur10",
    "kinova",
    "xarm7",
    "z1",
    "tiago_arm",
    "talos_left_arm",
    "baxter_left",
    "tiago_pro_left_arm",
)
TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
LOAD, INERTIAS = 0.05, 0.7  # of the mass; factor on the inertias of the model
FIRST, TURNS, TENTH = 0.3, 4.0, 0.1  # [s], turns of a run, its share that is looked at
KEYS = "effort", "beside gravity"
FILE = HERE / "first_moments.json"


def row(source: str | Path) -> dict[str, Any]:
    """Return the numbers of one robot: shares of effort limits, errors [m]."""
    robot = pa.load(source)
    tool = robot.reach * TOOL
    load = pa.Payload(mass=LOAD * robot.mass, com=tool)
    true = robot.changed(tool_translation=tool, payload=load)
    circle = pa.reachable_circle(robot)
    path = circle.starting_at(true.position(true.q0))
    adaptive = pa.make_controller(robot.changed(inertial_scale=INERTIAS))
    informed = pa.make_controller(true, adaptation="none")
    limits = effort_limits(robot.model)
    data = true.model.createData()
    gravity = np.abs(pin.computeGeneralizedGravity(true.model, data, true.q0)) / limits
    found: dict[str, Any] = {"name": Path(source).stem, "gravity": float(gravity.max())}
    for name, motion in (("at speed", path.as_given()), ("from rest", path.from_rest())):
        first = pa.simulate(true, adaptive, motion, duration=FIRST)
        known = pa.simulate(true, informed, motion, duration=TENTH * TURNS * circle.period)
        found[name] = {
            "effort": float((np.abs(first.tau) / limits).max()),
            "beside gravity": _beside_gravity(true, known),
            "saturated": float(first.saturated.mean()),
            "error": float(known.distance.max()),
            "lost": first.diverged or known.diverged,
        }
    return found


def _beside_gravity(robot: pa.Robot, run: pa.Rollout) -> float:
    """Return the largest torque of the first moments beside gravity's, as a share of its limit."""
    data, soon = robot.model.createData(), run.t < FIRST
    weight = [pin.computeGeneralizedGravity(robot.model, data, q).copy() for q in run.q[soon]]
    return float((np.abs(run.tau[soon] - weight) / effort_limits(robot.model)).max())


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return rows as a table in Markdown."""
    lines = [
        "| arm | gravity | torque at speed | from rest | beside gravity at speed | from rest "
        "| error at speed [mm] | from rest [mm] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for each in rows:
        both = each["at speed"], each["from rest"]
        shares = [each["gravity"], *(run[key] for key in KEYS for run in both)]
        cells = [f"{100 * x:.{0 if x > 0.1 else 2}{'f' if x > 0.1 else 'g'}} %" for x in shares]
        cells += [f"{1e3 * run['error']:.2g}" for run in both]
        lines.append(f"| `{each['name']}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print the table, and save it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", type=Path, nargs="*", metavar="PATH")
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS), metavar="NAME")
    parser.add_argument("--save", type=Path, default=FILE, metavar="FILE")
    options = parser.parse_args()
    rows = saved(options.save)
    for source in [*options.robots, *options.paths]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of bodies without inertia, of light joints
            found = row(source)
        rows[found["name"]] = found
        print(table([found]).splitlines()[-1], flush=True)
    save(options.save, list(rows.values()))


if __name__ == "__main__":
    main()
