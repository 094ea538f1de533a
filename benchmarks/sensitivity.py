"""What half and twice of each number of the default law do.

``python -m benchmarks.sensitivity`` prints the table of docs/default_law.md: the errors of the last
half turn in % of the radius, median / worst of four arms (one seed, 4 s), the largest error of a
UR10's first second under an unknown load of 5 % of its mass [mm], and that of a push of 40 N [mm].
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from typing import Any

import pinadapt as pa
from pinadapt.adaptation import natural
from pinadapt.laws import Separation, separation
from pinadapt.tuning import rates

from .realities import measure
from .shared import markdown, spread
from .third_party_robots import unlike

ARMS = "panda", "z1", "ur10", "kinova"
REALITIES = "perfect", "17 bit declared", "motors 10 ms late", "dry friction", "warming up", "push"
START, SECONDS = "start", 4.0
NUMBERS: dict[str, tuple[Any, str]] = {
    "w": (Separation, "own_bandwidth"),
    "K_v in w M": (separation, "_DAMPING"),
    "load assumed for K_v, its mass": (separation, "LOAD"),
    "its lever": (separation, "_ARM"),
    "lag": (separation, "_LAG"),
    "rho in w": (Separation, "prediction_mode"),
    "noise of the memory": (rates, "_NOISE"),
    "width of P": (rates, "_WIDTH"),
    "doubt": (rates, "_DOUBT"),
    "largest step of an estimate": (natural, "_LONGEST"),
}
Case = tuple[str | None, float, str, str]


def figures(case: Case) -> dict[str, float | None]:
    """Return error [%], largest error of the first second and of the push [mm] of one run."""
    number, factor, reality, arm = case
    owner, name = NUMBERS[number or "w"]
    before = getattr(owner, name)
    setattr(owner, name, before if number is None else factor * before)
    try:
        if reality == START:
            return {"first": 1e3 * start(arm)}
        row = measure(arm, reality, "default", duration=SECONDS)
    finally:
        setattr(owner, name, before)
    error = row.get("error")
    pushed = row.get("pushed")
    return {
        "error": None if error is None else 100.0 * error,
        "pushed": None if pushed is None else 1e3 * pushed,
    }


def start(arm: str) -> float:
    """Return the largest error [m] of the first second with an unknown load, tool and inertias."""
    robot = pa.load(arm)
    true, model = unlike(robot)
    controller = pa.make_controller(model, unknown=pa.Unknown(tool=True))
    motion = pa.reachable_circle(robot).starting_at(true.position(true.q0))
    rollout = pa.simulate(true, controller, motion, duration=1.0, progress=False)
    return float(rollout.distance.max())


def cell(found: list[dict[str, float | None]], key: str) -> str:
    """Return median / worst of the runs that are not lost, and how many are."""
    values = [value for run in found if (value := run[key]) is not None]
    lost = len(found) - len(values)
    return ", ".join([spread(values)] * bool(values) + [f"{lost} lost"] * bool(lost))


def main() -> None:
    """Run all cases and print the table."""
    variants = [(None, 1.0), *((name, factor) for name in NUMBERS for factor in (0.5, 2.0))]
    cells = [(reality, arm) for reality in REALITIES for arm in ARMS] + [(START, "ur10")]
    cases = [(*variant, *each) for variant in variants for each in cells]
    with ProcessPoolExecutor() as pool:
        found = dict(zip(cases, pool.map(figures, cases), strict=True))
    lines = []
    for name, factor in variants:
        runs = {
            reality: [found[name, factor, reality, arm] for each, arm in cells if each == reality]
            for reality in (*REALITIES, START)
        }
        errors = [cell(runs[reality], "error") for reality in REALITIES[:-1]]
        last = [cell(runs["push"], "pushed"), cell(runs[START], "first").split(" / ")[0]]
        lines.append([name or "as it is", f"{factor:g}", *errors, *last])
    print(markdown(["number", "times", *REALITIES[:-1], "push [mm]", "start [mm]"], lines))


if __name__ == "__main__":
    main()
