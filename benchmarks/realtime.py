"""The loop on a clock: a Panda at 1 kHz against a plant in another process, and its histogram.

``python -m benchmarks.realtime [--seconds 60] [--load] [--ordinary] [--save FILE]`` runs the
default law with its 94 unknowns on an arm that sends a measurement each millisecond, whether the
loop is late or not. The plant stays on the first core of this process, the loop on the last.
``--load``: another process keeps the plant's core busy. ``--ordinary``: without real-time
priority, as any program. The log is written meanwhile. ``step`` is the time from a measurement to
its torque, ``period`` that between measurements as the loop sees them. Before it, the same arm is
only read for a tenth of the time: those periods are what the machine itself makes late; and the
same loop runs without rehearsals for a sixth of the time. After it, the steps of the log are
computed one after the other, without a pause in which a core forgets them. ``--save`` writes the
figures into a file, with those that it has of the other case.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa
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

from .timing import markdown, save, saved

COLUMNS = ("median", "99 %", "99.9 %", "worst")
LONG, LATE = 3e-4, 3e-3  # [s] a step, and a period that is 2 ms late
BUSY, READ, ALONE, PLAIN = "loaded", "only read", "controller", "step, not rehearsed"
WORDS = {
    "step": "step",
    PLAIN: "step, without rehearsals",
    "period": "period",
    READ: "period of an arm that is only read",
    ALONE: "controller, steps without pauses",
    f"step, {BUSY}": "step, load on the other core",
    f"period, {BUSY}": "period, load on the other core",
}


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

    def driven(log: Path, seconds: float, scheduling: Scheduling) -> Ending:
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
            return loop.run(seconds)

    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        with plant() as arm, scheduling.applied():
            beside = {READ: only_read(arm, seconds / 10.0)}
        plain = driven(log, seconds / 6.0, replace(scheduling, rehearse=False))
        beside[PLAIN] = plain.step
        ending = driven(log, seconds, scheduling)
        ending.notes.append(f"log of {log.stat().st_size / 1e6:.0f} MB")
        steps = one_after_another(CycleLog.read(log), controller)
        beside[ALONE] = steps
    if load:
        busy.kill()
    return ending, unknowns, beside


def row(name: str, times: Histogram) -> dict[str, Any]:
    """Return times as a row, with how many of them are longer than they should be."""
    longest = LONG if name.startswith(("step", ALONE)) else LATE
    shares = map(int, times.row())
    return {
        "name": name,
        **dict(zip(COLUMNS, shares, strict=True)),
        "count": times.count,
        "above": times.above(longest),
    }


def report(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown."""
    lines = []
    for each in rows:
        long = each["name"].startswith(("step", ALONE))
        share = f"{100.0 * (1.0 - each['above'] / each['count']):.2f} % below 300"
        late = f"{each['above']} of {each['count']:,} more than 2 ms late"
        words = [WORDS[each["name"]], *(str(each[key]) for key in COLUMNS)]
        lines.append([*words, share if long else "", "" if long else late])
    return markdown(["[µs]", *COLUMNS, "", ""], lines)


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
    parts = {"step": ending.step, "period": ending.period}
    parts = {f"{name}, {BUSY}": part for name, part in parts.items()} if options.load else parts
    rows = [row(name, part) for name, part in {**parts, **({} if options.load else beside)}.items()]
    print("", report(rows), sep="\n")
    if options.save:
        before = {name: each for name, each in saved(options.save).items() if name in WORDS}
        known = {**before, **{each["name"]: each for each in rows}}
        save(options.save, [known[name] for name in WORDS if name in known])


if __name__ == "__main__":
    main()
