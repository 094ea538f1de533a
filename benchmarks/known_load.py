"""The load from an exciting motion: its error, and how often the error is within the uncertainty.

``python -m benchmarks.known_load [--save FILE] [--seeds N] [--arms M]`` runs the scenarios
``robots/panda/excited_load.toml`` and ``robots/ur10/excited_load.toml`` (friction unknown, encoders
of 17 bits, torque noise of 1 % of the effort limits) with N seeds of noise and friction, the arm as
described; and with M arms whose bodies' masses and inertias are off by 3 %, estimated without a
prior of the arm, with one (``arm``), and with a run without load (``empty``).
"""

from __future__ import annotations

import argparse
import os
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario

from .timing import HERE, save

ROBOTS = {"panda": 1.5, "ur10": 3.0}  # kg
COM = 1e3 * np.array([0.02, -0.01, 0.05])  # mm
OFF = 0.03
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


def measure(robot: str, seeds: int, arms: int) -> list[dict[str, Any]]:
    """Return a row for the arm as described, and one per option for arms that are not."""
    mass, cases = ROBOTS[robot], defaultdict(list)
    for seed in range(seeds):
        cases["as described"].append(errors(run(robot, seed, 0.0).payload(refined=True), mass))
    for seed in range(arms):
        loaded = run(robot, seed, OFF)
        empty = run(robot, 1000 + seed, OFF, "truth.payload={mass=0.0}")
        for name, known in (
            ("off, no prior", {}),
            ("off, arm", {"arm": OFF}),
            ("off, arm and empty", {"arm": OFF, "empty": empty}),
        ):
            cases[name].append(errors(loaded.payload(refined=True, **known), mass))
    return [row(f"{robot}, {name}", found) for name, found in cases.items()]


def main() -> None:
    """Print the table and save it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "known_load.json")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--arms", type=int, default=8)
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        coming = [pool.submit(measure, robot, options.seeds, options.arms) for robot in ROBOTS]
        rows = [each for future in coming for each in future.result()]
    print("mass [g] and centre x, y, z [mm]: rms error, uncertainty, share within twice that")
    for each in rows:
        parts = (each[key] for key in ("rms_g_mm", "known_to_g_mm", "within_two"))
        cells = ["  ".join(f"{number:7.3g}" for number in part) for part in parts]
        print(f"{each['name']:20}" + "   ".join(cells))
    save(options.save, rows)


if __name__ == "__main__":
    main()
