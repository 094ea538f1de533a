"""The load from an exciting motion: its error, and how often the error is within the uncertainty.

``make known_load.table`` runs the sweep ``known_load.toml``: the scenarios
``robots/panda/excited_load.toml`` and ``robots/ur10/excited_load.toml`` (friction unknown, encoders
of 17 bits, torque noise of 1 % of the effort limits) with several seeds of noise and friction, the
arm as described; and with arms whose bodies' masses and inertias are off by 3 %, estimated without
a prior of the arm, with one (``arm``), and with a run without load (``empty``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario

from .timing import HERE, markdown, two_digits

ROBOTS = {"panda": 1.5, "ur10": 3.0}  # kg
COM = 1e3 * np.array([0.02, -0.01, 0.05])  # mm
OFF = 0.03
DESCRIBED = "as described"
OPTIONS = {
    "off": "none: other explanations are compared",
    "off, arm": f"`arm={OFF}`",
    "off, arm and empty": f"`arm={OFF}`, `empty=...`",
}
PARTS = ("mass_g", "x_mm", "y_mm", "z_mm")
TITLES = {"panda": "Panda", "ur10": "UR10"}
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


def measure(robot: str, number: int, described: bool) -> dict[str, Any]:
    """Return errors and uncertainties of one arm's load, by option."""
    mass = ROBOTS[robot]
    if described:
        found = {DESCRIBED: errors(run(robot, number, 0.0).payload(refined=True), mass)}
    else:
        loaded = run(robot, number, OFF)
        empty = run(robot, 1000 + number, OFF, "truth.payload={mass=0.0}")
        known: dict[str, dict[str, Any]] = {
            "off": {},
            "off, arm": {"arm": OFF},
            "off, arm and empty": {"arm": OFF, "empty": empty},
        }
        found = {
            name: errors(loaded.payload(refined=True, **words), mass)
            for name, words in known.items()
        }
    return {
        name: {
            "error": dict(zip(PARTS, off.tolist(), strict=True)),
            "known_to": dict(zip(PARTS, known_to.tolist(), strict=True)),
        }
        for name, (off, known_to) in found.items()
    }


def figures(
    rows: Iterable[Mapping[str, Any]], robot: str, option: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rms error, median uncertainty, and how often the error is within twice that (4)."""
    keys = [f"{option}.{kind}.{part}" for kind in ("error", "known_to") for part in PARTS]
    own = [row for row in rows if row["robot"] == robot and row.get(keys[0]) is not None]
    off, known = np.hsplit(np.array([[row[key] for key in keys] for row in own]), 2)
    within = np.sum(np.abs(off) < 2.0 * known, axis=0)
    return np.sqrt(np.mean(off**2, axis=0)), np.median(known, axis=0), within


def as_described(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown of the arms as described."""
    rows = list(rows)
    body = [[TITLES[robot], *_cells(*figures(rows, robot, DESCRIBED))] for robot in ROBOTS]
    return _table("arm", body)


def off_by_some_per_cent(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown of the arms whose description is off."""
    rows = list(rows)
    body = [
        [f"{TITLES[robot]}; {words}", *_cells(*figures(rows, robot, option))]
        for robot, (option, words) in product(ROBOTS, OPTIONS.items())
    ]
    return _table("option", body)


def _cells(rms: np.ndarray, known: np.ndarray, within: np.ndarray) -> list[str]:
    def centre(numbers: np.ndarray) -> str:
        return ", ".join(map(two_digits, numbers[1:])) + " mm"

    return [
        f"{two_digits(rms[0])} g",
        centre(rms),
        f"{two_digits(known[0])} g; {centre(known)}",
        f"{within[0]}; {', '.join(map(str, within[1:]))}",
    ]


def _table(first: str, body: list[list[str]]) -> str:
    head = [
        first,
        "error of the mass, rms",
        "of the centre x, y, z, rms",
        "stated",
        "runs with the truth within two stated deviations: mass; centre",
    ]
    return markdown(head, body)
