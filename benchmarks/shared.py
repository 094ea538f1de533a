"""Shared by the benchmarks: sensors, quiet runs, tables in Markdown, and alternate timing."""

from __future__ import annotations

import gc
import json
import platform
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.sweep.table import DIVERGED, CaseTable

HERE = Path(__file__).parent
CAMERA = pa.Camera(rate=30.0, delay=0.06)
COUNT = {bits: 2.0 * np.pi / 2**bits for bits in (14, 17)}  # [rad] of encoders
Row = Mapping[str, Any]


# --- runs ---


@contextmanager
def quiet() -> Iterator[None]:
    """Say no warnings: a table has the results."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def diverged(rollout: pa.Rollout) -> dict[str, Any]:
    """Return the row of a run that has diverged."""
    return {"status": DIVERGED, "reason": f"at {rollout.diverged:.1f} s"}


def rms(values: np.ndarray) -> float:
    """Return the root mean square of all numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


# --- tables ---


def table_rows(name: str) -> list[dict[str, Any]]:
    """Return the rows of the table of a sweep, in order: ``make NAME.table`` measures them."""
    return list(CaseTable.load(HERE / f"{name}.csv").rows())


def grouped(rows: Iterable[Row], *keys: str) -> dict[Any, list[Row]]:
    """Return the rows by their values of the keys, a tuple of several, in their order."""
    found: dict[Any, list[Row]] = {}
    for row in rows:
        values = tuple(row[key] for key in keys)
        found.setdefault(values if len(keys) > 1 else values[0], []).append(row)
    return found


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [f"| {' | '.join(map(str, line))} |" for line in [head, *rows]]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def spread(values: Iterable[float]) -> str:
    """Return median / largest of some numbers, "" of none."""
    found = list(values)
    return f"{median(found):.2g} / {max(found):.2g}" if found else ""


def two_digits(number: float) -> str:
    """Return a positive number with two digits."""
    return f"{number:.0f}" if number >= 10.0 else f"{number:#.2g}"


# --- timing ---


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


def save(name: str, rows: list[dict[str, Any]]) -> None:
    """Print the figures of a benchmark, and save them with the environment of the measurement."""
    for row in rows:
        figures = [f"{key} {value:.3g}" for key, value in row.items() if isinstance(value, float)]
        print(f"{row['name']}: {', '.join(figures)}")
    environment = {
        "python": platform.python_version(),
        "pin": pin.__version__,
        "numpy": np.__version__,
        "machine": platform.machine(),
    }
    text = json.dumps({"environment": environment, "rows": rows}, indent=2)
    (HERE / f"{name}.json").write_text(f"{text}\n")
