"""The accuracy of robots identified from logs with exact and with noisy sensors.

``python -m benchmarks.identification`` drives robots whose load, tool, friction and rotors are
unknown through 14 s of a Lissajous figure, identifies them from the log, and prints the table of
``docs/identify.md``; ``--picture FILE`` writes that page's picture.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import pinadapt as pa

LOAD = pa.Payload(1.5, (0.02, -0.01, 0.05), (0.01, 0.0, 0.012, 0.0, 0.0, 0.004))
TOOL = (0.03, -0.02, 0.12)
COUNT = 2.0 * np.pi / 2**17  # rad
TORQUE_NOISE = 0.01  # of the effort limits
CAMERA = 1e-4  # m


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
    rng, limits = np.random.default_rng(0), robot.model.upperEffortLimit
    q = np.round(run.q / COUNT) * COUNT
    tau = run.tau + TORQUE_NOISE * limits * rng.standard_normal(run.tau.shape)
    x = run.x[::33] + CAMERA * rng.standard_normal(run.x[::33].shape)
    return pa.Log(run.t, q, tau, x=x, x_time=run.t[::33], held=True, source="noisy")


def rows(name: str) -> Iterator[tuple[str, pa.Identification]]:
    """Yield the identification of a robot from each kind of log."""
    robot, run = rollout(name)
    noisy = with_noise(run, robot)
    yield (
        f"{name}, exact",
        pa.identify(replace(noisy, q=run.q, v=run.v, tau=run.tau, x=run.x[::33]), robot),
    )
    yield f"{name}, noisy", pa.identify(noisy, robot)
    for adaptation in ("natural-composite", "least-squares"):
        online = pa.identify(noisy, robot, adaptation=adaptation)
        yield f"{name}, noisy, online by {adaptation}", online
    yield f"{name}, exact, simulated by MuJoCo", pa.identify(rollout(name, "mujoco")[1], robot)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--robots", default="panda,ur5")
    options = parser.parse_args()
    print("log | described | identified | online | mass [kg] | errors of centre and tool [mm]")
    for name in options.robots.split(","):
        tool = pa.load(name).changed(tool_translation=TOOL)
        for words, found in rows(name):
            errors, load = found.torque_errors, found.payload()
            sizes = errors.described_held_out, errors.learned_held_out, found.online_held_out
            torques = " | ".join(f"{np.sqrt(np.mean(part**2)):.3g}" for part in sizes)
            error = 1e3 * np.linalg.norm(load.com - LOAD.com)
            known = 1e3 * np.linalg.norm(load.com_known_to)
            missed = found.robot.position(tool.q0) - tool.position(tool.q0)
            print(
                f"{words} | {torques} | {load.mass:.4f} +- {load.mass_known_to:.1g} | "
                f"{error:.2g}, uncertainty {known:.2g} | {1e3 * np.linalg.norm(missed):.2g}",
                flush=True,
            )
            if options.picture and words == "panda, noisy":
                options.picture.write_bytes(found.plot().torque.png(dpi=90))


if __name__ == "__main__":
    main()
