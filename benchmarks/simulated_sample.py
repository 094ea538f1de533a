"""One simulated sample of the Panda against the forward dynamics that it cannot do without.

``python -m benchmarks.simulated_sample [--save FILE]`` runs robots/panda/tool_and_load.toml, all of
it recorded, without and with joint friction, and in MuJoCo. A sample is the controller's step and
the rest: desired motion, measuring, integrating, recording. Both are told in bare calls
``pin.aba(model, data, q, v, tau)``, of which a sample's integration makes two; blocks of samples
and of calls run in turn in one process, and the ratios are medians over the rounds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario
from pinadapt.simulation.record import record, rollout_of

from .timing import HERE, in_turn, repeated, save, saved

SCENARIO = HERE.parent / "robots" / "panda" / "tool_and_load.toml"
BLOCK, ROUNDS = 200, 60


def blocks(
    plant: pa.PinocchioPlant | pa.MujocoPlant, controller: pa.Controller, path: pa.Trajectory
) -> tuple[Callable[[], float], list[float]]:
    """Return what runs a loop's next block and returns its time but for the steps; and theirs."""
    stream, steps = pa.run(plant, controller, path), []

    def block() -> float:
        started = perf_counter()
        with np.errstate(all="ignore"):
            kept = record(stream, range(BLOCK))
        if kept.reason:
            raise RuntimeError(f"this loop cannot be timed: {kept.reason}")
        robots = pa.Succession.of(plant.robot)
        rollout_of(kept, plant, controller, robots, title="", wall_time=0.0)
        steps.append(kept.step_time)
        return perf_counter() - started - kept.step_time

    return block, steps


def measure(
    name: str, scenario: Scenario, plant: pa.PinocchioPlant | pa.MujocoPlant
) -> dict[str, Any]:
    """Return the figures of one plant under the scenario's controller and motion."""
    model, data = plant.robot.model, plant.robot.model.createData()
    q, v, tau = plant.robot.q0, np.full(model.nv, 0.1), np.ones(model.nv)
    block, steps = blocks(plant, scenario.controller, scenario.trajectory)
    aba = repeated(lambda: pin.aba(model, data, q, v, tau), BLOCK)
    times = in_turn({"rest": block, "aba": aba}, ROUNDS)
    step = np.array(steps[-ROUNDS:])
    return {
        "name": name,
        "aba_us": 1e6 * float(np.median(times["aba"])) / BLOCK,
        "step_us": 1e6 * float(np.median(step)) / BLOCK,
        "rest_us": 1e6 * float(np.median(times["rest"])) / BLOCK,
        "step_ratio": float(np.median(step / times["aba"])),
        "rest_ratio": float(np.median(times["rest"] / times["aba"])),
        "sample_ratio": float(np.median((step + times["rest"]) / times["aba"])),
    }


def main() -> None:
    """Print the figures beside the saved ones, and save them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "simulated_sample.json")
    path = parser.parse_args().save
    before, scenario = saved(path), Scenario.read(SCENARIO)
    free = scenario.true.changed(viscous=0.0, coulomb=0.0)
    rubbing = scenario.true.changed(viscous=0.5, coulomb=0.5)
    plants = {
        "panda": pa.PinocchioPlant(free),
        "panda with friction": pa.PinocchioPlant(rubbing),
        "panda in MuJoCo": pa.MujocoPlant(free),
        "panda in MuJoCo with friction": pa.MujocoPlant(rubbing),
        "panda in MuJoCo, implicitfast": pa.MujocoPlant(rubbing, integrator="implicitfast"),
    }
    rows = [measure(name, scenario, plant) for name, plant in plants.items()]
    print("in bare aba calls:               step   rest  sample  (was)   aba us")
    for row in rows:
        was = before.get(row["name"], {}).get("sample_ratio", float("nan"))
        print(
            f"{row['name']:30} {row['step_ratio']:6.1f} {row['rest_ratio']:6.1f} "
            f"{row['sample_ratio']:7.1f} {was:6.1f} {row['aba_us']:8.2f}"
        )
    save(path, rows)


if __name__ == "__main__":
    main()
