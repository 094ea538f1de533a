"""Whole robots of example-robot-data on a fixed base: sines of every joint, bodies all wrong.

``make whole_robots.table`` runs the sweep ``whole_robots.toml``. The true robot has friction, which
its model has not, and in the model each body is 30 % too light or too heavy, as in the zoo; all
bodies, friction and rotors are adapted. Each joint follows a sine of up to 0.6 rad from end to end,
see ``find_swing``, at 1 kHz. Nothing is chosen by robot.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.description.chain import effort_limits
from pinadapt.exceptions import PinadaptError
from pinadapt.models.bodies import UNCERTAINTY
from pinadapt.models.joint_effects import typical_coefficients
from pinadapt.robot.motors import overloaded
from pinadapt.robot.workspace import find_swing
from pinadapt.scenario.template import FRICTION

from .shared import Row, markdown, quiet

DURATION = 4.0  # [s]: half of the slowest sine; twice: less than half of the error at the end


@quiet()
def measure(robot: str, adaptation: str = "natural") -> dict[str, Any]:
    """Return the figures of one run.

    Args:
        robot: a name of example-robot-data.
        adaptation: of inertias and friction; "none".

    The error is a norm over all joints [rad, slides m], the largest of the last second. A robot
    that is refused has the reason alone.
    """
    try:
        return _measured(robot, adaptation)
    except PinadaptError as error:
        return {"refused": str(error)}


def _measured(name: str, adaptation: str) -> dict[str, Any]:
    described = pa.load(name, task="joint")
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    _, viscous, coulomb = FRICTION * typical_coefficients(described)
    true = described.changed(friction=pa.Friction(viscous, coulomb))
    factors = 1.0 + UNCERTAINTY * rng.choice([-1.0, 1.0], described.model.nv)
    model = described.changed(
        inertial_scale=dict(zip(described.joint_names, factors.tolist(), strict=True))
    )
    enough = overloaded(true, effort_limits(true.model)) is None
    controller = pa.make_controller(
        model,
        unknown=pa.Unknown(friction=True, armature=True),
        adaptation=adaptation,
        limits=pa.Limits(torque=enough, guards={"velocity": False}),
        dt=1e-3,
    )
    rollout = pa.simulate(
        true, controller, find_swing(described), duration=DURATION,
        engine=pa.Engine(torque_limits=enough), record_every=10, progress=False,
    )  # fmt: skip
    found = {"joints": described.model.nv, "motors": int(described.motors.sum())}
    if rollout.diverged is not None:
        return {**found, "refused": f"diverged after {rollout.diverged:.2f} s: {rollout.reason}"}
    errors = np.linalg.norm(rollout.error, axis=1)
    last = float(errors[rollout.t > rollout.t[-1] - 1.0].max())
    return {**found, "last": last, "step": rollout.step_time}


def report(rows: Iterable[Row]) -> str:
    """Return the table: the errors of each robot, largest of the last second; the step."""
    runs = {(row["robot"], row["adaptation"]): row for row in rows}
    lines = []
    for name in dict.fromkeys(robot for robot, _ in runs):
        own = runs[name, "natural"]
        other = runs[name, "none"]
        cells = ["refused", "", "", ""]
        if not own["refused"]:
            joints = f"{own['joints']:g}"
            if own["motors"] != own["joints"]:
                joints += f", {own['motors']:g} motors"
            errors = [f"{1e3 * run['last']:.2g}" for run in (other, own)]
            cells = [joints, *errors, f"{1e3 * own['step']:.2g} ms"]
        lines.append([f"`{name}`", *cells])
    return markdown(["robot", "joints", "not adapted", "adapted", "step"], lines)
