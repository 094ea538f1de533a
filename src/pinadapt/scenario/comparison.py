"""One scenario under several laws, and one table of several runs."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from .._checks import name_list
from .._output import records_table
from ..exceptions import Interrupted, UnusedGainWarning
from ..laws import LAWS
from ..rollout.recording import extreme
from ..rollout.rollout import Rollout
from ..tasks.task import DISPLAYS, JointTask
from .scenario import Scenario


def compare(
    scenario: Path | str,
    laws: str | Sequence[str] | None = None,
    *,
    settings: str | Sequence[str] = (),
) -> list[Rollout]:
    """Run a scenario under several laws; ``print(comparison_table(rollouts))`` shows them.

    A law that diverges is a rollout that says so.

    Args:
        scenario: its file.
        laws: one or some names of ``pinadapt.laws.LAWS``; None: all that fit the task.
        settings: dotted "key=value" that override the file.

    Raises:
        InputError: as ``Scenario.read``.
        Interrupted: a ``KeyboardInterrupt``, with the rollout until then.
    """
    settings = name_list(settings, "settings")
    return [run_scenario(each) for each in under_laws(scenario, laws, settings).values()]


def under_laws(
    scenario: Path | str, laws: str | Sequence[str] | None, settings: Sequence[str]
) -> dict[str, Scenario]:
    """Return the scenario with each law, by name; None: with all laws that fit the task."""
    laws = name_list(laws, "laws") if laws else laws_for(Scenario.read(scenario, settings))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnusedGainWarning)  # all laws get the same gains
        return {
            law: Scenario.read(scenario, [*settings, f'controller.law="{law}"']) for law in laws
        }


def unadapted(scenario: Path | str, settings: Sequence[str] = ()) -> Scenario:
    """Return the scenario of a file without adaptation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnusedGainWarning)  # those of the adaptation
        return Scenario.read(scenario, [*settings, 'controller.adaptation="none"'])


def laws_for(scenario: Scenario) -> list[str]:
    """Return the names of the laws for the scenario's kind of task and motion."""
    return [
        name
        for name, law in LAWS.items()
        if law.joint_space == isinstance(scenario.true.task, JointTask)
        and (scenario.trajectory.settles is not None or not law.set_point)
        and (scenario.controller.kinematics.calibrated or law.uses_position_error)
    ]


def run_scenario(scenario: Scenario, *, live: bool = False) -> Rollout:
    """Return the rollout of a scenario; if it is interrupted, the part that was simulated."""
    try:
        return scenario.run("live" if live else None)
    except Interrupted as stop:
        print(f"pinadapt: {stop}; the outputs end there.", file=sys.stderr)
        return stop.rollout


def run_beside(scenario: Scenario, without: Scenario | None, *, live: bool = False) -> Rollout:
    """Return the rollout of a scenario, with the error of the unadapted scenario if one is given.

    The unadapted one runs first; if it is interrupted, its rollout is returned.
    """
    if without is None:
        return run_scenario(scenario, live=live)
    first = run_scenario(without)
    if first.interrupted is not None:
        return first
    return replace(
        run_scenario(scenario, live=live), unadapted=extreme(np.max, first.window(False))
    )


def comparison_table(rollouts: Sequence[Rollout]) -> str:
    """Return a table with a row for each rollout, one at least, without columns that none has."""
    unit, scale = rollouts[0].task.groups[0].shown
    numbers = {
        f"first 10 % [{unit}]": ("max_error_first", scale, 2),
        f"last 10 % [{unit}]": ("max_error_last", scale, 3),
        "[% of path]": ("error_share", 100.0, 2),
        f"rms [{unit}]": ("rms_error_last", scale, 3),
        "last 10 % [deg]": ("max_angle_last", DISPLAYS["rad"].scale, 3),
        f"not adapted [{unit}]": ("unadapted", scale, 3),
        "min eig M_hat [kg m^2, kg]": ("min_eig_M_hat", 1.0, 4),
        "step [us]": ("step_time_us", 1.0, 0),
    }
    records = [
        {**each.numbers, "run": each.title, "unadapted": each.unadapted, "verdict": each.grade}
        for each in rollouts
    ]
    return str(records_table(records, ("run", "law", "adaptation"), numbers))
