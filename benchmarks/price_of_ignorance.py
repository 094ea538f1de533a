"""The price of ignorance: the error of an adapted loop over that of the same loop with the truth.

``make price_of_ignorance.table`` runs the sweep ``price_of_ignorance.toml``: laws that adapt and
follow motions, under natural adaptation with and without memory, and the default law under the
others as well. Unknown are a tool of 13 cm, a load of 1.5 kg (z1: 0.75) and every inertia (30 % too
small in the model); no friction, perfect sensors. By default the friction and the rotors are
unknown too, and the feedback has a lag of 10 ms: the row of the truth with that lag tells its share
of the price. The task frame follows a circle of 0.1 m in 3 s, joint-space laws swing every joint by
0.2 rad in 3 s; default gains, 1 kHz.

The error after T seconds is the largest of the last tenth of them, from 0.9 T to T, of one run of
40 s. The price is that error relative to the error, in the same window, of the loop with the true
model and no adaptation.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

import pinadapt as pa

from .timing import markdown

LOADS = {"panda": 1.5, "ur5": 1.5, "z1": 0.75}  # [kg]
AFTER = (5.0, 10.0, 20.0, 40.0)  # [s]
TOOL = (0.03, -0.02, 0.12)  # [m]
CENTRE = (0.02, -0.01, 0.05)  # [m]
TURNING = (0.01, 0.0, 0.012, 0.0, 0.0, 0.004)  # [kg m^2], of the Panda's load
LIGHTER = 0.7
RADIUS, SWING, PERIOD = 0.1, 0.2, 3.0  # [m], [rad], [s]

TRUTH, SLOWER, DEFAULTS = "truth", "truth, lag of 10 ms", "default"
SLOPE = "natural-memory, tool by gradient"
ADAPTATIONS: dict[str, dict[str, Any]] = {
    TRUTH: {"adaptation": "none"},
    SLOWER: {"adaptation": "none", "lag": 0.01},
    "natural": {"adaptation": "natural"},
    "natural-memory": {"adaptation": "natural-memory"},
    "natural-composite": {"adaptation": "natural-composite"},
    "least-squares": {"adaptation": "least-squares"},
    SLOPE: {"adaptation": "natural-memory", "kinematic_adaptation": "gradient"},
    DEFAULTS: {"unknown": pa.Unknown()},
}
_TITLES = {
    TRUTH: "the truth [µm, µrad]",
    SLOWER: "the truth, lag of 10 ms",
    SLOPE: "`natural-memory`, tool by gradient",
    DEFAULTS: "by default, friction and rotors unknown too",
}


def robots(robot: str, joints: bool) -> tuple[pa.Robot, pa.Robot]:
    """Return the described robot and the real one; laws of joint space see no tool."""
    task: dict[str, Any] = {"task": "joint"} if joints else {}
    described, mass = pa.load(robot, **task), LOADS[robot]
    load = pa.Payload(mass, CENTRE, mass / LOADS["panda"] * np.array(TURNING))
    tool: dict[str, Any] = {} if joints else {"tool_translation": TOOL}
    return described, described.changed(payload=load, **tool)


def path(true: pa.Robot, joints: bool) -> pa.trajectories.Trajectory:
    """Return the motion, from home, at speed from the first sample."""
    if joints:
        return pa.trajectories.Sinusoid(true.home_angles + SWING, SWING, PERIOD).as_given()
    circle = pa.trajectories.Circle(np.zeros(3), RADIUS, PERIOD, "yz")
    return circle.starting_at(true.position(true.q0)).as_given()


def measure(robot: str, law: str, adaptation: str) -> dict[str, Any]:
    """Return the error after each time [m or rad]; None once the loop has diverged."""
    joints = pa.laws.LAWS[law].joint_space
    described, true = robots(robot, joints)
    known = adaptation in (TRUTH, SLOWER)
    model = true if known else described.changed(inertial_scale=LIGHTER)
    words: dict[str, Any] = {"unknown": pa.Unknown(friction=False, armature=False)}
    words |= ADAPTATIONS[adaptation]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light joints; the table has the result
        controller = pa.make_controller(model, law=law, **words)
        rollout = pa.simulate(
            true, controller, path(true, joints), duration=AFTER[-1], progress=False
        )
    t, error = rollout.t, rollout.distance
    lost = np.inf if rollout.diverged is None else rollout.diverged
    found: dict[str, Any] = {
        column(end): float(error[(t > 0.9 * end) & (t <= end)].max()) if end < lost else None
        for end in AFTER
    }
    if rollout.diverged is not None:
        found |= {"status": "diverged", "reason": f"at {rollout.diverged:.1f} s"}
    return found


def column(end: float) -> str:
    """Return the name of the error after some seconds."""
    return f"error_{end:g}s"


def prices(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str, str], list[float | None]]:
    """Return what each row has after each time, by law, robot and adaptation.

    Of the true model the error [um or urad], of all others the price.
    """
    errors = {
        (row["law"], row["robot"], row["adaptation"]): [row.get(column(end)) for end in AFTER]
        for row in rows
    }
    return {
        (law, robot, kind): [
            None if error is None or best is None else error / (1e-6 if kind == TRUTH else best)
            for error, best in zip(own, errors[law, robot, TRUTH], strict=True)
        ]
        for (law, robot, kind), own in errors.items()
    }


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown: errors with the true model [um or urad], below them prices."""
    found = prices(rows)
    head = [f"{robot} {end:g} s" for robot, end in product(LOADS, AFTER)]
    lines: list[list[str]] = []
    for law, kind in product(dict.fromkeys(row["law"] for row in rows), ADAPTATIONS):
        if any((law, robot, kind) in found for robot in LOADS):
            lines.append([f"`{law}`", _TITLES.get(kind, f"`{kind}`")])
            for robot in LOADS:
                own = found.get((law, robot, kind))
                lines[-1] += ["-"] * len(AFTER) if own is None else map(_cell, own)
    return markdown(["law", "adaptation", *head], lines)


def _cell(number: float | None) -> str:
    return "lost" if number is None else f"{number:.2g}" if number < 100.0 else f"{number:.0f}"
