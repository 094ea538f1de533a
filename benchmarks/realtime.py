"""The loop on a clock: a Panda at 1 kHz against a plant in another process, and its histogram.

``python -m benchmarks.realtime [--load]`` runs for a minute the default law with its 94 unknowns on
an arm that sends a measurement each millisecond, whether the loop is late or not. The plant stays
on the first core of this process, the loop on the last. ``--load``: another process keeps the
plant's core busy. The log is written meanwhile. ``step`` is the time from a measurement to its
torque, ``period`` that between measurements as the loop sees them. Before it, the same arm is only
read for a tenth of the time: those periods are what the machine itself makes late.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections import Counter
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import pinadapt as pa
from pinadapt.realtime import (
    Arm,
    ProcessArm,
    RealtimeLoop,
    Recorder,
    RunResult,
    Safety,
    Scheduling,
)
from pinadapt.realtime.realtime_loop import quantiles

SECONDS, LATE = 60.0, 3e-3  # [s] a period that is 2 ms late


def spin(core: int) -> None:
    """Keep a core busy."""
    os.sched_setaffinity(0, {core})
    while True:
        np.linalg.svd(np.random.default_rng(0).standard_normal((200, 200)))


def only_read(arm: Arm, seconds: float) -> Counter[int]:
    """Return the periods of an arm that is only read, counted in microseconds."""
    found = Counter[int]()
    arm.read()
    end = before = time.perf_counter()
    while before < end + seconds:
        arm.read()
        now = time.perf_counter()
        found[round(1e6 * (now - before))] += 1
        before = now
    return found


def run(*, load: bool) -> tuple[RunResult, Counter[int]]:
    """Return the end of a run, and the periods of the arm when it is only read."""
    robot = pa.load("panda")
    mass = pa.Payload(1.0, [0.0, 0.0, 0.05])
    true = robot.changed(payload=mass, tool_translation=[0.02, -0.01, 0.05])
    controller = pa.make_controller(robot, unknown=pa.Unknown(tool=True))
    cores = sorted(os.sched_getaffinity(0))
    busy = get_context("spawn").Process(target=spin, args=(cores[0],), daemon=True)
    if load:
        busy.start()
    scheduling = Scheduling(core=cores[-1])
    make = partial(pa.plants.PinocchioPlant, true.undrawn())
    motion = pa.trajectories.Circle(robot.position(robot.q0), 0.05, 4.0)
    plant = partial(ProcessArm, make, scheduling=Scheduling(70, cores[0], lock=False))
    with tempfile.TemporaryDirectory() as folder:
        with plant() as arm, scheduling.applied():
            beside = only_read(arm, SECONDS / 10.0)
        with Recorder(Path(folder) / "run.mcap", controller) as recorder, plant() as arm:
            safety = Safety(late=10**6)
            loop = RealtimeLoop(
                arm,
                controller,
                motion,
                stage="adapt",
                safety=safety,
                recorder=recorder,
                scheduling=scheduling,
            )
            ending = loop.run(SECONDS)
    if load:
        busy.kill()
    return ending, beside


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description="The loop on a clock; see the module.")
    parser.add_argument("--load", action="store_true", help="keep the plant's core busy")
    ending, beside = run(load=parser.parse_args().load)
    print(ending)
    for name, times in {"loop": ending.period, "arm that is only read": beside}.items():
        late = sum(number for time, number in times.items() if time > 1e6 * LATE)
        words = f"{late} of {times.total():,} periods more than 2 ms late"
        print(f"{name}: {words}; median, 99 %, 99.9 %, worst [µs]: {' '.join(quantiles(times))}")


if __name__ == "__main__":
    main()
