"""Whether the default law rings or fails for some choice of unknowns.

``python -m benchmarks.tables unknowns`` runs the sweep ``unknowns.toml``: every chain of the
catalogue, on the circle of the zoo, with what is unknown as true as it can be (the model is the
robot), so that nothing but the loop itself can make a torque oscillate.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import pinadapt as pa

from .shared import COUNT, Row, grouped, markdown, quiet

DURATION, DT = 2.0, 1e-3  # [s]; ringing grows within some periods of its own
SENSORS = {"perfect": pa.Sensors(), "17 bit": pa.Sensors(encoder=COUNT[17])}
load = cache(pa.load)


@quiet()  # of descriptions, and of ringing
def measure(robot: str, unknown: str, sensors: str) -> dict[str, Any]:
    """Return the figures of one run.

    Args:
        robot: name in the catalogue.
        unknown: what is adapted: "payload", "bodies" or "everything".
        sensors: "perfect" or "17 bit"; the controller knows which.
    """
    true = load(robot)
    controller = pa.make_controller(
        true,
        unknown=pa.Unknown() if unknown == "everything" else unknown,
        sensors=SENSORS[sensors],
        dt=DT,
    )
    rollout = pa.simulate(
        true,
        controller,
        pa.reachable_circle(true).starting_at(true.position(true.q0)),
        duration=DURATION,
        sensors=SENSORS[sensors],
        progress=False,
    )
    found = rollout.ringing
    return {
        "lost": rollout.diverged is not None,
        "hertz": None if found is None else found.frequency,
    }


def report(rows: Iterable[Row]) -> str:
    """Return how many runs ring or are lost, by unknowns and sensors."""
    lines = []
    for key, own in grouped(rows, "unknown", "sensors").items():
        ring = [row["robot"] for row in own if row["hertz"] is not None]
        lost = [row["robot"] for row in own if row["lost"]]
        lines.append([*key, len(own), *(", ".join(names) or "none" for names in (ring, lost))])
    return markdown(["unknown", "sensors", "chains", "ring", "lost"], lines)
