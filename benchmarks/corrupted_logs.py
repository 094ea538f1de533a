"""What is said about recorded motions of real arms that were corrupted on purpose.

``python -m benchmarks.corrupted_logs FOLDER`` checks the logs of ``benchmarks.real_logs``, first as
they are and then with usual mistakes in them, as ``pinadapt identify`` does before it learns
anything. It prints the factor and the correlation of each joint of the logs as they are, and for
each mistake what was named. The exit status is 1 if a log as it is was refused, or one with a
mistake was not.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.identification import check_torques

from .real_logs import logs_of
from .shared import quiet

OTHERS = {"panda": "xarm7", "ur10": "z1", "tx40": "z1", "tiago": "xarm7"}
SMALLER = {"ur10": "ur5"}  # of the same kind
GEAR, REPEATED = 100.0, 0.2

Case = tuple[pa.Log, pa.Robot]


@quiet()
def checked(log: pa.Log, robot: pa.Robot) -> tuple[bool, str]:
    """Return whether a log is accepted, and what is said about it."""
    try:
        check = check_torques(pa.read_log(log, robot), robot)
    except pa.LogError as error:
        return False, str(error)
    return check.fits, check.verdict


def hung(robot: pa.Robot, gravity: tuple[float, float, float]) -> pa.Robot:
    """Return a robot described in another gravity than the one it moved in."""
    model = robot.model.copy()
    model.gravity.linear = np.array(gravity)
    return replace(robot, model=model)


def motion(log: pa.Log, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """Return changed positions and velocities (N, n) of a log."""
    return {"q": change(log.q), "v": None if log.v is None else change(log.v)}


def ordered(log: pa.Log, order: Sequence[int]) -> pa.Log:
    """Return a log with torques and motion in another order of the joints, or of some of them."""
    return replace(log, tau=log.tau[:, order], **motion(log, lambda x: x[:, order]))


def rows(log: pa.Log, kept: np.ndarray) -> pa.Log:
    """Return a log with other samples."""
    return replace(log, t=log.t[kept], tau=log.tau[kept], **motion(log, lambda x: x[kept]))


def mistakes(log: pa.Log, robot: pa.Robot, *others: pa.Robot) -> Iterator[tuple[str, Case]]:
    """Yield the name of each mistake, and log and robot with it."""
    n = robot.model.nv
    rng = np.random.default_rng(0)
    names = robot.joint_names
    signs = 1.0 - 2.0 * np.eye(n)
    torques = {
        "amperes": 0.1,
        "amperes of unlike motors": rng.uniform(0.05, 0.2, n),
        "torques before the gear": 1.0 / GEAR,
        "all signs of the torque": -1.0,
        **{f"sign of the torque, {names[j]}": signs[j] for j in range(4)},
        "a torque not recorded": 1.0 - np.eye(n)[1],
    }
    for what, factors in torques.items():
        yield what, (replace(log, tau=log.tau * factors), robot)
    motions = {
        "positions before the gear": GEAR,
        "degrees": np.degrees(1.0),
        **{f"sign of the position, {names[j]}": signs[j] for j in range(1, 4)},
    }
    for what, factors in motions.items():
        yield what, (replace(log, **motion(log, partial(np.multiply, factors))), robot)
    yield "described on a wall", (log, hung(robot, (9.81, 0.0, 0.0)))
    yield "described on another wall", (log, hung(robot, (0.0, -9.81, 0.0)))
    yield "described upside down", (log, hung(robot, (0.0, 0.0, 9.81)))
    yield "described tilted by 45 degrees", (log, hung(robot, (6.94, 0.0, -6.94)))
    weight = pa.robot.Gravity(robot)
    added = np.array([weight(q) for q in log.configurations(robot)])
    yield "torques without gravity", (replace(log, tau=log.tau - added), robot)
    for j in range(3):
        order = [*range(j), j + 1, j, *range(j + 2, n)]
        pair = " and ".join(names[j : j + 2])
        yield f"{pair} swapped", (ordered(log, order), robot)
        yield f"torques of {pair} swapped", (replace(log, tau=log.tau[:, order]), robot)
    yield "joints from the last to the first", (ordered(log, range(n)[::-1]), robot)
    samples = np.arange(len(log.t))
    chosen = rng.uniform(size=len(samples)) < REPEATED
    late = replace(rows(log, np.maximum(samples - chosen, 0)), t=log.t)
    yield "samples repeated at new times", (late, robot)
    yield "samples twice", (rows(log, np.sort(np.append(samples, samples[chosen]))), robot)
    missing = ordered(log, [j for j in range(n) if j != 1])
    yield "a joint missing", (replace(missing, joints=()), robot)
    for other in others:
        yield f"another robot, {other.name}", (replace(log, joints=()), other)


def main() -> int:
    """Print the tables; return the exit status."""
    wrong = 0
    for name, file, robot in logs_of(Path(sys.argv[1])):
        with quiet():
            log = pa.read_log(file, robot)
            check = check_torques(log, robot)
        wrong += not check.fits
        print(f"\n{check}\n")
        others = [OTHERS.get(name, "z1"), *([SMALLER[name]] if name in SMALLER else [])]
        for what, case in mistakes(log, robot, *map(pa.load, others)):
            accepted, words = checked(*case)
            wrong += accepted
            print(f"{'ACCEPTED' if accepted else 'refused '}  {what}: {words}", flush=True)
    print(f"\n{wrong} of these verdicts are wrong.")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
