"""From a log to a loop: what a controller gains that starts from what was identified.

``python -m benchmarks.from_log [--robots NAMES]`` records 14 s of a Lissajous figure with encoders
of 17 bits, noisy torques and a camera, identifies the robot, and prints a table for
``docs/identify.md``. Each robot then follows a circle of 0.1 m under the default law at 500 Hz, for
10 s, from the description (inertias 30 % too small, load, tool and friction unknown) and from the
identified robot; with the load of the log and with another one, with perfect sensors and with those
of the log.

The price of ignorance is the error over that of the loop with the true model, both the largest of a
time. The last column is the error of the predicted torque, rms over random states of the robot, by
the model at the start and at the end of the run: what the loop learned, and what it forgot.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import pinadapt as pa

from .identification import CAMERA, COUNT, LOAD, TOOL, with_noise

FRICTION: dict[str, Any] = {"viscous": 0.5, "coulomb": 0.8, "armature": 0.05}
OTHER = pa.Payload(2.5, (0.0, 0.03, 0.08))
LOADS = {"panda": 1.0, "ur5": 1.0, "xarm7": 1.0}  # of the loads above
LIGHTER, DT, DURATION = 0.7, 2e-3, 10.0
PERFECT = pa.Sensors()
NOISY = pa.Sensors(encoder=COUNT, camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": CAMERA})
STATES = 300  # random ones
SPREAD, SPEED, ACCELERATION = 0.5, 1.0, 3.0  # rad, rad/s, rad/s^2, standard deviations


def scaled(load: pa.Payload, share: float) -> pa.Payload:
    """Return a load with a share of the mass and inertia."""
    return pa.Payload(share * load.mass, load.com, share * np.array(load.inertia))


def identified(name: str) -> tuple[pa.Robot, pa.Identification]:
    """Return the described robot with too small inertias, and the identification from a log."""
    robot = pa.load(name)
    true = real(robot, LOAD)
    model = robot.changed(inertial_scale=LIGHTER)
    path = pa.trajectories.Lissajous(robot.position(robot.q0), [0.12, 0.2, 0.12], [3, 4, 5], 8.0)
    run = pa.simulate(true, pa.make_controller(model, dt=DT), path.as_given(), duration=14.0)
    return model, pa.identify(with_noise(run, robot), model)


def real(robot: pa.Robot, load: pa.Payload) -> pa.Robot:
    """Return the true robot with a load."""
    return robot.changed(payload=scaled(load, LOADS[robot.name]), tool_translation=TOOL, **FRICTION)


def torque_error(controller: pa.Controller, true: pa.Robot, a_d: np.ndarray) -> float:
    """Return the rms error of the predicted torque over random states [N m]."""
    rng, model, truth = np.random.default_rng(1), true.model, pa.make_controller(true).dynamics
    exact = truth.value(true)
    assert exact is not None  # all bodies and joints are parameters
    truth.load(exact)
    controller.dynamics.load(a_d)
    errors = []
    for _ in range(STATES):
        q = true.q0 + SPREAD * rng.standard_normal(model.nq)
        q = np.clip(q, model.lowerPositionLimit, model.upperPositionLimit)
        v, a = rng.standard_normal((2, model.nv)) * [[SPEED], [ACCELERATION]]
        errors.append(controller.dynamics.torque(q, v, a) - truth.torque(q, v, a))
    return float(np.sqrt(np.mean(np.square(errors))))


def rows(name: str) -> Iterator[tuple[str, ...]]:
    """Yield one row of the table per run."""
    model, found = identified(name)
    learned, robot = found.parameters(), pa.load(name)
    for load, sensors in ((LOAD, PERFECT), (LOAD, NOISY), (OTHER, PERFECT), (OTHER, NOISY)):
        true = real(robot, load)
        words = f"{name}, {'the' if load is LOAD else 'another'} load"
        words += ", perfect sensors" if sensors is PERFECT else ", noise"
        path, best = pa.reachable_circle(true), np.ones(2)
        from_log: dict[str, Any] = {"unknown": found.unknown}
        starts: dict[str, tuple[pa.Robot, dict[str, Any], Any]] = {
            "truth": (true, {"adaptation": "none"}, None),
            "described": (model, {}, None),
            "identified": (found.robot, from_log, None),
            "and its information": (found.robot, from_log, learned),
        }
        for start, (believed, options, known) in starts.items():
            controller = pa.make_controller(believed, sensors=sensors, dt=DT, **options)
            run = pa.simulate(true, controller, path, duration=DURATION, start=known)
            parts = run.t <= 1.0, run.t > 0.9 * DURATION
            error = np.array([run.distance[part].max() for part in parts])
            best = error if start == "truth" else best
            torques = [torque_error(controller, true, a) for a in (run.a_d[0], run.a_d[-1])]
            yield (
                words,
                start,
                *(f"{1e3 * one:.2g}" for one in error),
                *(f"{one:.2g}" for one in error / best),
                "-" if start == "truth" else " -> ".join(f"{one:.2g}" for one in torques),
            )


def report(table: Sequence[str]) -> str:
    """Return a row in Markdown."""
    return f"| {' | '.join(table)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default=",".join(LOADS))
    options = parser.parse_args()
    print(
        "| run | start | first second [mm] | last | price, first second | last | torque [N m] |\n"
        "|---|---|---|---|---|---|---|"
    )
    warnings.simplefilter("ignore")  # of light joints; the table has the result
    for name in options.robots.split(","):
        for row in rows(name):
            print(report(row), flush=True)


if __name__ == "__main__":
    main()
