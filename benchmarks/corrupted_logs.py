"""What is said about recorded motions of real arms that were corrupted on purpose.

``python -m benchmarks.corrupted_logs FOLDER`` checks the logs of ``benchmarks.real_logs``, first as
they are and then with usual mistakes in them, as ``pinadapt identify`` does before it learns
anything. It prints the factor and the correlation of each joint of the logs as they are, and for
each mistake what was named. The exit status is 1 if a log as it is was refused, or one with a
mistake was not.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

import pinadapt as pa
from benchmarks.real_logs import chosen_logs
from pinadapt.identification import check_torques

OTHERS = {"panda": "xarm7", "ur10": "z1", "tx40": "z1", "tiago": "xarm7"}
SMALLER = {"ur10": "ur5"}  # of the same kind
GEAR, REPEATED = 100.0, 0.2

Case = tuple[pa.Log, pa.Robot]


def checked(log: pa.Log, robot: pa.Robot) -> tuple[bool, str]:
    """Return whether a log is accepted, and what is said about it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check = check_torques(pa.read_log(log, robot), robot)
    except pa.LogError as error:
        return False, str(error)
    return check.fits, check.verdict


def hung(robot: pa.Robot, gravity: tuple[float, float, float]) -> pa.Robot:
    """Return a robot described in another gravity than the one it moved in."""
    model = robot.model.copy()
    model.gravity.linear = np.array(gravity)
    return replace(robot, model=model)


def scaled(log: pa.Log, q: np.ndarray | float = 1.0, tau: np.ndarray | float = 1.0) -> pa.Log:
    """Return a log with positions and velocities, and torques, times factors (n)."""
    v = None if log.v is None else log.v * q
    return replace(log, q=log.q * q, v=v, tau=log.tau * tau)


def ordered(log: pa.Log, order: Sequence[int], *, motion: bool = True) -> pa.Log:
    """Return a log with its torques, and its motion, in another order of the joints."""
    log = replace(log, tau=log.tau[:, order])
    if not motion:
        return log
    return replace(log, q=log.q[:, order], v=None if log.v is None else log.v[:, order])


def rows(log: pa.Log, kept: np.ndarray) -> pa.Log:
    """Return a log with other samples."""
    v = None if log.v is None else log.v[kept]
    return replace(log, t=log.t[kept], q=log.q[kept], v=v, tau=log.tau[kept])


def without(log: pa.Log, joint: int) -> pa.Log:
    """Return a log without one of the joints."""
    kept = [j for j in range(log.tau.shape[1]) if j != joint]
    return replace(ordered(log, kept), joints=())


def mistakes(log: pa.Log, robot: pa.Robot, *others: pa.Robot) -> Iterator[tuple[str, Case]]:
    """Yield the name of each mistake, and log and robot with it."""
    n, rng, names = robot.model.nv, np.random.default_rng(0), robot.joint_names
    signs = 1.0 - 2.0 * np.eye(n)
    yield "amperes", (scaled(log, tau=0.1), robot)
    yield "amperes of unlike motors", (scaled(log, tau=rng.uniform(0.05, 0.2, n)), robot)
    yield "torques before the gear", (scaled(log, tau=1.0 / GEAR), robot)
    yield "positions before the gear", (scaled(log, q=GEAR), robot)
    yield "degrees", (scaled(log, q=np.degrees(1.0)), robot)
    yield "all signs of the torque", (scaled(log, tau=-1.0), robot)
    for j in range(4):
        yield f"sign of the torque, {names[j]}", (scaled(log, tau=signs[j]), robot)
    for j in range(1, 4):
        yield f"sign of the position, {names[j]}", (scaled(log, q=signs[j]), robot)
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
        yield f"torques of {pair} swapped", (ordered(log, order, motion=False), robot)
    yield "joints from the last to the first", (ordered(log, range(n)[::-1]), robot)
    samples = np.arange(len(log.t))
    chosen = rng.uniform(size=len(samples)) < REPEATED
    late = replace(rows(log, np.maximum(samples - chosen, 0)), t=log.t)
    yield "samples repeated at new times", (late, robot)
    yield "samples twice", (rows(log, np.sort(np.append(samples, samples[chosen]))), robot)
    yield "a torque not recorded", (scaled(log, tau=1.0 - np.eye(n)[1]), robot)
    yield "a joint missing", (without(log, 1), robot)
    for other in others:
        yield f"another robot, {other.name}", (replace(log, joints=()), other)


def main() -> int:
    """Print the tables; return the exit status."""
    warnings.simplefilter("ignore")
    wrong = 0
    for name, file, robot in chosen_logs(__doc__):
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
