"""Effect and cost of robust modifications of the adaptation under disturbances.

``make modifications.table`` runs the sweep ``modifications.toml`` and writes ``modifications.csv``:
the default law with natural adaptation on UR5 and Panda, load, tool and 20 % of all inertias
unknown, on a circle of 0.1 m. The controller does not know the disturbances: velocities differenced
from encoders of 17 bits a turn, motors that deliver their torque late, joint friction that is not
among the parameters, elastic joints with encoders at the motors. Law (11) with a gradient tests the
projection. The
figures of a run are the largest error of the last tenth, the factor by which the pseudo-inertia of
any body changed in any direction in the last quarter, and the change of the torque between samples.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.models.bodies import pseudo_inertia

UNADAPTED = "not adapted"
MODIFICATIONS: dict[str, dict[str, Any]] = {
    UNADAPTED: {},
    "none": {},
    "projection": {"projection": True},
    "sigma": {"sigma": 0.2},
    "e1": {"e1": 1.0},
    "dead zone": {"dead-zone": 0.05},
    "normalised": {"normalised": 10.0},
    "dead zone, sigma": {"dead-zone": 0.05, "sigma": 0.2},
}
FRICTION = 0.02  # relative to the effort limits


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of the loop.

    Attributes:
        sensors: of the simulation alone; not declared to the controller.
        friction: of the true joints, relative to their effort limits.
        engine: of the simulation.
        options: of the controller.
    """

    sensors: pa.Sensors = field(default_factory=pa.Sensors)
    friction: float = 0.0
    engine: Any = "pinocchio"
    options: dict[str, Any] = field(default_factory=dict)


DISTURBANCES = {
    "nothing": Disturbance(),
    "noise": Disturbance(pa.Sensors(encoder=2.0 * math.pi / 2**17)),
    "late motors": Disturbance(engine=pa.robot.Actuators(delay=6e-3)),
    "friction": Disturbance(friction=FRICTION),
    "elastic joints": Disturbance(engine=pa.robot.Actuators(stiffness=5e3)),
    "noise, law (11), gradient": Disturbance(
        pa.Sensors(encoder=2.0 * math.pi / 2**17),
        options={"law": "adaptive-inverse-dynamics", "adaptation": "gradient"},
    ),
}
OF_VELOCITY = ("e1", "dead zone", "dead zone, sigma")  # scaled for errors of the joint velocity


def measure(robot: str, disturbance: str, modification: str, duration: float) -> dict[str, Any]:
    """Return the figures of one run.

    Raises:
        InputError: the modification is scaled for errors of the joint velocity, the law has others.
    """
    case, described = DISTURBANCES[disturbance], pa.load(robot)
    if case.options and modification in OF_VELOCITY:
        raise pa.InputError("is scaled for errors of the joint velocity.", where=modification)
    own = np.diag(pin.crba(described.model, described.model.createData(), described.q0))
    described = described.changed(armature=np.maximum(0.5 * own, 0.02))
    load = pa.Payload(1.5, [0.02, -0.01, 0.05], [0.01, 0.0, 0.01, 0.0, 0.0, 0.01])
    true = described.changed(payload=load, tool_translation=[0.03, -0.02, 0.08])
    efforts = case.friction * described.model.upperEffortLimit
    true = true.changed(coulomb=efforts, viscous=0.5 * efforts)
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0, "yz").starting_at(true.position(true.q0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of undeclared noise
        controller = pa.make_controller(
            described.changed(inertial_scale=0.8),
            unknown=pa.Unknown(friction=False, armature=False),
            modifications=MODIFICATIONS[modification],
            **case.options | ({"adaptation": "none"} if modification == UNADAPTED else {}),
        )
        rollout = pa.simulate(
            true,
            controller,
            path.as_given(),
            duration=duration,
            engine=case.engine,
            sensors=case.sensors,
            record_every=5,
            progress=False,
        )
    if rollout.diverged is not None:
        reason = f"at {rollout.diverged:.1f} s"
        return {"status": "diverged", "reason": reason, "diverged": rollout.diverged}
    last = rollout.t > 0.9 * duration
    return {
        "diverged": None,
        "error_mm": 1e3 * float(rollout.distance[last].max()),
        "factor": moved(rollout.a_d, described.model.nv),
        "chatter": float(np.sqrt(np.mean(np.diff(rollout.tau[last], axis=0) ** 2))),
    }


def moved(a_d: np.ndarray, bodies: int) -> float | None:
    """Return the largest change of any body in any direction in the last quarter, as a factor.

    None for bodies that are not physical, for which the factor is not defined.
    """
    tens = (a_d[index].reshape(bodies, 10) for index in (3 * len(a_d) // 4, len(a_d) - 1))
    largest = 0.0
    for before, after in zip(*tens, strict=True):
        ratios = np.linalg.eigvals(np.linalg.solve(pseudo_inertia(before), pseudo_inertia(after)))
        if np.abs(ratios.imag).max() > 1e-6 or ratios.real.min() <= 0.0:
            return None
        largest = max(largest, float(np.abs(np.log(ratios.real)).max()))
    return math.exp(min(largest, 700.0))


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown, by robot and modification: error [mm] and drift."""
    columns = list(dict.fromkeys(row["disturbance"] for row in rows))
    cells = {(row["robot"], row["modification"], row["disturbance"]): _cell(row) for row in rows}
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for robot, kind in dict.fromkeys((row["robot"], row["modification"]) for row in rows):
        own = [cells.get((robot, kind, column), "") for column in columns]
        lines.append(f"| {robot}, {kind} | " + " | ".join(own) + " |")
    return "\n".join(lines)


def _cell(row: Mapping[str, Any]) -> str:
    """Return error and drift of a run; nothing where the modification does not fit the law."""
    if row["status"] != "done":
        return "" if row["status"] == "refused" else f"lost {row['reason']}"
    drift = "unphysical" if row["factor"] is None else f"{row['factor']:.3g}"
    return f"{row['error_mm']:.2g}\N{NO-BREAK SPACE}mm, {drift}"
