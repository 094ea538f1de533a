"""One control step against the raw Pinocchio calls that its law cannot do without.

``python -m benchmarks.control_step [--save FILE]`` times law (11), kinematics and every inertial
parameter adapted, on three robots. The floor is the sequence of raw calls, listed by name, with the
arguments ready: forward kinematics and Jacobian at the estimate, the estimated inertias written
into a model, RNEA, CRBA and the regressor. Step and floor run in turn in one process, so that both
see the caches and the clock of the same instant; the ratio is the median over pairs. ``bare floor``
leaves the writing of the estimates out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa

from .timing import HERE, in_turn, save, saved

PLANAR = HERE.parent / "robots" / "planar_2r"
LAW = "adaptive-inverse-dynamics"
ROUNDS = 3000
Call = Callable[[], object]


def controller(name: str) -> tuple[pa.Robot, pa.Controller]:
    """Return a robot and its controller: tool and bodies unknown, the planar arm in a basis."""
    robot = pa.load(name)
    if name != "planar_2r":
        return robot, pa.make_controller(robot, law=LAW, kinematic=["tool"], dynamic="all")
    basis = np.loadtxt(PLANAR / "basis.csv", delimiter=",")
    return robot, pa.make_controller(
        robot,
        law=LAW,
        kinematic=["lengths"],
        basis=basis,
        lmi=pa.MatrixInequality.from_file(PLANAR / "lmi.csv"),
    )


def floor_calls(robot: pa.Robot, q: np.ndarray, v: np.ndarray) -> dict[str, tuple[Call, bool]]:
    """Return the raw calls by name, as a step makes them, and whether the bare floor has them."""
    model, data = robot.model.copy(), robot.model.createData()
    zero, frame, n = np.zeros(model.nv), robot.frame_id, model.nv
    inertias, tens = (
        model.inertias,
        [inertia.toDynamicParameters() for inertia in model.inertias[1:]],
    )
    bodies = [pin.Inertia.FromDynamicParameters(ten) for ten in tens]
    aligned = pin.LOCAL_WORLD_ALIGNED

    def make_inertias() -> None:
        for ten in tens:
            pin.Inertia.FromDynamicParameters(ten)

    def write_inertias() -> None:
        for joint, body in enumerate(bodies, 1):
            inertias[joint] = body

    return {
        "forwardKinematics(q, v, 0)": (
            lambda: pin.forwardKinematics(model, data, q, v, zero),
            True,
        ),
        "computeJointJacobians": (lambda: pin.computeJointJacobians(model, data), True),
        "getFrameJacobian": (lambda: pin.getFrameJacobian(model, data, frame, aligned), True),
        "getFrameClassicalAcceleration": (
            lambda: pin.getFrameClassicalAcceleration(model, data, frame, aligned),
            True,
        ),
        f"Inertia.FromDynamicParameters x {n}": (make_inertias, False),
        f"model.inertias[i] = x {n}": (write_inertias, False),
        "rnea": (lambda: pin.rnea(model, data, q, v, v), True),
        "crba": (lambda: pin.crba(model, data, q), True),
        "computeJointTorqueRegressor": (
            lambda: pin.computeJointTorqueRegressor(model, data, q, v, v),
            True,
        ),
    }


def run(calls: list[Call]) -> Callable[[], None]:
    """Return one function that makes all the calls."""

    def sequence() -> None:
        for call in calls:
            call()

    return sequence


def measure(name: str) -> dict[str, Any]:
    """Return the figures of one robot."""
    robot, control = controller(name)
    plant, rng = pa.PinocchioPlant(robot), np.random.default_rng(0)
    v = 0.3 * rng.standard_normal(plant.nv)
    measurement = plant.measurement(robot.q0, v)
    desired = pa.Circle(np.zeros(robot.task.size), 0.1, 3.0).starting_at(measurement.x).at(0.1)
    state = control.step(control.init(measurement), measurement, desired, 1e-3)[1]
    calls = floor_calls(robot, robot.q0, v)
    times = in_turn(
        {
            "step": run([lambda: control.step(state, measurement, desired, 1e-3)]),
            "floor": run([call for call, _ in calls.values()]),
            "bare": run([call for call, bare in calls.values() if bare]),
        },
        ROUNDS,
    )
    return {
        "name": name,
        "law": control.law.name,
        "kinematic": control.kinematics.size,
        "dynamic": control.dynamics.size,
        "step_us": 1e6 * float(np.median(times["step"])),
        "floor_us": 1e6 * float(np.median(times["floor"])),
        "bare_floor_us": 1e6 * float(np.median(times["bare"])),
        "ratio": float(np.median(times["step"] / times["floor"])),
        "bare_ratio": float(np.median(times["step"] / times["bare"])),
        "floor_calls": list(calls),
    }


def main() -> None:
    """Print the figures beside the saved ones, and save them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "control_step.json")
    path = parser.parse_args().save
    before = saved(path)
    rows = [measure(name) for name in ("planar_2r", "ur5", "panda")]
    print(
        f"{'robot':10} {'params':>7} {'step us':>8} {'floor us':>9} {'ratio':>6} {'was':>6} "
        f"{'bare us':>8} {'bare ratio':>11}"
    )
    for row in rows:
        was = before.get(row["name"], {}).get("ratio", float("nan"))
        print(
            f"{row['name']:10} {row['kinematic'] + row['dynamic']:7d} {row['step_us']:8.1f} "
            f"{row['floor_us']:9.1f} {row['ratio']:6.2f} {was:6.2f} "
            f"{row['bare_floor_us']:8.1f} {row['bare_ratio']:11.2f}"
        )
    print("floor: " + ", ".join(rows[-1]["floor_calls"]))
    save(path, rows)


if __name__ == "__main__":
    main()
