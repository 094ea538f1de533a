"""Output files of a run: complete, never mixed with another run's, rescued from a full disk."""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from .._output import check_writable, one_run
from ..exceptions import InputError, Interrupted
from ..rollout.rollout import Rollout
from ..scenario.scenario import Scenario

Item = TypeVar("Item")


def rows_bar(rows: Iterable[Item], total: int) -> Iterable[Item]:
    """Return the rows of the zoo, with a progress bar if standard error is a terminal."""
    return _bar(rows, total, "zoo", "robot")


def steps_bar(steps: Sequence[Item], name: str) -> Iterable[Item]:
    """Return the steps of some work, with a progress bar if standard error is a terminal."""
    return _bar(steps, len(steps), name, "step")


def _bar(items: Iterable[Item], total: int, name: str, unit: str) -> Iterable[Item]:
    bar: Iterable[Item] = tqdm(items, total=total, desc=name, unit=unit, disable=None, leave=False)
    return bar


def warn_of_findings(scenario: Scenario) -> None:
    """Warn of what the pre-run check finds in a scenario, or say that it passed."""
    found = scenario.findings()
    for finding in found:
        warnings.warn(finding, stacklevel=2)
    if not found:
        law, dt = scenario.controller.law.name, scenario.tables.simulation.dt
        print(f"Pre-run check passed: '{law}' is stable at {1e3 * dt:g} ms.")


RUN_FILES = (
    "rollout.npz",
    "error.png",
    "parameters.png",
    "torque.png",
    "animation.html",
    "learned.json",
    "learned.urdf",
    "summary.json",
)


def check_place(folder: Path) -> Path:
    """Return the folder after a check that the files of a run can be written to it.

    Raises:
        InputError: they cannot be written.
    """
    check_writable(folder, RUN_FILES)
    return folder


def run_scenario(scenario: Scenario, *, live: bool = False) -> Rollout:
    """Return the rollout of a scenario; if it is interrupted, the part that was simulated."""
    try:
        return scenario.run(view=live)
    except Interrupted as stop:
        print(f"pinadapt: {stop}; the outputs end there.", file=sys.stderr)
        return stop.rollout


def write_run(rollout: Rollout, folder: Path, *, html: bool) -> None:
    """Replace the files of an earlier run by those of this one; ``html``: with the animation.

    Raises:
        OSError: some could not be written; the message names the folder with the others.
    """
    steps: list[Callable[[Path], object]] = [
        rollout.save,
        rollout.plot,
        partial(_keep_learned, rollout),
        *([partial(_animate, rollout)] if html else []),
    ]
    saved = False
    try:
        with one_run(folder, RUN_FILES) as beside:
            try:
                for step in steps_bar(steps, f"{rollout.title}: outputs"):
                    step(beside)
            finally:
                saved = (beside / RUN_FILES[0]).is_file()
    except OSError as error:
        place = folder if saved else _rescued(rollout)
        raise OSError(
            f"{folder}: not all could be written: {error.strerror or error}. "
            + (f"The rollout is in {place}." if place else "The rollout is lost.")
        ) from error


def _animate(rollout: Rollout, folder: Path) -> None:
    rollout.animate().save(folder / "animation.html")


def _keep_learned(rollout: Rollout, folder: Path) -> None:
    """Write the learned parameters, if any: as JSON and, if they are those of bodies, as URDF."""
    if not (rollout.kinematic_names or rollout.dynamic_names):
        return
    try:
        rollout.parameters().save(folder / "learned.json")
        if rollout.evaluated().controller.dynamics.per_body:
            rollout.learned().save(folder / "learned.urdf")
    except InputError as reason:
        print(f"pinadapt: some learned parameters were not written: {reason}", file=sys.stderr)


def _rescued(rollout: Rollout) -> Path | None:
    """Save a rollout to a temporary folder and return it, or None if that fails too."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="pinadapt-"))
        rollout.save(folder)
    except OSError:
        return None
    return folder
