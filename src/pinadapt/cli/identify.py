"""``pinadapt identify``: estimate a robot's parameters from a recorded motion."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._output import check_writable, one_run
from ..exceptions import InputError, ParameterError
from ..identification.identification import Identification
from ..identification.identification import identify as identify_log
from ..identification.report import FILES
from ..robot.loading import load
from ..robot.robot import Robot
from ..scenario.scenario import Scenario
from ..tuning.unknowns import Unknown
from .arguments import add_description, add_out, assignment, names
from .outputs import RUN_FILES, steps_bar
from .status import DONE

_SCENARIO = ".toml"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "log",
        type=Path,
        metavar="LOG",
        help="npz, CSV, ROS bag or MCAP, or a folder that `pinadapt run` wrote; rad, m, N m, N, s",
    )
    parser.add_argument(
        "--robot",
        required=True,
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, a name as for `init`, or a scenario: its initial model",
    )
    parser.add_argument("--frame", metavar="LINK", help="task frame (default: as for `init`)")
    parser.add_argument("--task", metavar="TASK", help="xyz, xy, xz, yz, pose or joint")
    for option, what in (
        ("--lock", "joints that did not move (default: those off the chain)"),
        (
            "--kinematic",
            "unknown translations: tool, base, joint names (default: tool if x is recorded)",
        ),
        ("--dynamic", "unknown bodies: all, payload, none or joint names (default: all)"),
        (
            "--joint",
            "unknown joint coefficients: all, none, armature, viscous, coulomb, load, asymmetry, "
            "offset (default: viscous, coulomb, and what cross-validation chooses)",
        ),
    ):
        parser.add_argument(option, type=names, metavar="A,B", help=what)
    parser.add_argument(
        "--adaptation",
        choices=(
            "natural-memory",
            "natural-composite",
            "composite-memory",
            "composite",
            "least-squares",
        ),
        default="natural-memory",
        help="adaptation of the online estimator (default: %(default)s)",
    )
    parser.add_argument(
        "--compensated",
        choices=("nominal",),
        help="the arm compensates gravity itself; the log's torques do not contain it",
    )
    parser.add_argument(
        "--columns",
        type=_signal,
        nargs="+",
        action="extend",
        default=[],
        metavar="SIGNAL=NAME,...",
        help="columns of t, q, v, tau, x or x_time, in the robot's order; or one name in which * "
        "stands for the joint's name or index",
    )
    parser.add_argument("--degrees", action="store_true", help="angles are in degrees")
    parser.add_argument("--topic", metavar="NAME", help="topic of a bag's joint states")
    parser.add_argument(
        "--pose-topic",
        metavar="NAME",
        help="topic of a bag's PointStamped, PoseStamped or TransformStamped messages",
    )
    add_description(parser)
    add_out(parser, "out/ and the log's name and -identified")


def _signal(text: str) -> tuple[str, list[str]]:
    """Return a signal and the names of its columns.

    Raises:
        ArgumentTypeError: the equals sign or the names are missing.
    """
    name, columns = assignment(text)
    return name, names(columns)


def identify(options: argparse.Namespace) -> int:
    """Estimate a robot's parameters from a log, write the outputs and print report and verdict.

    Nothing is written before the estimation is complete.
    """
    folder = options.out or Path("out") / f"{options.log.stem or 'log'}-identified"
    _check_place(folder, options.log)
    robot, unknown = _robot_and_unknown(options)
    for name in ("kinematic", "dynamic", "joint"):
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
        unknown=Unknown.of_tables(**unknown),
        compensated=options.compensated,
    )
    try:
        _write(found, folder)
    finally:
        print(found.report())  # even if it could not be written
    print(f"\nwritten to {folder}")
    return DONE


def _check_place(folder: Path, log: Path) -> None:
    """Refuse a folder that is not writable or that contains a run, perhaps the log itself.

    Raises:
        InputError: the folder is refused.
    """
    check_writable(folder, FILES)
    if any((folder / name).is_file() for name in set(RUN_FILES) - set(FILES)):
        raise InputError(
            "holds a run, whose files have the same names.",
            where=str(folder),
            hint="--out takes another place.",
        )


def _robot_and_unknown(options: argparse.Namespace) -> tuple[Robot, dict[str, Any]]:
    """Return the robot and what is unknown; a scenario gives its estimated model and [unknown]."""
    chosen = {name: getattr(options, name) for name in ("frame", "task", "mass")}
    chosen |= {"locked": options.lock or (), "xacro": dict(options.xacro) or None}
    if Path(options.robot).suffix != _SCENARIO:
        return load(options.robot, **chosen), {}
    if any(chosen.values()):
        raise InputError("the scenario says which frame, task and joints.", where="robot")
    scenario = Scenario.read(Path(options.robot))
    unknown = scenario.tables.unknown
    words = {"kinematic": unknown.kinematic, "dynamic": unknown.dynamic, "joint": unknown.joint}
    return scenario.estimated, {name: part for name, part in words.items() if part is not None}


def _words(given: str | list[str]) -> str | list[str]:
    """Return a single word instead of a list of one: "all" is not the name of a joint."""
    return given[0] if isinstance(given, list) and len(given) == 1 else given


def _write(found: Identification, folder: Path) -> None:
    """Replace the files of an earlier identification by those of this one."""
    steps: list[Callable[[Path], object]] = [found.plot, found.save]
    with one_run(folder, FILES) as beside:
        for step in steps_bar(steps, "identify: outputs"):
            try:
                step(beside)
            except ParameterError as reason:
                print(f"pinadapt: some results were not written: {reason}", file=sys.stderr)
