"""``pinadapt identify`` and ``calibrate``: a robot's parameters from a recorded motion."""

from __future__ import annotations

import argparse
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from .._output import one_run, write_text
from ..exceptions import InputError, ParameterError, TorqueMismatchError
from ..identification import calibration
from ..identification.identification import identify as identify_log
from ..identification.identification import log_and_robot
from ..identification.report import FILES, Identification
from ..identification.torque_check import check_torques
from ..logs.import_options import MOUNTS, REPEATED, SUFFIX, ImportOptions, place_beside
from ..robot.loading import load
from ..robot.robot import Robot
from ..scenario.tables import toml_value
from ..tuning.unknowns import Unknown
from .command_line import (
    Exit,
    add_arguments_of,
    add_description,
    add_out,
    assignment,
    given,
    names,
    out_folder,
    word_or_names,
)
from .run import RUN_FILES


def identify_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``identify``."""
    group = _add_shared(parser, "identified")
    group.add_argument(
        "--write-import-options",
        action="store_true",
        help="read and check the log, write that file, and stop",
    )
    add_arguments_of(parser, load, {"task": str})
    for option, what in (
        (
            "--kinematic",
            "unknown translations: tool, base, joint names (default: tool if x is recorded)",
        ),
        ("--dynamic", "unknown bodies: all, payload, none or joint names (default: all)"),
        (
            "--joint",
            "unknown joint coefficients: all, none, armature, viscous, coulomb, gear_friction, "
            "asymmetry, offset (default: viscous, coulomb, and what cross-validation chooses)",
        ),
    ):
        parser.add_argument(option, type=word_or_names, metavar="A,B", help=what)
    several = {"type": Path, "nargs": "+", "action": "extend", "default": [], "metavar": "LOG"}
    add_arguments_of(
        parser,
        identify_log,
        {
            "test": several,
            "empty": Path,
            "total_mass": float,
            "known_load": float,
            "mass_bounds": {"type": _bounds, "action": "append", "metavar": "JOINT=LOW,HIGH"},
        },
    )
    parser.add_argument(
        "--compare",
        nargs="+",
        action="extend",
        default=[],
        metavar="ROBOT",
        help="other models of the robot, such as a published one: URDF with friction, or a name; "
        "their errors stand in the report",
    )
    parser.add_argument(
        "--mjcf", action="store_true", help="write the identified robot for MuJoCo too: learned.xml"
    )


def calibrate_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``calibrate``."""
    _add_shared(parser, "calibrated")
    add_arguments_of(
        parser,
        calibration.calibrate,
        {"unknown": {"type": names, "metavar": "A,B"}, "tracker": bool},
    )
    parser.set_defaults(task=None, test=[], empty=None)


def _add_shared(parser: ArgumentParser, done: str) -> argparse._ArgumentGroup:
    """Add logs, robot, folder of what is done, and a group of options; return the group.

    The options say how a log is to be read, see ``ImportOptions``.
    """
    parser.add_argument(
        "log",
        type=Path,
        nargs="+",
        metavar="LOG",
        help="npz, CSV, ROS bag or MCAP, or a folder that `pinadapt run` wrote; rad, m, N m, N, s",
    )
    parser.add_argument(
        "--robot",
        required=True,
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, or a name as for `init`",
    )
    add_arguments_of(parser, load, {"frame": str})
    parser.add_argument(
        "--lock",
        type=names,
        default=(),
        metavar="A,B",
        help="joints that did not move (default: those off the chain)",
    )
    add_description(parser)
    add_out(parser, f"out/ and the log's name and -{done}")
    group = parser.add_argument_group(
        "how the log is read",
        f"these options override the file beside the log: run{SUFFIX} of run.csv",
    )
    group.add_argument(
        "--columns",
        type=_signal,
        nargs="+",
        action="extend",
        metavar="SIGNAL=NAME,...",
        help="columns of t, q, v, tau, x or x_time, in the robot's order; or one name in which * "
        "stands for the joint's name or index; in a file without header numbers, such as q=2-8",
    )
    add_arguments_of(
        group,
        ImportOptions,
        {
            "joints": _joint_names,
            "rate": float,
            "repeated": REPEATED,
            "degrees": bool,
            "gear": _listed,
            "torque_gain": _listed,
            "offset": _listed,
            "gravity": _listed,
            "flip": names,
            "topic": str,
            "pose_topic": str,
            "compensated": ("nominal",),
            "mount": MOUNTS,
        },
    )
    group.add_argument(
        "--accept-doubts",
        dest="doubtful",
        action="store_true",
        default=None,
        help="identify although the torques do not fit the description; the exit status stays 2",
    )
    return group


def _signal(text: str) -> tuple[str, list[str]]:
    """Return a name and several ones: a signal and its columns.

    Raises:
        ArgumentTypeError: the equals sign or the names are missing.
    """
    name, columns = assignment(text)
    return name, names(columns)


def _bounds(text: str) -> tuple[str, list[float]]:
    """Return a joint and two bounds.

    Raises:
        ArgumentTypeError: the equals sign is missing.
        ValueError: no numbers.
    """
    name, bounds = _signal(text)
    return name, list(map(float, bounds))


def _joint_names(text: str) -> list[str] | dict[str, list[str]]:
    """Return names of joints, or a signal with them.

    Raises:
        ArgumentTypeError: there are none.
    """
    signal, colon, listed = text.partition(":")
    return {signal: names(listed)} if colon else names(text)


def _listed(text: str) -> Any:
    """Return a value, several ones, or values by name; what can be a number is one.

    Raises:
        ArgumentTypeError: an equals sign is missing.
    """
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if "=" in text:
        return {name: toml_value(value) for name, value in map(assignment, parts)}
    values = [toml_value(part) for part in parts]
    return values[0] if len(values) == 1 else values


def _import_options(options: Namespace) -> ImportOptions | None:
    """Return how the logs are to be read; None: each by the file beside it.

    Raises:
        InputError: options for several logs, of which others than the first have such a file.
    """
    said = given(options, [one.name for one in fields(ImportOptions)])
    if not said:
        return None
    if "columns" in said:
        said["columns"] = dict(said["columns"])
    logs = [*options.log, *options.test, *filter(None, [options.empty])]
    beside = [place for log in logs[1:] if (place := ImportOptions.beside(log)) is not None]
    if beside:
        raise InputError(
            f"options apply to all logs, but {beside[0]} states how one of them is read.",
            where="identify",
            hint="Write them into the files beside the logs: --write-import-options, one by one.",
        )
    return ImportOptions.of(None, logs[0]).updated(**said)


def identify(options: Namespace) -> int:
    """Estimate a robot's parameters from a log, write the outputs and print report and verdict.

    Nothing is written before the estimation is complete.
    """
    import_options = _import_options(options)
    if options.write_import_options:
        return max(_write_import_options(options, log, import_options) for log in options.log)
    folder = _place(options, "identified", FILES)
    robot = _robot(options)
    compared = {
        Path(each).name: load(each, frame=robot.frame, locked=options.lock, joint_effects=True)
        for each in options.compare
    }
    try:
        found = identify_log(
            options.log,
            robot,
            import_options=import_options,
            unknown=Unknown().with_names(options.kinematic, options.dynamic, options.joint),
            **given(options, ("test", "empty", "total_mass", "known_load")),
            mass_bounds=dict(options.mass_bounds or ()),
        )
    except TorqueMismatchError as error:
        print(error.check)
        raise
    return _write(folder, FILES, found, mjcf=options.mjcf, compared=compared)


def calibrate(options: Namespace) -> int:
    """Calibrate a robot's placements from a log, write the outputs and print the report.

    Nothing is written before the calibration is complete.
    """
    folder = _place(options, "calibrated", calibration.FILES)
    found = calibration.calibrate(
        options.log,
        _robot(options),
        import_options=_import_options(options),
        **given(options, ("unknown", "tracker")),
    )
    return _write(folder, calibration.FILES, found)


def _write(
    folder: Path,
    files: Sequence[str],
    found: Identification | calibration.Calibration,
    **options: Any,
) -> int:
    """Write what was found, print its report, and what is missing or not to be trusted."""
    missing = ""
    try:
        with one_run(folder, files) as beside:
            found.save(beside, **options)
    except ParameterError as reason:
        missing = str(reason)
    finally:
        print(found)  # even if it could not be written
    print(f"\nwritten to {folder}")
    if not found.trusted:
        print(found.verdict)
    if missing:
        print(f"INCOMPLETE: {missing}")
    return (Exit.INCOMPLETE if missing else Exit.DONE) if found.trusted else Exit.REFUSED


def _write_import_options(options: Namespace, source: Path, given: ImportOptions | None) -> int:
    """Read and check a log, print what was found, and write beside it how a log that fits is read.

    One that does not fit is only written about where its doubts are accepted.
    """
    place = place_beside(source)
    robot = _robot(options)
    import_options = ImportOptions.of(given, source)
    check = check_torques(*log_and_robot(source, robot, import_options))
    how = f"How {source.name} is read by `pinadapt identify`, as a log of {robot.name}."
    print(check)
    written = check.fits or import_options.doubtful
    if written:
        write_text(place, import_options.text([how, f"Checked: {check.verdict}"]))
    print(f"\n{'' if written else 'not '}written to {place}")
    return Exit.DONE if check.fits else Exit.REFUSED


def _place(options: Namespace, done: str, files: Sequence[str]) -> Path:
    """Return the folder of the outputs.

    Raises:
        InputError: it is not writable or contains a run, perhaps the log itself.
    """
    folder = out_folder(options, f"{options.log[0].stem or 'log'}-{done}", files)
    if any((folder / name).is_file() for name in set(RUN_FILES) - set(files)):
        raise InputError(
            "holds a run, whose files have the same names.",
            where=folder,
            hint="--out takes another place.",
        )
    return folder


def _robot(options: Namespace) -> Robot:
    """Return the robot of the options."""
    return load(
        options.robot,
        locked=options.lock,
        xacro=dict(options.xacro),
        **given(options, ("frame", "task", "mass")),
    )
