"""The first moments of a run: torques and errors of a start at full speed and of one from rest.

``make first_moments.table`` runs the sweep ``first_moments.toml`` and writes ``first_moments.csv``:
arms of the catalogue on the circle that ``reachable_circle`` finds, with the default law,
adaptation and gains at 1 kHz, each as given (at full speed from the first sample) and from rest, as
``simulate`` does by default.

Torques: a tool of 5 % of the reach and a load of 5 % of the mass are unknown, every inertia of the
model is 30 % too small. The largest torque of the first 0.3 s, relative to the effort limit of its
joint, is compared with the largest share of a limit that gravity takes at home. Torques are
clipped, so 100 % is a motor at its limit.

With the truth known, and no adaptation, what remains is due to the start alone: the largest torque
of the first 0.3 s beside that of gravity, relative to the limit, and the largest error of the first
tenth of four turns.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import effort_limits

from .timing import markdown

TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
LOAD, INERTIAS = 0.05, 0.7  # of the mass; factor on the inertias of the model
FIRST, TURNS, TENTH = 0.3, 4.0, 0.1  # [s], turns of a run, its share that is looked at
KEYS = "effort", "beside gravity"


def measure(robot: str) -> dict[str, Any]:
    """Return the numbers of one robot: shares of effort limits, errors [m]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bodies without inertia, of light joints
        return _measured(pa.load(robot))


def _measured(robot: pa.Robot) -> dict[str, Any]:
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
    found: dict[str, Any] = {"gravity": float(gravity.max())}
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


STARTS = "at speed", "from rest"


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown, by arm."""
    cells = []
    for row in rows:
        shares = [row["gravity"], *(row[f"{start}.{key}"] for key in KEYS for start in STARTS)]
        errors = [f"{1e3 * row[f'{start}.error']:.2g}" for start in STARTS]
        cells.append([f"`{row['robot']}`", *(_percent(share) for share in shares), *errors])
    head = ["arm", "gravity", "torque at speed", "from rest", "beside gravity at speed"]
    return markdown([*head, "from rest", "error at speed [mm]", "from rest [mm]"], cells)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share > 0.1 else f"{100.0 * share:.2g} %"
