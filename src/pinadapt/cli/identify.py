"""``pinadapt identify``: the parameters of a robot from a recorded motion."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._files import check_writable, one_run
from ..exceptions import InputError, ParameterError
from ..identification.identification import Identification
from ..identification.identification import identify as identify_log
from ..identification.report import FILES
from ..robot.loading import load
from ..robot.robot import Robot
from ..scenario.scenario import Scenario
from .outputs import RUN_FILES, steps_bar
from .status import DONE

_SCENARIO = ".toml"


def identify(options: argparse.Namespace) -> int:
    """Learn a robot from a log, write its outputs, print the report, its verdict last.

    Nothing is written before all is learned.
    """
    folder = options.out or Path("out") / f"{options.log.stem or 'log'}-identified"
    _check_place(folder, options.log)
    robot, unknown = _believed(options)
    for name in ("kinematic", "dynamic", "joint", "compensated"):
        given = getattr(options, name)
        unknown |= {} if given is None else {name: _words(given)}
    found = identify_log(
        options.log,
        robot,
        adaptation=options.adaptation,
        columns=dict(options.columns),
        degrees=options.degrees,
        topic=options.topic,
        pose_topic=options.pose_topic,
        **unknown,
    )
    try:
        _write(found, folder)
    finally:
        print(found.report())  # what the disk does not keep, the terminal shows
    print(f"\nwritten to {folder}")
    return DONE


def _check_place(folder: Path, log: Path) -> None:
    """Refuse a folder that cannot be written, or that holds the run to be read.

    Raises:
        InputError: it is such a folder.
    """
    check_writable(folder, FILES)
    if any((folder / name).is_file() for name in set(RUN_FILES) - set(FILES)):
        raise InputError(
            "holds a run, whose files have the same names.",
            where=str(folder),
            hint="--out takes another place.",
        )


def _believed(options: argparse.Namespace) -> tuple[Robot, dict[str, Any]]:
    """Return the robot as described, of a scenario as believed, and what that says is unknown."""
    chosen = {name: getattr(options, name) for name in ("frame", "task", "mass")}
    chosen |= {"locked": options.lock or (), "xacro": dict(options.xacro) or None}
    if Path(options.robot).suffix != _SCENARIO:
        return load(options.robot, **chosen), {}
    if any(chosen.values()):
        raise InputError("the scenario says which frame, task and joints.", where="robot")
    scenario = Scenario.read(Path(options.robot))
    unknown = scenario.tables.unknown
    words = {"kinematic": unknown.kinematic, "dynamic": unknown.dynamic, "joint": unknown.joint}
    return scenario.believed, {name: part for name, part in words.items() if part is not None}


def _words(given: str | list[str]) -> str | list[str]:
    """Return one word as it is: "all" is no list of joints."""
    return given[0] if isinstance(given, list) and len(given) == 1 else given


def _write(found: Identification, folder: Path) -> None:
    """Let the files take the place of those of an earlier identification."""
    steps: list[Callable[[Path], object]] = [found.plot, found.save]
    with one_run(folder, FILES) as beside:
        for step in steps_bar(steps, "identify: outputs"):
            try:
                step(beside)
            except ParameterError as reason:
                print(f"pinadapt: not all that was learned is written: {reason}", file=sys.stderr)
