"""Throughput of sweeps, the cost of a case's journey, and memory over 100,000 cases.

``python -m benchmarks.sweep_engines [--save FILE] [--cases N] [--rounds M] [--short N]`` runs
batches of N cases of two seconds of a Panda in this process and in 1, 2, ... processes, up to one a
core, in turn, and then short cases, a function that returns two numbers, in one process and into a
folder. The rate is that of the fastest of M batches, because other work on the machine can only
slow one down. The share of processor time does not depend on other work: it is the processor time
of a case in this process, over that in a worker plus the whole journey of a short case, in which
the worker may wait. Predicted are more processes from the parent's own work for each case, which is
all that they share.
"""

from __future__ import annotations

import argparse
import gc
import os
import resource
import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinadapt.scenario import Scenario
from pinadapt.sweep import Here, Plan, Processes
from pinadapt.sweep.execution import GARBAGE, cores, run_plan, work_of

from .timing import HERE, save

PREDICTED = (2, 4, 8, 16, 32, 64)


def panda(mass: float, viscous: float, seed: int) -> dict[str, float]:
    """Return the error of two seconds of a Panda, and the processor time that they took [s]."""
    started = time.process_time()
    path = HERE.parent / "robots" / "panda" / "tool_and_load.toml"
    settings = [f"truth.payload.mass={mass}", f"truth.friction.viscous={viscous}"]
    scenario = Scenario.read(path, [*settings, f"simulation.seed={seed}", "simulation.duration=2"])
    error = scenario.run(progress=False).summary()["max_error_last"]
    return {"error": error, "processor_s": time.process_time() - started}


def pandas(count: int) -> Plan:
    """Return cases of two seconds of a Panda with other loads and frictions."""
    vary = {"mass": "uniform(0.2, 3.0)", "viscous": "uniform(0.0, 2.0)"}
    return Plan.of({"function": panda, "vary": vary, "samples": count})


def short(a: float, seed: int) -> dict[str, float]:
    """Return two numbers at once."""
    return {"twice": 2.0 * a, "random": seed % 97}


def throughput(count: int, rounds: int) -> list[dict[str, Any]]:
    """Return the rates in this process, and in 1, 2, ... processes, which have started."""
    engines: dict[str, tuple[int, Here | Processes]] = {"in this process": (0, Here())}
    for n in range(1, cores() + 1):
        engines[f"{n} process{'es' * (n > 1)}"] = n, Processes(n)
    plan = pandas(count)
    work = work_of(plan)
    rows: dict[str, dict[str, Any]] = {}
    for name, (n, engine) in engines.items():
        run_plan(pandas(2 * n + 1), work, engine)  # compiles
        rows[name] = {"name": name, "cases": count, "cases_per_s": 0.0, "processor_s": []}
    print("the engines have started", flush=True)
    for _ in range(rounds):
        for name, (_, engine) in engines.items():
            started = time.perf_counter()
            table = run_plan(plan, work, engine)
            rate = count / (time.perf_counter() - started)
            rows[name]["cases_per_s"] = max(rate, rows[name]["cases_per_s"])
            rows[name]["processor_s"] += table["processor_s"].tolist()
    for name, (n, engine) in engines.items():
        engine.shutdown()
        rows[name]["processor_s"] = float(np.median(rows[name]["processor_s"]))
        if n:
            alone = n * rows["in this process"]["cases_per_s"]
            rows[name]["rate_efficiency"] = rows[name]["cases_per_s"] / alone
    return list(rows.values())


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


def with_efficiency(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows with their efficiency, and those of more processes, predicted."""
    *long, journey = rows
    alone, trip = long[0]["processor_s"], 1e-3 * journey["ms_per_case"]
    for row in long[1:]:
        row["efficiency"] = alone / (row["processor_s"] + trip)
    worker, parent = long[-1]["processor_s"], 1e-3 * journey["parent_ms_per_case"]
    more = [
        {
            "name": f"{count} processes, predicted",
            "efficiency": min(count / (worker + trip), 1.0 / parent) * alone / count,
        }
        for count in PREDICTED
        if count > cores()
    ]
    return [*long, *more, journey]


def report(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown, by engine."""
    lines = [
        "| | cases a second | over cores times one process | processor time of a case | share |",
        "|---|---|---|---|---|",
    ]
    forms = {
        "cases_per_s": "{:.2f}",
        "rate_efficiency": "{:.2f}",
        "processor_s": "{:.2f} s",
        "efficiency": "{:.2f}",
    }
    for row in rows:
        if row["name"] != "short cases":
            cells = [form.format(row[key]) if key in row else "-" for key, form in forms.items()]
            lines.append(f"| {row['name']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Measure and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "sweep_engines.json")
    parser.add_argument("--cases", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--short", type=int, default=100_000)
    options = parser.parse_args()
    gc.set_threshold(*GARBAGE)  # as of the command line, and of workers
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = with_efficiency([*throughput(options.cases, options.rounds), overhead(options.short)])
    for row in rows:
        print(row, flush=True)
    save(options.save, rows)


if __name__ == "__main__":
    main()
