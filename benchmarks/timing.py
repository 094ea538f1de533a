"""Shared by the benchmarks: alternate timing of calls, saved figures, and tables in Markdown."""

from __future__ import annotations

import gc
import json
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

from pinadapt.sweep.table import CaseTable

HERE = Path(__file__).parent


def in_turn(functions: dict[str, Callable[[], float | None]], rounds: int) -> dict[str, np.ndarray]:
    """Return the times [s] of each function (rounds), all of them called once in every round.

    All functions of a round have the same state of caches and clock, so that ratios within a round
    are meaningful. A function may return the time to count in place of its duration. A tenth more
    rounds are made first, as a warm-up, and not returned.
    """
    times: dict[str, list[float]] = {name: [] for name in functions}
    gc.collect()
    gc.disable()
    for _ in range(rounds + rounds // 10 + 1):
        for name, function in functions.items():
            started = perf_counter()
            counted = function()
            times[name].append(perf_counter() - started if counted is None else counted)
    gc.enable()
    return {name: np.array(values[-rounds:]) for name, values in times.items()}


def repeated(call: Callable[[], object], count: int) -> Callable[[], None]:
    """Return a function that makes a call so many times."""

    def calls() -> None:
        for _ in range(count):
            call()

    return calls


def two_digits(number: float) -> str:
    """Return a positive number with two digits."""
    return f"{number:.0f}" if number >= 10.0 else f"{number:#.2g}"


def saved(path: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a benchmark's file by name; none if there is no file."""
    rows = json.loads(path.read_text())["rows"] if path.is_file() else []
    return {row["name"]: row for row in rows}


def table_rows(name: str) -> list[dict[str, Any]]:
    """Return the rows of the table of a sweep, in order: ``make NAME.table`` measures them."""
    return list(CaseTable.load(HERE / f"{name}.csv").rows())


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [f"| {' | '.join(map(str, line))} |" for line in [head, *rows]]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def run_errors(row: Mapping[str, Any]) -> str:
    """Return the largest error of a run and of its last tenth, in per cent; "" without a row."""
    if not row:
        return ""
    if row.get("largest") in (None, ""):
        return "lost"
    return f"{100.0 * row['largest']:.2g} / {100.0 * row['last']:.2g}"


def save(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the rows of a benchmark with the environment of the measurement."""
    environment = {
        "python": platform.python_version(),
        "pin": pin.__version__,
        "numpy": np.__version__,
        "machine": platform.machine(),
    }
    path.write_text(json.dumps({"environment": environment, "rows": rows}, indent=2) + "\n")
    print(f"saved to {path}")
