"""How a control step and a simulated sample grow with the number of joints.

``python -m benchmarks.growth [--save FILE] [--plot FILE]`` makes chains of 2 to 32 revolute joints
with turning axes, every body, the joints' coefficients and the tool unknown (13 n + 3 parameters),
and times alternately, in one process: one step of the default law under natural adaptation, the
rest of a simulated sample, and Pinocchio's regressor, the call that every law on these parameters
needs.
"""

from __future__ import annotations

import argparse
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import pinadapt as pa

from .simulated_sample import BLOCK, Loop
from .timing import HERE, in_turn, repeated, save, saved

JOINTS, ROUNDS = (2, 4, 8, 16, 32), 30
CURVES = {
    "step": "control step",
    "rest": "rest of a simulated sample",
    "aba": "forward dynamics, one call",
    "regressor": "regressor, one call",
}


def chain(n: int) -> pa.Robot:
    """Return a chain of n joints about x, y, z in turn, half a metre long for every n."""
    model, parent, length = pin.Model(), 0, 0.5 / n
    axes = (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
    model.name = f"chain of {n}"
    for i in range(n):
        offset = pin.SE3(np.eye(3), np.array([0.0, 0.0, length if i else 0.0]))
        parent = model.addJoint(parent, axes[(i + 1) % 3](), offset, f"joint{i + 1}")
        body = pin.Inertia.FromCylinder(4.0 / n, 0.05, length)
        centre = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5 * length]))
        model.appendBodyToJoint(parent, body, centre)
    end = pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))
    model.addFrame(pin.Frame("tip", parent, 0, end, pin.FrameType.OP_FRAME))
    model.armature = np.full(n, 0.01)
    task = "xy" if n == 2 else "xyz"
    return pa.load(model, frame="tip", task=task, q0=np.resize([0.4, -0.6, 0.5], n))


def measure(n: int) -> dict[str, Any]:
    """Return the figures of one chain [us]."""
    robot = chain(n)
    model, data, v = robot.model, robot.model.createData(), np.full(n, 0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the sampling period; a short run is enough here
        controller = pa.make_controller(robot.changed(inertial_scale=0.9), adaptation="natural")
    hold = pa.trajectories.Hold(robot.position(robot.q0))
    loop = Loop(pa.plants.PinocchioPlant(robot), controller, hold)
    calls = {
        "aba": lambda: pin.aba(model, data, robot.q0, v, v),
        "regressor": lambda: pin.computeJointTorqueRegressor(model, data, robot.q0, v, v),
    }
    times = in_turn(
        {"rest": loop.block} | {name: repeated(call, BLOCK) for name, call in calls.items()}, ROUNDS
    )
    times["step"] = np.array(loop.steps[-ROUNDS:])
    times["rest"] = times["rest"] + loop.rollout()
    figures = {f"{name}_us": 1e6 * float(np.median(times[name])) / BLOCK for name in CURVES}
    unknowns = controller.dynamics.size + controller.kinematics.size
    return {"name": model.name, "joints": n, "unknowns": unknowns, **figures}


def exponents(rows: list[dict[str, Any]], curve: str) -> list[float]:
    """Return the exponent p of n^p between each chain and the next."""
    return [
        float(np.log(b[f"{curve}_us"] / a[f"{curve}_us"]) / np.log(b["joints"] / a["joints"]))
        for a, b in pairwise(rows)
    ]


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the times over the number of joints, on logarithmic axes."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    n = [row["joints"] for row in rows]
    for curve, label in CURVES.items():
        ax.loglog(n, [row[f"{curve}_us"] for row in rows], marker="o", ms=4, label=label)
    ax.set_xticks(n, [str(k) for k in n])
    ax.minorticks_off()
    ax.set_xlabel("joints n, with 13 n + 3 unknown parameters")
    ax.set_ylabel("time [us]")
    ax.grid(alpha=0.3)
    ax.legend()
    figure.savefig(path, dpi=130)
    print(f"drawn to {path}")


def main() -> None:
    """Print the figures with the previous ones, save and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "growth.json")
    parser.add_argument("--plot", type=Path, default=HERE.parent / "docs" / "growth.png")
    options = parser.parse_args()
    before, rows = saved(options.save), [measure(n) for n in JOINTS]
    print("joints unknowns  step us   (was)  rest us  aba us  regressor us")
    for row in rows:
        was = before.get(row["name"], {}).get("step_us", float("nan"))
        print(
            f"{row['joints']:6d} {row['unknowns']:8d} {row['step_us']:8.1f} {was:7.1f} "
            f"{row['rest_us']:8.1f} {row['aba_us']:7.2f} {row['regressor_us']:13.2f}"
        )
    for curve, label in CURVES.items():
        print(f"{label}: n^{exponents(rows, curve)[-1]:.2f} from {JOINTS[-2]} to {JOINTS[-1]}")
    save(options.save, rows)
    draw(rows, options.plot)


if __name__ == "__main__":
    main()
