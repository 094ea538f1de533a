"""The cost of unknown parameters: the error of an adapted loop over that with the true model.

``make cost_of_unknowns.table`` runs the sweep ``cost_of_unknowns.toml``: laws that adapt and
follow motions, under natural adaptation with and without memory. Unknown are a tool of 13 cm, a
load of 1.5 kg (z1: 0.75) and every inertia (30 % too small in the model); no friction, perfect
sensors. The task frame follows a circle of 0.1 m in 3 s, joint-space laws swing every joint by
0.2 rad in 3 s; default gains, 1 kHz. The error is the largest of the last of ten seconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import pinadapt as pa

from .shared import diverged, quiet

LOADS = {"panda": 1.5, "ur5": 1.5, "z1": 0.75}  # [kg]
END = 10.0  # [s]
TOOL = (0.03, -0.02, 0.12)  # [m]
CENTRE = (0.02, -0.01, 0.05)  # [m]
TURNING = (0.01, 0.0, 0.012, 0.0, 0.0, 0.004)  # [kg m^2], of the Panda's load
LIGHTER = 0.7
RADIUS, SWING, PERIOD = 0.1, 0.2, 3.0  # [m], [rad], [s]
TRUTH = "truth"


@quiet()
def measure(robot: str, law: str, adaptation: str) -> dict[str, Any]:
    """Return the error at the end [m or rad]; laws of joint space see no tool."""
    joints = pa.laws.LAWS[law].joint_space
    described = pa.load(robot, task="joint" if joints else None)
    mass = LOADS[robot]
    load = pa.Payload(mass, CENTRE, mass / LOADS["panda"] * np.array(TURNING))
    true = described.changed(payload=load)
    circle = pa.trajectories.Circle(np.zeros(3), RADIUS, PERIOD, "yz")
    path: pa.trajectories.Trajectory = circle
    if joints:
        path = pa.trajectories.Sinusoid(true.home_angles + SWING, SWING, PERIOD)
    else:
        true = true.changed(tool_translation=TOOL)
        path = circle.starting_at(true.position(true.q0))
    known = adaptation == TRUTH
    controller = pa.make_controller(
        true if known else described.changed(inertial_scale=LIGHTER),
        law=law,
        unknown=pa.Unknown(friction=False, armature=False),
        adaptation="none" if known else adaptation,
    )
    rollout = pa.simulate(true, controller, path.as_given(), duration=END, progress=False)
    if rollout.diverged is not None:
        return diverged(rollout)
    return {"error_10s": float(rollout.distance[rollout.t > 0.9 * END].max())}
