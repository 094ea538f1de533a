"""What a simulated sample spends in Pinocchio, in kernels, and in Python around them.

``python -m benchmarks.sample_shares [--save FILE]`` runs robots/panda/tool_and_load.toml sample by
sample under natural adaptation, first as it is and then with a clock around every call of Pinocchio
and of every kernel. The time that the clock itself takes is subtracted. The last column is the
largest factor that a batch of cases in one process could gain: if Python cost nothing at all.
"""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter_ns
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt import _compiled
from pinadapt.scenario import Scenario

from .simulated_sample import NATURAL, SCENARIO
from .timing import HERE, save

WARM, BLOCK, ROUNDS = 50, 20, 120


class Clock:
    """Time and number of the calls of wrapped functions.

    Attributes:
        spent: time [ns], by kind.
        calls: their number, by kind.
    """

    def __init__(self) -> None:
        """Begin at zero."""
        self.spent = {"pinocchio": 0, "kernels": 0}
        self.calls = dict(self.spent)

    def around(self, function: Callable[..., Any], kind: str) -> Callable[..., Any]:
        """Return a function that is timed."""

        def timed(*arguments: Any, **words: Any) -> Any:
            """Call the function."""
            started = perf_counter_ns()
            result = function(*arguments, **words)
            self.spent[kind] += perf_counter_ns() - started
            self.calls[kind] += 1
            return result

        return timed

    def own(self) -> float:
        """Return the time that it adds to each call [ns]."""
        empty, times = self.around(lambda a, b, c: None, "kernels"), []
        for _ in range(2000):
            before = self.spent["kernels"]
            empty(1, 2, 3)
            times.append(self.spent["kernels"] - before)
        return float(np.median(times))

    def install(self) -> None:
        """Wrap the functions of Pinocchio and all kernels, wherever they are named."""
        for name, function in list(vars(pin).items()):
            plain = callable(function) and not isinstance(function, type)
            if plain and not name.startswith("_"):
                setattr(pin, name, self.around(function, "pinocchio"))
        rooms = [
            module
            for name, module in sys.modules.items()
            if name.startswith("pinadapt") and isinstance(module, ModuleType)
        ]
        for key in _compiled.kernels:
            module, _, name = key.rpartition(".")
            kernel = getattr(sys.modules[module], name)
            timed = self.around(kernel, "kernels")
            for room in rooms:
                for label, thing in list(vars(room).items()):
                    if thing is kernel:
                        setattr(room, label, timed)


def blocks(scenario: Scenario, clock: Clock) -> np.ndarray:
    """Return time [ns], time in both kinds and number of their calls, medians a sample (5)."""
    stream = pa.run(
        pa.plants.PinocchioPlant(scenario.true), scenario.controller, scenario.trajectory
    )
    for _ in range(WARM):
        next(stream)
    rows = []
    for _ in range(ROUNDS):
        before = [*clock.spent.values(), *clock.calls.values()]
        started = perf_counter_ns()
        for _ in range(BLOCK):
            next(stream)
        took = perf_counter_ns() - started
        after = [*clock.spent.values(), *clock.calls.values()]
        rows.append([took, *np.subtract(after, before)])
    return np.median(rows, axis=0) / BLOCK


def main() -> None:
    """Print and save the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, default=HERE / "sample_shares.json")
    path = parser.parse_args().save
    scenario, clock = Scenario.read(SCENARIO, [NATURAL]), Clock()
    gc.disable()
    whole, *_ = blocks(scenario, clock)
    clock.install()
    _, of_pin, of_kernels, calls_pin, calls_kernels = blocks(scenario, clock)
    own = clock.own()
    inside = {
        "pinocchio_us": 1e-3 * (of_pin - calls_pin * own),
        "kernels_us": 1e-3 * (of_kernels - calls_kernels * own),
    }
    row = {
        "name": "panda, natural",
        "sample_us": 1e-3 * whole,
        **inside,
        "python_us": 1e-3 * whole - sum(inside.values()),
        "calls_of_pinocchio": calls_pin,
        "calls_of_kernels": calls_kernels,
        "largest_gain": 1e-3 * whole / sum(inside.values()),
    }
    row = {key: value if isinstance(value, str) else float(value) for key, value in row.items()}
    print(row)
    save(path, [row])


if __name__ == "__main__":
    main()
