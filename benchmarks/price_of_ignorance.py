"""The price of ignorance: the error of an adapted loop over that of the same loop with the truth.

``python -m benchmarks.price_of_ignorance [--save FILE] [--laws NAMES] [--robots NAMES]`` runs every
law that adapts and follows motions, under natural adaptation with and without memory, and the
default law under the others as well. Unknown are a tool of 13 cm, a load of 1.5 kg (z1: 0.75) and
every inertia (30 % too small in the model); no friction, perfect sensors. By default the friction
and the rotors are unknown too, and the feedback has a lag of 10 ms: the row of the truth with that
lag tells its share of the price. The task frame
follows a circle of 0.1 m in 3 s, joint-space laws swing every joint by 0.2 rad in 3 s; default
gains, 1 kHz. Rows of other laws and robots in the file are kept.

The error after T seconds is the largest of the last tenth of them, from 0.9 T to T, of one run of
40 s. The price is that error relative to the error, in the same window, of the loop with the true
model and no adaptation.
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.laws import DEFAULT

from .timing import HERE, save, saved

LOADS = {"panda": 1.5, "ur5": 1.5, "z1": 0.75}  # [kg]
AFTER = (5.0, 10.0, 20.0, 40.0)  # [s]
TOOL = (0.03, -0.02, 0.12)  # [m]
CENTRE = (0.02, -0.01, 0.05)  # [m]
TURNING = (0.01, 0.0, 0.012, 0.0, 0.0, 0.004)  # [kg m^2], of the Panda's load
LIGHTER = 0.7
TRACKING = [name for name, law in pa.laws.LAWS.items() if law.adapts and not law.set_point]
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
EVERYWHERE = (TRUTH, "natural", "natural-memory")


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        robot, law, adaptation: by name.
    """

    robot: str
    law: str
    adaptation: str

    @property
    def joints(self) -> bool:
        """Whether the law is one of joint space, which sees no tool."""
        return pa.laws.LAWS[self.law].joint_space

    def robots(self) -> tuple[pa.Robot, pa.Robot]:
        """Return the described robot and the real one."""
        task: dict[str, Any] = {"task": "joint"} if self.joints else {}
        robot, mass = pa.load(self.robot, **task), LOADS[self.robot]
        load = pa.Payload(mass, CENTRE, mass / LOADS["panda"] * np.array(TURNING))
        tool: dict[str, Any] = {} if self.joints else {"tool_translation": TOOL}
        return robot, robot.changed(payload=load, **tool)

    def path(self, true: pa.Robot) -> pa.trajectories.Trajectory:
        """Return the motion, from home, at speed from the first sample."""
        if self.joints:
            return pa.trajectories.Sinusoid(true.home_angles + SWING, SWING, PERIOD).as_given()
        circle = pa.trajectories.Circle(np.zeros(3), RADIUS, PERIOD, "yz")
        return circle.starting_at(true.position(true.q0)).as_given()

    def errors(self) -> list[float | None]:
        """Return the error after each time [m or rad]; None once the loop has diverged."""
        robot, true = self.robots()
        known = self.adaptation in (TRUTH, SLOWER)
        model = true if known else robot.changed(inertial_scale=LIGHTER)
        words: dict[str, Any] = {"unknown": pa.Unknown(friction=False, armature=False)}
        words |= ADAPTATIONS[self.adaptation]
        controller = pa.make_controller(model, law=self.law, **words)
        rollout = pa.simulate(true, controller, self.path(true), duration=AFTER[-1])
        t, error = rollout.t, rollout.distance
        lost = np.inf if rollout.diverged is None else rollout.diverged
        return [
            float(error[(t > 0.9 * end) & (t <= end)].max()) if end < lost else None
            for end in AFTER
        ]


def measured(run: Run) -> list[float | None]:
    """Return the errors of a run, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light joints; the table has the result
        return run.errors()


def runs(laws: Sequence[str], robots: Sequence[str]) -> list[Run]:
    """Return all runs: every adaptation with the default law, three with the others."""
    return [
        Run(robot, law, kind)
        for law, robot, kind in product(laws, robots, ADAPTATIONS)
        if kind in EVERYWHERE or law == DEFAULT
    ]


def rows(found: Mapping[Run, list[float | None]]) -> list[dict[str, Any]]:
    """Return one row per run, with the price of the adapted ones."""
    table = []
    for run, errors in found.items():
        known = found[Run(run.robot, run.law, TRUTH)]
        price = [
            None if error is None or best is None else error / best
            for error, best in zip(errors, known, strict=True)
        ]
        table.append(
            {
                "name": f"{run.law}, {run.robot}, {run.adaptation}",
                "law": run.law,
                "robot": run.robot,
                "adaptation": run.adaptation,
                "unit": "rad" if run.joints else "m",
                "after": AFTER,
                "error": errors,
                "price": price,
            }
        )
    return table


def report(table: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown: errors with the true model [um or urad], below them prices."""
    by_name = {(row["law"], row["robot"], row["adaptation"]): row for row in table}
    head = [f"{robot} {end:g} s" for robot, end in product(LOADS, AFTER)]
    lines = [["law", "adaptation", *head], ["---"] * (len(head) + 2)]
    for law, kind in product(dict.fromkeys(row["law"] for row in table), ADAPTATIONS):
        found = [by_name.get((law, robot, kind)) for robot in LOADS]
        if any(found):
            lines.append([f"`{law}`", _TITLES.get(kind, f"`{kind}`")])
            lines[-1] += [cell for row in found for cell in _cells(row)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cells(row: Mapping[str, Any] | None) -> list[str]:
    """Return errors for the true model, else prices, one for each time."""
    if row is None:
        return ["-"] * len(AFTER)
    known = row["adaptation"] == TRUTH
    numbers = [e and 1e6 * e for e in row["error"]] if known else row["price"]
    return ["lost" if n is None else f"{n:.2g}" if n < 100.0 else f"{n:.0f}" for n in numbers]


def main() -> None:
    """Run all, print and save the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "price_of_ignorance.json")
    parser.add_argument("--laws", default=",".join(TRACKING))
    parser.add_argument("--robots", default=",".join(LOADS))
    parser.add_argument("--processes", type=int, default=None)
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    chosen = runs(options.laws.split(","), options.robots.split(","))
    found = {}
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
        for run, errors in zip(chosen, pool.map(measured, chosen), strict=True):
            print(run, errors, flush=True)
            found[run] = errors
    new = {row["name"]: row for row in rows(found)}
    table = list((saved(options.save) | new).values())
    save(options.save, table)
    print(report(table))


if __name__ == "__main__":
    main()
