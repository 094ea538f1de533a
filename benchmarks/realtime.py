"""The loop on a clock: a Panda at 1 kHz against a plant in another process, and its histogram.

``python -m benchmarks.realtime [--seconds 60] [--load] [--ordinary] [--save FILE]`` runs the
default law with its 94 unknowns on an arm that sends a measurement each millisecond, whether the
loop is late or not. The plant stays on the first core of this process, the loop on the last.
``--load``: another process keeps the plant's core busy. ``--ordinary``: without real-time
priority, as any program. The log is written meanwhile. ``step`` is the time from a measurement to
its torque, ``period`` that between measurements as the loop sees them.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import pinadapt as pa
from pinadapt.realtime import Ending, ProcessArm, RealtimeLoop, Recorder, Safety, Scheduling

from .timing import save


def spin(core: int) -> None:
    """Keep a core busy."""
    os.sched_setaffinity(0, {core})
    while True:
        np.linalg.svd(np.random.default_rng(0).standard_normal((200, 200)))


def run(seconds: float, *, load: bool, ordinary: bool) -> tuple[Ending, int]:
    """Return the ending of a run, and the number of unknowns."""
    robot = pa.load("panda")
    mass = pa.Payload(1.0, [0.0, 0.0, 0.05])
    true = robot.changed(payload=mass, tool_translation=[0.02, -0.01, 0.05])
    controller = pa.make_controller(robot, unknown=pa.Unknown(tool=True))
    unknowns = controller.dynamics.size + controller.kinematics.size
    cores = sorted(os.sched_getaffinity(0))
    busy = get_context("spawn").Process(target=spin, args=(cores[0],), daemon=True)
    if load:
        busy.start()
    scheduling = Scheduling(None, None, False) if ordinary else Scheduling(core=cores[-1])
    make = partial(pa.plants.PinocchioPlant, true.undrawn())
    motion = pa.trajectories.Circle(robot.position(robot.q0), 0.05, 4.0)
    plant = partial(ProcessArm, make, core=cores[0], priority=None if ordinary else 70)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        with Recorder(log, controller) as recorder, plant() as arm:
            loop = RealtimeLoop(
                arm,
                controller,
                motion,
                stage="adapt",
                safety=Safety(late=10**6),
                recorder=recorder,
                scheduling=scheduling,
            )
            ending = loop.run(seconds)
        ending.notes.append(f"log of {log.stat().st_size / 1e6:.0f} MB")
    if load:
        busy.kill()
    return ending, unknowns


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--load", action="store_true")
    parser.add_argument("--ordinary", action="store_true")
    parser.add_argument("--save", type=Path)
    options = parser.parse_args(arguments)
    ending, unknowns = run(options.seconds, load=options.load, ordinary=options.ordinary)
    print(f"panda, {unknowns} unknowns, {os.cpu_count()} cores\n\n{ending}")
    over = ending.step.above(3e-4)
    print(f"\nsteps over 300 us: {over} of {ending.step.count}; late by over 2 ms: ", end="")
    print(ending.period.above(3e-3))
    if options.save:
        names = ("median", "99 %", "99.9 %", "worst")
        parts = {"step_us": ending.step, "period_us": ending.period}
        rows = [
            {"name": name, **dict(zip(names, map(float, part.row()), strict=True))}
            for name, part in parts.items()
        ]
        save(options.save, rows)


if __name__ == "__main__":
    main()
