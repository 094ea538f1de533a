"""``pinadapt compare``: the laws side by side."""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Sequence
from pathlib import Path

from .._table import columns, number
from ..exceptions import UnusedGainWarning
from ..laws import LAWS
from ..rollout.rollout import Rollout
from ..scenario.scenario import Scenario
from ..tasks.joint import JointTask
from ..tasks.units import DISPLAYS
from .run import run_and_write


def compare(options: argparse.Namespace) -> int:
    """Run a scenario under several laws, print one table, write outputs and ``compare.json``.

    A law that diverges is a result, shown in the table, not a failure of the comparison.
    """
    folder = options.out or Path("out") / f"{options.scenario.stem}-compare"
    # All scenarios are built, and so checked, before the first one runs.
    laws = options.laws or _laws(Scenario.read(options.scenario, options.set))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnusedGainWarning)  # one set of gains serves all laws
        scenarios = [
            Scenario.read(options.scenario, [*options.set, f'controller.law="{law}"'])
            for law in laws
        ]
    rollouts = [
        run_and_write(scenario, folder / scenario.controller.law.name, html=False)
        for scenario in scenarios
    ]
    print(comparison_table(rollouts))
    (folder / "compare.json").write_text(
        json.dumps([rollout.summary() for rollout in rollouts], indent=2) + "\n"
    )
    print(f"\nwritten to {folder}")
    return 0


def _laws(scenario: Scenario) -> list[str]:
    """Return the names of the laws made for the scenario's task."""
    joints = isinstance(scenario.true.task, JointTask)
    return [name for name, law in LAWS.items() if law.joint_space == joints]


def comparison_table(rollouts: Sequence[Rollout]) -> str:
    """Return one row a rollout; poses get a column for their angle."""
    shown = DISPLAYS[rollouts[0].task.groups[0].unit]
    header: tuple[str, ...] = (
        "run",
        "law",
        "adaptation",
        f"first 10 % [{shown.unit}]",
        f"last 10 % [{shown.unit}]",
        f"rms [{shown.unit}]",
        "min eig M_hat",
        "step [us]",
        "verdict",
    )
    rows = [_row(rollout, shown.scale) for rollout in rollouts]
    if any(rollout.angle is not None for rollout in rollouts):
        header = (*header[:6], "last 10 % [deg]", *header[6:])
        rows = [
            [*row[:6], _angle(rollout), *row[6:]]
            for row, rollout in zip(rows, rollouts, strict=True)
        ]
    return columns(header, rows)


def _angle(rollout: Rollout) -> str:
    """Return the largest angle of a pose in the last 10 %, a dash for tasks without orientation."""
    return number(rollout.summary().get("max_angle_last"), scale=DISPLAYS["rad"].scale, digits=3)


def _row(rollout: Rollout, scale: float) -> list[str]:
    numbers = rollout.summary()
    verdict = "ok" if rollout.diverged is None else f"diverged at {rollout.diverged:.3f} s"
    return [
        rollout.title,
        rollout.law,
        rollout.adaptation,
        number(numbers["max_error_first"], scale=scale, digits=2),
        number(numbers["max_error_last"], scale=scale, digits=3),
        number(numbers["rms_error_last"], scale=scale, digits=3),
        number(numbers["min_eig_M_hat"], digits=4),
        number(numbers["step_time_us"], digits=0),
        verdict,
    ]
