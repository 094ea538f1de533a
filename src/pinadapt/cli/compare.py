"""``pinadapt compare`` and ``demo``: several runs, one table."""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from .._output import check_writable, columns, number, one_run, write_text
from ..description.catalogue import robots_folder
from ..exceptions import UnusedGainWarning
from ..laws import LAWS
from ..plots.figures import overlay_figure
from ..rollout.rollout import Rollout
from ..scenario.scenario import Scenario
from ..tasks.task import DISPLAYS, JointTask
from .command_line import (
    DONE,
    INTERRUPTED,
    add_out,
    add_scenario,
    add_unadapted,
    interrupted,
    names,
    status_of,
)
from .run import RUN_FILES, check_place, run_beside, unadapted, write_run

TABLE, FIGURE = "compare.json", "compare.png"
_FILES = [*(f"{law}/{name}" for law in LAWS for name in RUN_FILES), FIGURE, TABLE]
_ERRORS = 7  # number of columns up to the errors


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)
    add_out(parser, "out/ and the scenario's name and -compare")
    parser.add_argument(
        "--laws",
        type=names,
        metavar="A,B",
        help=f"names among {', '.join(LAWS)} (default: all that fit the task)",
    )
    add_unadapted(parser)


def compare(options: argparse.Namespace) -> int:
    """Run a scenario under several laws, print one table, write outputs, table and one figure.

    The table is ``compare.json``, the figure with the errors of all laws ``compare.png``. Files of
    an earlier comparison stay until those of this one are complete. A law
    that diverges is a row of the table, not a failure of the command. Each warning is printed once,
    with the laws that it concerns.
    """
    folder = options.out or Path("out") / f"{options.scenario.stem}-compare"
    # Building the scenarios checks them all before the first one runs.
    laws = options.laws or _laws(Scenario.read(options.scenario, options.set))
    pairs, said = [], _Warnings()
    for law in laws:
        with said.of(law):
            pairs.append(_scenarios(options, law))
            for finding in pairs[-1][0].findings():
                warnings.warn(finding, stacklevel=1)
    said.show()
    check_writable(folder, [TABLE, FIGURE])
    for law in laws:
        check_place(folder / law)
    rollouts: list[Rollout] = []
    try:
        with one_run(folder, _FILES, partly=False) as beside:
            for law, (scenario, without) in zip(laws, pairs, strict=True):
                with said.of(law):
                    rollouts.append(run_beside(scenario, without))
                said.show()
                write_run(rollouts[-1], beside / law, html=False)
                if interrupted(rollouts):
                    break
            (beside / FIGURE).write_bytes(overlay_figure(rollouts).png(dpi=130))
            summaries = [rollout.summary() for rollout in rollouts]
            write_text(beside / TABLE, json.dumps(summaries, indent=2) + "\n")
    finally:
        print(comparison_table(rollouts))
    print(f"\nwritten to {folder}")
    return INTERRUPTED if interrupted(rollouts) else DONE


def _scenarios(options: argparse.Namespace, law: str) -> tuple[Scenario, Scenario | None]:
    """Return the scenario with a law, and with ``--unadapted`` the same without adaptation."""
    setting = f'controller.law="{law}"'
    adapted = Scenario.read(options.scenario, [*options.set, setting])
    beside = options.unadapted and adapted.controller.law.adapts
    return adapted, unadapted(options, setting) if beside else None


class _Warnings:
    """Warnings of several laws, each shown once and with the laws that it concerns."""

    def __init__(self) -> None:
        self._new: dict[str, list[str]] = {}
        self._shown: set[str] = set()

    @contextmanager
    def of(self, law: str) -> Iterator[None]:
        """Collect the warnings of the block, for a law."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            warnings.simplefilter("ignore", UnusedGainWarning)  # all laws get the same gains
            try:
                yield
            finally:
                for text in dict.fromkeys(str(warning.message) for warning in caught):
                    self._new.setdefault(text, []).append(law)

    def show(self) -> None:
        """Show the collected warnings that were not shown yet."""
        for text, laws in self._new.items():
            if text not in self._shown:
                warnings.warn(f"{', '.join(laws)}: {text}", stacklevel=2)
        self._shown |= set(self._new)
        self._new = {}


def _laws(scenario: Scenario) -> list[str]:
    """Return the names of the laws for the scenario's kind of task and motion."""
    joints = isinstance(scenario.true.task, JointTask)
    calibrated = scenario.controller.kinematics.calibrated
    rests = scenario.trajectory.settles is not None
    return [
        name
        for name, law in LAWS.items()
        if law.joint_space == joints
        and (rests or not law.set_point)
        and (calibrated or law.uses_position_error)
    ]


def comparison_table(rollouts: Sequence[Rollout]) -> str:
    """Return a table with a row for each rollout, and for poses a column with the angle."""
    if not rollouts:
        return "nothing has run"
    shown = rollouts[0].task.groups[0].shown
    header: tuple[str, ...] = (
        "run",
        "law",
        "adaptation",
        f"first 10 % [{shown.unit}]",
        f"last 10 % [{shown.unit}]",
        "[% of path]",
        f"rms [{shown.unit}]",
        "min eig M_hat [kg m^2]",
        "step [us]",
        "verdict",
    )
    rows = [_row(rollout, shown.scale) for rollout in rollouts]
    if any(rollout.angle is not None for rollout in rollouts):
        cells = [_angle(rollout) for rollout in rollouts]
        header, rows = _with_column(header, rows, "last 10 % [deg]", cells)
    if any(rollout.unadapted is not None for rollout in rollouts):
        cells = [number(rollout.unadapted, scale=shown.scale, digits=3) for rollout in rollouts]
        header, rows = _with_column(header, rows, f"not adapted [{shown.unit}]", cells)
    return columns(header, rows)


def _with_column(
    header: tuple[str, ...], rows: list[list[str]], name: str, cells: Sequence[str]
) -> tuple[tuple[str, ...], list[list[str]]]:
    """Return header and rows with a column inserted after the errors."""
    head, tail = header[:_ERRORS], header[_ERRORS:]
    wider = [[*row[:_ERRORS], cell, *row[_ERRORS:]] for row, cell in zip(rows, cells, strict=True)]
    return (*head, name, *tail), wider


def _angle(rollout: Rollout) -> str:
    """Return the largest orientation error in the last 10 % [deg], or a dash for positions."""
    return number(rollout.summary().get("max_angle_last"), scale=DISPLAYS["rad"].scale, digits=3)


def _row(rollout: Rollout, scale: float) -> list[str]:
    numbers = rollout.summary()
    return [
        rollout.title,
        rollout.law,
        rollout.adaptation,
        number(numbers["max_error_first"], scale=scale, digits=2),
        number(numbers["max_error_last"], scale=scale, digits=3),
        number(numbers["error_share"], scale=100.0, digits=2),
        number(numbers["rms_error_last"], scale=scale, digits=3),
        number(numbers["min_eig_M_hat"], digits=4),
        number(numbers["step_time_us"], digits=0),
        rollout.grade,
    ]


# The demo

# folder and scenario file
SHOWCASE = {
    "planar": "planar_2r/wang_xie_2009.toml",
    "panda": "panda/tool_and_load.toml",
}


def demo_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``demo``."""
    add_out(parser, Path("out/demo"))


def demo(options: argparse.Namespace) -> int:
    """Run the showcases, print one table, write all outputs; return 3 if one diverged, else 0."""
    folders = [check_place(options.out / name) for name in SHOWCASE]
    rollouts: list[Rollout] = []
    try:
        for file, folder in zip(SHOWCASE.values(), folders, strict=True):
            path = robots_folder() / file
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UnusedGainWarning)  # of a run without adaptation
                without = Scenario.read(path, ['controller.adaptation="none"'])
            rollouts.append(run_beside(Scenario.read(path), without))
            write_run(rollouts[-1], folder, html=True)
            if interrupted(rollouts):
                break
    finally:
        print(comparison_table(rollouts))
    print(
        f"\nplots and animations: {options.out}/*/"
        "error.png, parameters.png, torque.png, animation.html"
    )
    return status_of(*rollouts)
