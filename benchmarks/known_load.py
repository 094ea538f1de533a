"""The load from an exciting motion: its error, and how often the error is within the uncertainty.

``python -m benchmarks.known_load [--save FILE] [--seeds N] [--arms M]`` runs the scenarios
``robots/panda/excited_load.toml`` and ``robots/ur10/excited_load.toml`` (friction unknown, encoders
of 17 bits, torque noise of 1 % of the effort limits) with N seeds of noise and friction, the arm as
described; and with M arms whose bodies' masses and inertias are off by 3 %, estimated without a
prior of the arm, with one (``arm``), and with a run without load (``empty``).
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario

from .timing import HERE, save

ROBOTS = {"panda": 1.5, "ur10": 3.0}  # kg
COM = 1e3 * np.array([0.02, -0.01, 0.05])  # mm
OFF = 0.03
OPTIONS = ("as described", "off, no prior", "off, arm", "off, arm and empty")
_VARIED = 0.5, 1.5  # shares of the friction


def run(robot: str, seed: int, off: float, *settings: str) -> pa.Rollout:
    """Return a run; the seed sets noise and friction, its last three digits the arm."""
    path = HERE.parent / "robots" / robot / "excited_load.toml"
    tables = Scenario.read(path).tables
    rng, arm = np.random.default_rng(seed), np.random.default_rng(seed % 1000)
    friction = [
        f"truth.friction.{kind}={(each * rng.uniform(*_VARIED, each.size)).tolist()}"
        for kind, each in (
            ("viscous", np.array(tables.truth.friction.viscous)),
            ("coulomb", np.array(tables.truth.friction.coulomb)),
        )
    ]
    names = pa.load(robot).joint_names
    scales = ", ".join(f"{name} = {1.0 + off * arm.standard_normal()}" for name in names)
    varied = [*friction, f"truth.inertial_scale={{{scales}}}", f"simulation.seed={seed}"]
    return Scenario.read(path, [*varied, *settings]).run(progress=False)


def errors(load: pa.information.PayloadEstimate, mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of mass [g] and centre [mm], and their uncertainties."""
    off = np.array([1e3 * (load.mass - mass), *(1e3 * load.com - COM)])
    return off, np.array([1e3 * load.mass_known_to, *(1e3 * load.com_known_to)])


def row(name: str, found: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """Return rms errors, median uncertainty, and the share of errors within twice that."""
    off, known = (np.array(part) for part in zip(*found, strict=True))
    return {
        "name": name,
        "runs": len(found),
        "rms_g_mm": np.sqrt(np.mean(off**2, axis=0)).tolist(),
        "known_to_g_mm": np.median(known, axis=0).tolist(),
        "within_two": np.mean(np.abs(off) < 2.0 * known, axis=0).tolist(),
    }


def one(robot: str, number: int, described: bool) -> dict[str, Any]:
    """Return errors and uncertainties (4, 4) of one arm's load, by option."""
    mass = ROBOTS[robot]
    if described:
        found = {"as described": errors(run(robot, number, 0.0).payload(refined=True), mass)}
    else:
        loaded = run(robot, number, OFF)
        empty = run(robot, 1000 + number, OFF, "truth.payload={mass=0.0}")
        options: dict[str, dict[str, Any]] = {
            "off, no prior": {},
            "off, arm": {"arm": OFF},
            "off, arm and empty": {"arm": OFF, "empty": empty},
        }
        found = {
            name: errors(loaded.payload(refined=True, **known), mass)
            for name, known in options.items()
        }
    return {name: [*off, *known] for name, (off, known) in found.items()}


def measure(seeds: int, arms: int) -> list[dict[str, Any]]:
    """Return a row for each arm as described, and one per option for arms that are not."""
    cases = [
        {"robot": robot, "number": number, "described": described}
        for robot in ROBOTS
        for described, count in ((True, seeds), (False, arms))
        for number in range(count)
    ]
    table = pa.sweep(one, cases)
    if table.lost.any():
        raise RuntimeError(str(table))
    rows = []
    for robot, name in product(ROBOTS, OPTIONS):
        numbers = np.column_stack([table[f"{name}[{k}]"] for k in range(8)])
        numbers = numbers[(table["robot"] == robot) & np.isfinite(numbers).all(axis=1)]
        rows.append(row(f"{robot}, {name}", [(each[:4], each[4:]) for each in numbers]))
    return rows


def main() -> None:
    """Print the table and save it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "known_load.json")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--arms", type=int, default=8)
    options = parser.parse_args()
    rows = measure(options.seeds, options.arms)
    print("mass [g] and centre x, y, z [mm]: rms error, uncertainty, share within twice that")
    for each in rows:
        parts = (each[key] for key in ("rms_g_mm", "known_to_g_mm", "within_two"))
        cells = ["  ".join(f"{number:7.3g}" for number in part) for part in parts]
        print(f"{each['name']:20}" + "   ".join(cells))
    save(options.save, rows)


if __name__ == "__main__":
    main()
