"""The loop on a clock: a Panda at 1 kHz against a plant in another process, and its histogram.

``python -m benchmarks.realtime [--seconds 60] [--load] [--ordinary] [--save FILE]`` runs the
default law with its 94 unknowns on an arm that sends a measurement each millisecond, whether the
loop is late or not. The plant stays on the first core of this process, the loop on the last.
``--load``: another process keeps the plant's core busy. ``--ordinary``: without real-time
priority, as any program. The log is written meanwhile. ``step`` is the time from a measurement to
its torque, ``period`` that between measurements as the loop sees them. Before it, the same arm is
only read for a sixth of the time: those periods are what the machine itself makes late. After it,
the steps of the log are computed one after the other, without a pause in which a core forgets them.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import pinadapt as pa
from pinadapt._output import Table
from pinadapt.realtime import (
    Arm,
    CycleLog,
    Ending,
    ProcessArm,
    RealtimeLoop,
    Recorder,
    Safety,
    Scheduling,
)
from pinadapt.realtime.realtime_loop import Histogram

from .timing import save


def spin(core: int) -> None:
    """Keep a core busy."""
    os.sched_setaffinity(0, {core})
    while True:
        np.linalg.svd(np.random.default_rng(0).standard_normal((200, 200)))


def only_read(arm: Arm, seconds: float) -> Histogram:
    """Return the periods of an arm that is only read."""
    found = Histogram()
    arm.read()
    end = before = time.perf_counter()
    while before < end + seconds:
        arm.read()
        now = time.perf_counter()
        found.add(now - before)
        before = now
    return found


def one_after_another(log: CycleLog, controller: pa.Controller) -> Histogram:
    """Return the times of the steps of a log without pauses between them."""
    found, state = Histogram(), None
    for k in np.flatnonzero(log.cycles.stepped[:5000, 0]):
        row = log.row(int(k))
        measurement, desired = row.measurement(), row.desired()
        state = controller.init(measurement).adapt() if state is None else state
        began = time.perf_counter()
        _, state = controller.step(state, measurement, desired, 1e-3)
        found.add(time.perf_counter() - began)
    return found


def run(seconds: float, *, load: bool, ordinary: bool) -> tuple[Ending, int, dict[str, Histogram]]:
    """Return the ending of a run, the number of unknowns, and what it is compared with."""
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
        with plant() as arm, scheduling.applied():
            beside = {"period, only read": only_read(arm, seconds / 6.0)}
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
        steps = one_after_another(CycleLog.read(log), controller)
        beside["controller, without pauses"] = steps
    if load:
        busy.kill()
    return ending, unknowns, beside


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--load", action="store_true")
    parser.add_argument("--ordinary", action="store_true")
    parser.add_argument("--save", type=Path)
    options = parser.parse_args(arguments)
    ending, unknowns, beside = run(options.seconds, load=options.load, ordinary=options.ordinary)
    print(f"panda, {unknowns} unknowns, {os.cpu_count()} cores\n\n{ending}")
    header = ("beside it [us]", "median", "99 %", "99.9 %", "worst")
    print("", Table([(name, *each.row()) for name, each in beside.items()], header), sep="\n")
    over = ending.step.above(3e-4)
    print(f"\nsteps over 300 us: {over} of {ending.step.count}; late by over 2 ms: ", end="")
    print(ending.period.above(3e-3))
    if options.save:
        names = ("median", "99 %", "99.9 %", "worst")
        parts = {"step_us": ending.step, "period_us": ending.period, **beside}
        rows = [
            {"name": name, **dict(zip(names, map(float, part.row()), strict=True))}
            for name, part in parts.items()
        ]
        save(options.save, rows)


if __name__ == "__main__":
    main()
