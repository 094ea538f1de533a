"""The accuracy of robots identified from logs with exact and with noisy sensors.

``make identification.table`` runs the sweep ``identification.toml`` and writes
``identification.csv``: robots whose load, tool, friction and rotors are unknown move for 14 s along
a Lissajous figure, and are identified from the log. Errors of torques are those of the held-out
part. ``python -m benchmarks.identification FILE`` writes the picture of ``docs/identify.md``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa

from .shared import COUNT, Row, markdown, rms

LOAD = pa.Payload(1.5, (0.02, -0.01, 0.05), (0.01, 0.0, 0.012, 0.0, 0.0, 0.004))
TOOL = (0.03, -0.02, 0.12)
TORQUE_NOISE = 0.01  # of the effort limits
CAMERA = 1e-4  # m


@lru_cache(maxsize=2)
def rollout(name: str, engine: str = "pinocchio") -> tuple[pa.Robot, pa.Rollout]:
    """Return a robot as described, and a run of the true one under the default controller."""
    robot = pa.load(name)
    true = robot.changed(
        payload=LOAD, tool_translation=TOOL, viscous=0.5, coulomb=0.8, armature=0.05
    )
    path = pa.trajectories.Lissajous(robot.position(robot.q0), [0.12, 0.2, 0.12], [3, 4, 5], 8.0)
    controller = pa.make_controller(robot)
    run = pa.simulate(true, controller, path.as_given(), duration=14.0, engine=engine)
    return robot, run


def with_noise(run: pa.Rollout, robot: pa.Robot) -> pa.Log:
    """Return the log of a run with encoders of 17 bits, noisy torques, and a camera of 30 Hz."""
    rng = np.random.default_rng(0)
    limits = robot.model.upperEffortLimit
    q = np.round(run.q / COUNT[17]) * COUNT[17]
    tau = run.tau + TORQUE_NOISE * limits * rng.standard_normal(run.tau.shape)
    x = run.x[::33] + CAMERA * rng.standard_normal(run.x[::33].shape)
    return pa.Log(run.t, q, tau, x=x, x_time=run.t[::33], held=True, source="noisy")


def identified(name: str, log: str) -> pa.Identification:
    """Return the identification of a robot from a kind of log."""
    by_mujoco = log.endswith("MuJoCo")
    robot, run = rollout(name, "mujoco" if by_mujoco else "pinocchio")
    if by_mujoco:
        return pa.identify(run, robot)
    noisy = with_noise(run, robot)
    if log == "exact":
        return pa.identify(replace(noisy, q=run.q, v=run.v, tau=run.tau, x=run.x[::33]), robot)
    return pa.identify(noisy, robot)


def measure(robot: str, log: str) -> dict[str, Any]:
    """Return the errors of the torques [N m], and of the load [kg, m]."""
    found = identified(robot, log)
    errors = found.torque_errors
    load = found.payload(gain=0.0)
    return {
        "described": rms(errors.described_held_out),
        "learned": rms(errors.learned_held_out),
        "mass": load.mass,
        "mass_known_to": load.mass_known_to,
        "centre": float(np.linalg.norm(load.com - LOAD.com)),
    }


def report(rows: Sequence[Row]) -> str:
    """Return a table in Markdown, by robot and log."""
    cells = []
    for row in rows:
        places = max(0, int(np.ceil(-np.log10(row["mass_known_to"]))))
        cells.append(
            [
                f"{row['robot']}, {row['log']}",
                *(f"{row[key]:.2g}" for key in ("described", "learned")),
                f"{row['mass']:.{places}f} ± {row['mass_known_to']:.1g} kg",
                f"{1e3 * row['centre']:.1g} mm",
            ]
        )
    head = ["log", "described", "identified", "mass of the load", "error of its centre"]
    return markdown(head, cells)


if __name__ == "__main__":
    picture = identified("panda", "noisy").plot().torque.png(dpi=90)
    Path(sys.argv[1]).write_bytes(picture)
