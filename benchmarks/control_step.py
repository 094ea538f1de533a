"""The time of a control step relative to the Pinocchio calls that its law needs.

``python -m benchmarks.control_step`` times law (11), kinematics and every inertial parameter
adapted, on three robots, and the default law, separation, on the Panda with the joints'
coefficients known and adapted, all under natural adaptation; and robots that stand, with the trunk
adapted, whose step also solves a quadratic program for the contact forces. The last row is the
default, with its memory of all torques, beside natural adaptation of the same parameters. The floor
is the sequence of raw calls, listed by name, with the arguments prepared: forward kinematics and
Jacobian at the estimate, the estimated inertias written into a model, RNEA, CRBA and the regressor;
for separation the Jacobian's variation, the two regressors of which that of Slotine and Li is made,
and CRBA, as K_D is bounded by the mass matrix. Step and floor run alternately in one process, so
that both have the same state of caches and clock; the ratio is the median over pairs. The step is
one of an arm that has moved.

The memory is timed along a motion, as it solves for an estimate at some of the samples only: two
loops run alternately, a sample each. The mean is that of the medians of the two kinds of steps,
each counted as often as it occurs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa

from .shared import HERE, in_turn, save
from .standing import ROBOTS, UNKNOWN, standing

PLANAR = HERE.parent / "robots" / "planar_2r"
LAW, DEFAULT = "adaptive-inverse-dynamics", "separation"
CASES: dict[str, tuple[str, str, bool]] = {  # robot, law, whether friction and rotors are unknown
    "planar_2r": ("planar_2r", LAW, False),
    "ur5": ("ur5", LAW, False),
    "panda": ("panda", LAW, False),
    "panda_separation": ("panda", DEFAULT, False),
    "panda_separation_joints": ("panda", DEFAULT, True),
    "a1_standing": ("a1", DEFAULT, False),
    "talos_standing": ("talos", DEFAULT, False),
}
ROUNDS, DT = 3000, 1e-3


def controller(name: str, law: str, joints: bool) -> tuple[pa.Robot, pa.Controller]:
    """Return a robot and its controller: tool and bodies unknown, the planar arm in a basis."""
    if name in ROBOTS:
        robot = standing(name)
        return robot, pa.make_controller(robot, law=law, unknown=UNKNOWN)
    robot = pa.load(name)
    unknown = pa.Unknown(tool=True, friction=joints, armature=joints)
    if name == "planar_2r":
        basis = np.loadtxt(PLANAR / "basis.csv", delimiter=",")
        lmi = pa.adaptation.MatrixInequality.from_file(PLANAR / "lmi.csv")
        unknown = pa.Unknown(lengths=True, basis=basis, lmi=lmi)
    return robot, pa.make_controller(robot, law=law, adaptation="natural", unknown=unknown)


def floor_calls(
    robot: pa.Robot, q: np.ndarray, v: np.ndarray, law: str
) -> dict[str, Callable[[], object]]:
    """Return the calls by name, in order."""
    model = robot.model.copy()
    data = robot.model.createData()
    zero = np.zeros(model.nv)
    frame = robot.frame_id
    axes = pin.LOCAL_WORLD_ALIGNED
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
    for name in (contact.frame for contact in robot.contacts):
        foot = model, data, model.getFrameId(name), axes
        calls[f"getFrameJacobian, {name}"] = partial(pin.getFrameJacobian, *foot)
        variation = partial(pin.getFrameJacobianTimeVariation, *foot)
        calls[f"getFrameJacobianTimeVariation, {name}"] = variation
    variation = partial(pin.getFrameJacobianTimeVariation, model, data, frame, axes)
    return calls | {
        "computeJointJacobiansTimeVariation": lambda: pin.computeJointJacobiansTimeVariation(
            model, data, q, v
        ),
        "getFrameJacobianTimeVariation": variation,
        "computeJointTorqueRegressor again": regressor,
    }


def sizes(name: str, control: pa.Controller) -> dict[str, Any]:
    """Return how many parameters a controller adapts."""
    kinematic = control.kinematics.size
    dynamic = control.dynamics.size
    return {"name": name, "law": control.law.name, "parameters": kinematic + dynamic}


def measure(name: str) -> dict[str, Any]:
    """Return the figures of one case."""
    robot, control = controller(*CASES[name])
    plant = pa.plants.PinocchioPlant(robot)
    rng = np.random.default_rng(0)
    v = 0.3 * rng.standard_normal(plant.nv) * (not robot.contacts)
    circle = pa.trajectories.Circle(np.zeros(3 if robot.contacts else robot.task.size), 0.1, 3.0)
    path: pa.trajectories.Trajectory = circle
    if robot.contacts:
        path = pa.trajectories.PoseTrajectory(circle, None).from_rest()
    desired = path.starting_at(robot.position(robot.q0)).at(0.1)
    measurement = plant.measurement(robot.q0, v)
    first = control.step(control.init(measurement), measurement, desired, DT)[1]
    state = first._replace(sensed=first.sensed._replace(first=None))
    later = plant.measurement(plant.integrate(robot.q0, DT * v), v, DT)
    calls = floor_calls(robot, robot.q0, v, control.law.name)

    def step() -> None:
        control.step(state, later, desired, DT)

    def floor() -> None:
        for call in calls.values():
            call()

    rounds = ROUNDS // 10 if robot.contacts else ROUNDS
    times = in_turn({"step": step, "floor": floor}, rounds)
    return sizes(name, control) | {
        "step_us": 1e6 * float(np.median(times["step"])),
        "floor_us": 1e6 * float(np.median(times["floor"])),
        "ratio": float(np.median(times["step"] / times["floor"])),
        "floor_calls": list(calls),
    }


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
    usual = float(np.median(times["natural"]))
    share = float(np.mean(solves))
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
    """Print the figures, and save them."""
    rows = [measure(name) for name in CASES]
    for law, calls in {row["law"]: row["floor_calls"] for row in rows}.items():
        print(f"floor of {law}: " + ", ".join(calls))
    save("control_step", [*rows, measure_memory()])


if __name__ == "__main__":
    main()
