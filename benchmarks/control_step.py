"""The time of a control step relative to the Pinocchio calls that its law needs.

``python -m benchmarks.control_step`` times a Panda with every inertial parameter adapted: law (11)
with the kinematics, and the default law, separation, with the joints' coefficients known and
adapted, all under natural adaptation; and robots that stand, with the trunk adapted, whose step
also solves a quadratic program for the contact forces. The last row is the default, with its
memory of all torques, beside natural adaptation of the same parameters. The floor is the sequence
of raw calls, listed by name, with the arguments prepared: forward kinematics and Jacobian at the
estimate, the estimated inertias written into a model, RNEA, CRBA and the regressor; for separation
the Jacobian's variation, the two regressors of which that of Slotine and Li is made, and CRBA, as
K_D is bounded by the mass matrix. Step and floor run alternately in one process, so that both have
the same state of caches and clock; the ratio is the median over pairs. The step is one of an arm
that has moved.

The memory is timed along a motion, as it solves for an estimate at some of the samples only: two
loops run alternately, a sample each. The mean is that of the medians of the two kinds of steps,
each counted as often as it occurs.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa

from .shared import HERE, in_turn
from .standing import UNKNOWN, standing

LAW, DEFAULT = "adaptive-inverse-dynamics", "separation"
CASES: dict[str, tuple[str, bool]] = {  # law, whether friction and rotors are unknown
    "panda": (LAW, False),
    "panda_separation": (DEFAULT, False),
    "panda_separation_joints": (DEFAULT, True),
}
STANDING = "a1", "talos"
ROUNDS, DT = 3000, 1e-3


def floor_calls(
    robot: pa.Robot, q: np.ndarray, v: np.ndarray, law: str
) -> dict[str, Callable[[], object]]:
    """Return the calls by name, in order."""
    model, data = robot.model.copy(), robot.model.createData()
    zero, frame, axes = np.zeros(model.nv), robot.frame_id, pin.LOCAL_WORLD_ALIGNED
    inertias = model.inertias
    tens = [inertia.toDynamicParameters() for inertia in inertias[1:]]

    def write_inertias() -> None:
        for joint, ten in enumerate(tens, 1):
            inertias[joint] = pin.Inertia.FromDynamicParameters(ten)

    def regressor() -> np.ndarray:
        return pin.computeJointTorqueRegressor(model, data, q, v, v)

    def acceleration() -> object:
        return pin.getFrameClassicalAcceleration(model, data, frame, axes)

    calls: dict[str, Callable[[], object]] = {
        "forwardKinematics(q, v, 0)": lambda: pin.forwardKinematics(model, data, q, v, zero),
        "computeJointJacobians": lambda: pin.computeJointJacobians(model, data),
        "getFrameJacobian": lambda: pin.getFrameJacobian(model, data, frame, axes),
        "getFrameClassicalAcceleration": acceleration,
        f"model.inertias[i] = Inertia.FromDynamicParameters x {model.nv}": write_inertias,
        "crba": lambda: pin.crba(model, data, q),
        "computeJointTorqueRegressor": regressor,
    }
    if law == LAW:
        return calls | {"rnea": lambda: pin.rnea(model, data, q, v, v)}

    def variation() -> object:
        return pin.computeJointJacobiansTimeVariation(model, data, q, v)

    return calls | {
        "computeJointJacobiansTimeVariation": variation,
        "getFrameJacobianTimeVariation": lambda: pin.getFrameJacobianTimeVariation(
            model, data, frame, axes
        ),
        "computeJointTorqueRegressor again": regressor,
    }


def step_of(
    control: pa.Controller, robot: pa.Robot, v: np.ndarray, path: pa.trajectories.Trajectory
) -> Callable[[], None]:
    """Return a function that makes a step of a robot that has moved at v (n)."""
    plant = pa.plants.PinocchioPlant(robot)
    measurement = plant.measurement(robot.q0, v)
    desired = path.starting_at(robot.position(robot.q0)).at(0.1)
    first = control.step(control.init(measurement), measurement, desired, DT)[1]
    state = first._replace(sensed=first.sensed._replace(first=None))
    later = plant.measurement(plant.integrate(robot.q0, DT * v), v, DT)

    def step() -> None:
        control.step(state, later, desired, DT)

    return step


def sizes(name: str, control: pa.Controller) -> dict[str, Any]:
    """Return how many parameters a controller adapts."""
    kinematic, dynamic = control.kinematics.size, control.dynamics.size
    return {"name": name, "law": control.law.name, "parameters": kinematic + dynamic}


def measure(name: str) -> dict[str, Any]:
    """Return the figures of one case."""
    law, joints = CASES[name]
    robot = pa.load("panda")
    unknown = pa.Unknown(tool=True, friction=joints, armature=joints)
    control = pa.make_controller(robot, law=law, adaptation="natural", unknown=unknown)
    v = 0.3 * np.random.default_rng(0).standard_normal(robot.model.nv)
    calls = floor_calls(robot, robot.q0, v, law)

    def floor() -> None:
        for call in calls.values():
            call()

    circle = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0)
    times = in_turn({"step": step_of(control, robot, v, circle), "floor": floor}, ROUNDS)
    return sizes(name, control) | {
        "step_us": 1e6 * float(np.median(times["step"])),
        "floor_us": 1e6 * float(np.median(times["floor"])),
        "ratio": float(np.median(times["step"] / times["floor"])),
        "floor_calls": list(calls),
    }


def measure_standing(name: str) -> dict[str, Any]:
    """Return the time of a step of a robot that stands."""
    robot = standing(name)
    control = pa.make_controller(robot, unknown=UNKNOWN, adaptation="natural")
    circle = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0)
    path = pa.trajectories.PoseTrajectory(circle, None).from_rest()
    step = step_of(control, robot, np.zeros(robot.model.nv), path)
    times = in_turn({"step": step}, ROUNDS // 10)
    step_us = 1e6 * float(np.median(times["step"]))
    return sizes(f"{name}_standing", control) | {"step_us": step_us}


def measure_memory() -> dict[str, Any]:
    """Return the figures of the default beside natural adaptation, both along a circle."""
    robot = pa.load("panda")
    true = robot.changed(viscous=1.0, coulomb=0.5)
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0).starting_at(robot.position(robot.q0))
    controllers = [pa.make_controller(robot, adaptation=name, dt=DT) for name in ("natural", None)]
    loops = [pa.run(pa.plants.PinocchioPlant(true), each, path, dt=DT) for each in controllers]
    seen: list[Any] = []  # memories of ``CompositeMemory``

    def natural() -> float:
        return next(loops[0]).step_time

    def memory() -> float:
        sample = next(loops[1])
        seen.append(sample.state.dynamic.memory)
        return sample.step_time

    times = in_turn({"natural": natural, "memory": memory}, ROUNDS)
    after = [*seen[1:], next(loops[1]).state.dynamic.memory]
    # a step that solves for H da makes another A
    pairs = zip(seen, after, strict=True)
    solves = np.array([before[0] is not then[0] for before, then in pairs])[-ROUNDS:]
    usual, share = float(np.median(times["natural"])), float(np.mean(solves))
    between, solving = (float(np.median(times["memory"][kind])) for kind in (~solves, solves))
    mean = share * solving + (1.0 - share) * between
    return sizes("panda_memory", controllers[1]) | {
        "natural_us": 1e6 * usual,
        "step_us": 1e6 * between,
        "solving_us": 1e6 * solving,
        "solving_share": share,
        "mean_us": 1e6 * mean,
        "mean_ratio": mean / usual,
    }


def main() -> None:
    """Print the figures, and save them with the environment of the measurement."""
    rows = [*map(measure, CASES), *map(measure_standing, STANDING), measure_memory()]
    for row in rows:
        figures = [f"{key} {value:.3g}" for key, value in row.items() if isinstance(value, float)]
        print(f"{row['name']}: {row['parameters']} parameters, {', '.join(figures)}")
    for law, calls in {row["law"]: row["floor_calls"] for row in rows[: len(CASES)]}.items():
        print(f"floor of {law}: " + ", ".join(calls))
    environment = {
        "python": platform.python_version(),
        "pin": pin.__version__,
        "numpy": np.__version__,
        "machine": platform.machine(),
    }
    text = json.dumps({"environment": environment, "rows": rows}, indent=2)
    (HERE / "control_step.json").write_text(f"{text}\n")


if __name__ == "__main__":
    main()
