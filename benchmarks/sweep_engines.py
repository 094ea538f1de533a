"""Throughput of sweeps, the cost of a case's journey, and memory over 100,000 cases.

``python -m benchmarks.sweep_engines [--save FILE] [--cases N] [--short N]`` runs N cases of two
seconds of a Panda in this process and in 1, 2, ... processes, up to one a core, and then N short
cases, a function that returns two numbers, in one process and into a folder. Rates are by the
clock, so nothing else should run. The efficiency for more processes follows from the measured work
of the parent for each case, which is all that the processes share.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from pinadapt.sweep import Here, Plan, Processes
from pinadapt.sweep.execution import cores, run_plan, work_of

from .timing import HERE, save

PREDICTED = (2, 4, 8, 16, 32, 64)


def pandas(count: int) -> Plan:
    """Return cases of two seconds of a Panda with other loads and frictions."""
    path = HERE.parent / "robots" / "panda" / "tool_and_load.toml"
    vary = ["truth.payload.mass=uniform(0.2, 3.0)", "truth.friction.viscous.*=uniform(0.0, 2.0)"]
    return Plan.read(path, vary, ["simulation.duration=2.0"], samples=count)


def short(a: float, seed: int) -> dict[str, float]:
    """Return two numbers at once."""
    return {"twice": 2.0 * a, "random": seed % 97}


def throughput(count: int) -> list[dict[str, Any]]:
    """Return cases a second in this process, and in 1, 2, ... processes, which have started."""
    plan, rows = pandas(count), []
    work = work_of(plan)
    run_plan(pandas(1), work, Here())  # compiles
    alone = timed(plan, work, Here())
    rows.append({"name": "in this process", "cases": count, "cases_per_s": 1.0 / alone})
    for processes in range(1, cores() + 1):
        engine = Processes(processes)
        run_plan(pandas(2 * processes), work, engine)
        each = timed(plan, work, engine)
        engine.shutdown()
        share = alone / (processes * each)
        rows.append(
            {
                "name": f"{processes} processes",
                "cases": count,
                "cases_per_s": 1.0 / each,
                "efficiency": share,
            }
        )
    return rows


def timed(plan: Plan, work: Any, engine: Any) -> float:
    """Return seconds a case."""
    started = time.perf_counter()
    run_plan(plan, work, engine)
    return (time.perf_counter() - started) / len(plan.cases)


def overhead(count: int) -> dict[str, Any]:
    """Return time and the parent's own work for each short case, and its memory on the way."""
    plan = Plan.of({"function": short, "vary": {"a": f"lin(0, 1, {count})"}})
    work, memory, engine = work_of(plan), [], Processes(1)

    class Watch:
        """Notes the largest memory so far after each tenth."""

        told = 0

        def start(self, done: int = 0) -> None:
            """Begin."""

        def tell(self, row: Any) -> None:
            """Count a row."""
            self.told += 1
            if self.told % (count // 10) == 0:
                memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)

        def close(self) -> None:
            """End."""

    run_plan(Plan.of({"function": short, "vary": {"a": [1.0]}}), work, engine)
    with tempfile.TemporaryDirectory() as folder:
        plan.save(Path(folder))
        began, started = time.process_time(), time.perf_counter()
        table = run_plan(plan, work, engine, Path(folder), Watch())  # type: ignore[arg-type]
        by_clock, own = time.perf_counter() - started, time.process_time() - began
    engine.shutdown()
    assert len(table) == count
    return {
        "name": "short cases",
        "cases": count,
        "ms_per_case": 1e3 * by_clock / count,
        "parent_ms_per_case": 1e3 * own / count,
        "memory_MB": memory,
        "memory_joined_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def predicted(case: float, parent: float) -> list[dict[str, Any]]:
    """Return the efficiency of more processes: the parent serves one case after another."""
    rows = []
    for count in PREDICTED:
        rate = min(count / (case + parent), 1.0 / parent)
        rows.append({"name": f"{count} processes, predicted", "efficiency": rate * case / count})
    return rows


def main() -> None:
    """Measure and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "sweep_engines.json")
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--short", type=int, default=100_000)
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = throughput(options.cases)
    rows.append(overhead(options.short))
    rows += predicted(1.0 / rows[0]["cases_per_s"], 1e-3 * rows[-1]["parent_ms_per_case"])
    for row in rows:
        print(row, flush=True)
    save(options.save, rows)


if __name__ == "__main__":
    main()
