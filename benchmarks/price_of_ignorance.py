"""The cost of unknown parameters: the error of an adapted loop over that with the true model.

``make price_of_ignorance.table`` runs the sweep ``price_of_ignorance.toml``: laws that adapt and
follow motions, under natural adaptation with and without memory. Unknown are a tool of 13 cm, a
load of 1.5 kg (z1: 0.75) and every inertia (30 % too small in the model); no friction, perfect
sensors. The task frame follows a circle of 0.1 m in 3 s, joint-space laws swing every joint by
0.2 rad in 3 s; default gains, 1 kHz. The error after T seconds is the largest from 0.9 T to T.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import pinadapt as pa

LOADS = {"panda": 1.5, "ur5": 1.5, "z1": 0.75}  # [kg]
AFTER = (10.0,)  # [s]
TOOL = (0.03, -0.02, 0.12)  # [m]
CENTRE = (0.02, -0.01, 0.05)  # [m]
TURNING = (0.01, 0.0, 0.012, 0.0, 0.0, 0.004)  # [kg m^2], of the Panda's load
LIGHTER = 0.7
RADIUS, SWING, PERIOD = 0.1, 0.2, 3.0  # [m], [rad], [s]

TRUTH = "truth"


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
    known = adaptation == TRUTH
    model = true if known else described.changed(inertial_scale=LIGHTER)
    unknown = pa.Unknown(friction=False, armature=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the table has the result
        controller = pa.make_controller(
            model, law=law, unknown=unknown, adaptation="none" if known else adaptation
        )
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
