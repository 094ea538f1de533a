"""Whether the default law rings or fails for some choice of unknowns.

``python -m benchmarks.tables unknowns`` runs the sweep ``unknowns.toml``: every chain of the
catalogue, on the circle of the zoo, with what is unknown as true as it can be (the model is the
robot), so that nothing but the loop itself can make a torque oscillate.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import pinadapt as pa

from .timing import markdown

DURATION, DT = 2.0, 1e-3  # [s]; ringing grows within some periods of its own
SENSORS = {"perfect": pa.Sensors(), "17 bit": pa.Sensors(encoder=2.0 * math.pi / 2**17)}
load = cache(pa.load)


def measure(robot: str, unknown: str, sensors: str) -> dict[str, Any]:
    """Return the figures of one run.

    Args:
        robot: name in the catalogue.
        unknown: what is adapted: "payload", "bodies" or "everything".
        sensors: "perfect" or "17 bit"; the controller knows which.
    """
    true = load(robot)
    circle = pa.reachable_circle(true)
    chosen = pa.Unknown() if unknown == "everything" else unknown
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of descriptions, and of ringing
        controller = pa.make_controller(true, unknown=chosen, sensors=SENSORS[sensors], dt=DT)
        rollout = pa.simulate(
            true,
            controller,
            circle.starting_at(true.position(true.q0)),
            duration=DURATION,
            sensors=SENSORS[sensors],
            progress=False,
        )
    found = rollout.ringing
    return {
        "lost": rollout.diverged is not None,
        "hertz": None if found is None else found.frequency,
        "joint": None if found is None else found.joint,
        "error": float(rollout.distance.max()),
    }


def report(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return how many runs ring or are lost, by unknowns and sensors."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["unknown"], row["sensors"]), []).append(row)
    lines = [
        [
            *key,
            str(len(own)),
            ", ".join(row["robot"] for row in own if row["hertz"] is not None) or "none",
            ", ".join(row["robot"] for row in own if row["lost"]) or "none",
        ]
        for key, own in groups.items()
    ]
    return markdown(["unknown", "sensors", "chains", "ring", "lost"], lines)
