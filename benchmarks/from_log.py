"""From a log to a loop: what a controller gains that starts from what was identified.

``make from_log.table`` runs the sweep ``from_log.toml`` and writes ``from_log.csv``: 14 s of a
Lissajous figure are recorded with encoders of 17 bits, noisy torques and a camera, and the robot is
identified from them. Each robot then follows a circle of 0.1 m under the default law at 500 Hz, for
10 s, from the description (inertias 30 % too small, load, tool and friction unknown) and from the
identified robot; with the load of the log and with another one, with perfect sensors and with those
of the log.

The price of ignorance is the error over that of the loop with the true model, both the largest of a
time. The last columns are the error of the predicted torque, rms over random states of the robot,
by the model at the start and at the end of the run: what the loop learned, and what it forgot.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

import pinadapt as pa

from .identification import CAMERA, COUNT, LOAD, TOOL, with_noise
from .timing import markdown

FRICTION: dict[str, Any] = {"viscous": 0.5, "coulomb": 0.8, "armature": 0.05}
OTHER = pa.Payload(2.5, (0.0, 0.03, 0.08))
LOADS = {"panda": 1.0, "ur5": 1.0, "xarm7": 1.0}  # of the loads above
LIGHTER, DT, DURATION = 0.7, 2e-3, 10.0
SENSORS = {
    "perfect": pa.Sensors(),
    "noisy": pa.Sensors(
        encoder=COUNT, camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": CAMERA}
    ),
}
STATES = 300  # random ones
SPREAD, SPEED, ACCELERATION = 0.5, 1.0, 3.0  # rad, rad/s, rad/s^2, standard deviations


def scaled(load: pa.Payload, share: float) -> pa.Payload:
    """Return a load with a share of the mass and inertia."""
    return pa.Payload(share * load.mass, load.com, share * np.array(load.inertia))


@lru_cache(maxsize=1)
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


def measure(robot: str, load: str, sensors: str, start: str) -> dict[str, Any]:
    """Return the errors of one run [m], and of the torques at its begin and end [N m]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light joints; the table has the result
        model, found = identified(robot)
        true = real(pa.load(robot), LOAD if load == "as in the log" else OTHER)
        from_log: dict[str, Any] = {"unknown": found.unknown}
        starts: dict[str, tuple[pa.Robot, dict[str, Any], Any]] = {
            "truth": (true, {"adaptation": "none"}, None),
            "described": (model, {}, None),
            "identified": (found.robot, from_log, None),
            "informed": (found.robot, from_log, found.parameters()),
        }
        believed, options, known = starts[start]
        controller = pa.make_controller(believed, sensors=SENSORS[sensors], dt=DT, **options)
        path = pa.reachable_circle(true)
        run = pa.simulate(true, controller, path, duration=DURATION, start=known)
        return {
            "first": float(run.distance[run.t <= 1.0].max()),
            "last": float(run.distance[run.t > 0.9 * DURATION].max()),
            "torque": [torque_error(controller, true, a) for a in (run.a_d[0], run.a_d[-1])],
        }


STARTS = ("described", "identified", "informed")


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown, by robot, sensors and load."""
    found: dict[tuple[str, str], dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        key = f"{row['robot']}, {row['sensors']}", row["load"]
        found.setdefault(key, {})[row["start"]] = row
    cells = []
    for key, runs in found.items():
        best, others = runs["truth"], [runs[start] for start in STARTS]
        first = [f"{1e3 * run['first']:.2g}" for run in (best, *others)]
        price = [f"{run['last'] / best['last']:.2g}" for run in others]
        torque = [f"{run['torque[0]']:.2g} → {run['torque[1]']:.2g}" for run in others]
        cells.append([*key, *first, *price, *torque])
    head = ["robot, sensors", "load", "largest error of the first second [mm]: true model"]
    groups = ("", "price, last second: ", "torque error [N m]: ")
    head += [f"{group * (start == STARTS[0])}{start}" for group in groups for start in STARTS]
    return markdown(head, cells)
