"""The time of a simulated sample of the Panda relative to its forward dynamics.

``python -m benchmarks.simulated_sample`` runs robots/panda/tool_and_load.toml, with
everything recorded and the rollout made, without and with joint friction, in MuJoCo, and with the
default's memory of torques, which solves for an estimate twice in a block. A sample consists of
the control step and the rest: desired motion, measuring, integrating, recording, and its share of
the rollout. Both are given in calls ``pin.aba(model, data, q, v, tau)``, of which the
integration of a sample makes two; blocks of samples and of calls run alternately in one process,
and the ratios are medians over the rounds.

A run keeps its samples, so its memory grows by a page with each of them. The operating system takes
time to provide a new page: a quarter of a microsecond, up to twenty in a virtual machine. The first
row includes this; the others run in memory that the process already has.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.controller.state import Sample
from pinadapt.plants.plant import SimulatedPlant
from pinadapt.scenario.scenario import Scenario
from pinadapt.simulation.simulate import record, rollout_of

from .shared import HERE, in_turn, save

SCENARIO = HERE.parent / "robots" / "panda" / "tool_and_load.toml"
NATURAL = "controller.adaptation=natural"
BLOCK, ROUNDS = 28, 430


class Loop:
    """A simulated closed loop, run block by block; everything is recorded, as in a run.

    Attributes:
        samples: those recorded.
        steps: time of the control steps of each block [s].
    """

    def __init__(
        self,
        plant: SimulatedPlant,
        controller: pa.Controller,
        path: pa.trajectories.Trajectory,
    ) -> None:
        """Take plant, controller and path."""
        self._plant = plant
        self._controller = controller
        self._stream = pa.run(plant, controller, path)
        self.samples = list[Sample]()
        self.steps = list[float]()

    def block(self) -> float:
        """Run the next block; return its time without the control steps [s]."""
        started = perf_counter()
        with np.errstate(all="ignore"):
            samples, self.ended = record(self._stream, range(BLOCK), self._controller)
        if self.ended["reason"]:
            raise RuntimeError(f"this loop cannot be timed: {self.ended['reason']}")
        self.samples += samples
        self.steps.append(sum(sample.step_time for sample in samples))
        return perf_counter() - started - self.steps[-1]

    def rollout(self) -> float:
        """Make the rollout of all blocks; return its time per block [s]."""
        started = perf_counter()
        robots = pa.robot.Succession.of(self._plant.robot)
        told = {"title": "", "wall_time": 0.0, **self.ended}
        rollout_of(self.samples, self._plant, self._controller, robots, **told)
        return (perf_counter() - started) * BLOCK / len(self.samples)


def measure(name: str, scenario: Scenario, plant: SimulatedPlant) -> dict[str, Any]:
    """Return the figures of one plant under the scenario's controller and motion."""
    model = plant.robot.model
    data = plant.robot.model.createData()
    q = plant.robot.q0
    v = np.full(model.nv, 0.1)
    tau = np.ones(model.nv)
    loop = Loop(plant, scenario.controller, scenario.trajectory)

    def dynamics() -> None:
        for _ in range(BLOCK):
            pin.aba(model, data, q, v, tau)

    times = in_turn({"rest": loop.block, "aba": dynamics}, ROUNDS)
    step = np.array(loop.steps[-ROUNDS:])
    rest = times["rest"] + loop.rollout()
    return {
        "name": name,
        "aba_us": 1e6 * float(np.median(times["aba"])) / BLOCK,
        "step_us": 1e6 * float(np.median(step)) / BLOCK,
        "rest_us": 1e6 * float(np.median(rest)) / BLOCK,
        "step_ratio": float(np.median(step / times["aba"])),
        "rest_ratio": float(np.median(rest / times["aba"])),
        "sample_ratio": float(np.median((step + rest) / times["aba"])),
    }


def main() -> None:
    """Print the figures, and save them."""
    scenario = Scenario.read(SCENARIO, [NATURAL])
    free = scenario.true.changed(viscous=0.0, coulomb=0.0)
    with_friction = scenario.true.changed(viscous=0.5, coulomb=0.5)
    plants: dict[str, SimulatedPlant] = {
        "panda in fresh memory": pa.plants.PinocchioPlant(free),
        "panda": pa.plants.PinocchioPlant(free),
        "panda with friction": pa.plants.PinocchioPlant(with_friction),
        "panda in MuJoCo": pa.plants.MujocoPlant(free),
        "panda in MuJoCo with friction": pa.plants.MujocoPlant(with_friction),
    }
    rows = [measure(name, scenario, plant) for name, plant in plants.items()]
    default = Scenario.read(SCENARIO)
    rows.append(measure("panda with the memory", default, pa.plants.PinocchioPlant(free)))
    save("simulated_sample", rows)


if __name__ == "__main__":
    main()
