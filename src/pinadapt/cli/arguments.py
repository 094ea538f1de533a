"""What each command of ``pinadapt`` takes."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from .._version import __version__
from .command import Command


def parser() -> argparse.ArgumentParser:
    """Return the parser; the command's name is left in ``command``."""
    whole = argparse.ArgumentParser(
        prog="pinadapt", description="Adaptive control of robots whose model is wrong."
    )
    whole.add_argument("--version", action="version", version=f"pinadapt {__version__}")
    commands = whole.add_subparsers(
        required=True, dest="command", metavar="COMMAND", parser_class=Command
    )
    for name, (text, fill) in _COMMANDS.items():
        commands.add_parser(name, help=text, description=text).fill = fill
    return whole


def _demo(command: argparse.ArgumentParser) -> None:
    _add_out(command, default=Path("out/demo"))


def _init(command: argparse.ArgumentParser) -> None:
    from ..laws import DEFAULT, LAWS

    command.add_argument(
        "source",
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, a name that `pinadapt robots` lists, or one of the package "
        "robot_descriptions",
    )
    command.add_argument(
        "--frame",
        metavar="LINK",
        help="task frame (default: the likeliest link at the robot's end)",
    )
    command.add_argument(
        "--task",
        metavar="TASK",
        help="xyz, xy, xz, yz or pose (default: xyz, or a plane for a chain that cannot)",
    )
    command.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write (default: the robot's name and .toml)",
    )
    command.add_argument(
        "--law",
        choices=[name for name, law in LAWS.items() if law.adapts and not law.joint_space],
        default=DEFAULT,
        metavar="NAME",
        help="one of the frame that adapts: %(choices)s (default: %(default)s)",
    )
    command.add_argument("--force", action="store_true", help="overwrite the file")
    command.add_argument(
        "--xacro",
        type=_assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an argument of a xacro file; as often as there are any",
    )
    command.add_argument(
        "--mass",
        type=float,
        metavar="KG",
        help="what the whole robot weighs, where links are described without inertia",
    )


def _excite(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "source",
        metavar="ROBOT|SCENARIO.toml",
        help="as for init; or a scenario, whose robot and table [unknown] are taken",
    )
    command.add_argument(
        "--unknown",
        type=_names,
        metavar="A,B",
        help="all, payload (the last body), none or joint names; tool and base (default: all)",
    )
    command.add_argument(
        "--joint",
        type=_names,
        metavar="A,B",
        help="of armature, viscous, coulomb; all or none (default: all)",
    )
    command.add_argument(
        "--frame",
        metavar="LINK",
        help="where the chain ends (default: the likeliest link at the robot's end)",
    )
    for option, default, unit, text in (
        ("duration", 10.0, "S", "of the motion (default: %(default)s)"),
        ("excursion", None, "RAD", "how far joints may go from home (default: a quarter turn)"),
        ("load", None, "KG", "the heaviest to be borne (default: a tenth of the robot's mass)"),
    ):
        command.add_argument(f"--{option}", type=float, default=default, metavar=unit, help=text)
    command.add_argument(
        "--seed",
        type=partial(_whole_number, least=0),
        default=0,
        metavar="N",
        help="of the search (default: %(default)s)",
    )
    command.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="scenario to write (default: the robot's name and _excited.toml)",
    )
    command.add_argument("--force", action="store_true", help="overwrite the file")


def _run(command: argparse.ArgumentParser) -> None:
    _add_scenario(command)
    command.add_argument("--no-html", action="store_true", help="write no animation")
    command.add_argument(
        "--live", action="store_true", help="show it in a browser meanwhile, at most in real time"
    )
    _add_unadapted(command)


def _view(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "scenario",
        type=Path,
        nargs="?",
        metavar="DIR|SCENARIO.toml",
        help="where `pinadapt run` wrote, or what to run and watch; nothing is written then",
    )
    _add_settings(command)


def _compare(command: argparse.ArgumentParser) -> None:
    from ..laws import LAWS

    _add_scenario(command)
    command.add_argument(
        "--laws",
        type=_names,
        metavar="A,B",
        help=f"of {', '.join(LAWS)} (default: those for the task)",
    )
    _add_unadapted(command)


def _cite(command: argparse.ArgumentParser) -> None:
    _add_file(command)


def _identify(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "log",
        type=Path,
        metavar="LOG",
        help="npz, CSV, ROS bag or MCAP, or a folder that `pinadapt run` wrote; rad, m, N m, N, s",
    )
    command.add_argument(
        "--robot",
        required=True,
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, a name as for `init`, or a scenario: its believed robot",
    )
    command.add_argument("--frame", metavar="LINK", help="task frame (default: as for `init`)")
    command.add_argument("--task", metavar="TASK", help="xyz, xy, xz, yz, pose or joint")
    for option, what in (
        ("--lock", "joints that did not move (default: those off the chain)"),
        (
            "--kinematic",
            "unknown translations: tool, base, joint names (default: tool if x is there)",
        ),
        ("--dynamic", "unknown bodies: all, payload, none or joint names (default: all)"),
        ("--joint", "unknown of the joints: all, none, armature, viscous, coulomb (default: all)"),
    ):
        command.add_argument(option, type=_names, metavar="A,B", help=what)
    command.add_argument(
        "--adaptation",
        choices=(
            "natural-memory",
            "natural-composite",
            "composite-memory",
            "composite",
            "least-squares",
        ),
        default="natural-memory",
        help="of the online estimator (default: %(default)s)",
    )
    command.add_argument(
        "--compensated",
        choices=("nominal",),
        help="the log's torques leave out gravity, which the arm adds by itself",
    )
    _log_options(command)
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where to write (default: out/ and the log's name and -identified)",
    )


def _log_options(command: argparse.ArgumentParser) -> None:
    """Add what says where in a file, and in which units, things are."""
    command.add_argument(
        "--columns",
        type=_signal,
        nargs="+",
        action="extend",
        default=[],
        metavar="SIGNAL=NAME,...",
        help="columns of t, q, v, tau, x or x_time, in the robot's order, or one name with a * for "
        "each joint's name or index",
    )
    command.add_argument("--degrees", action="store_true", help="angles are in degrees")
    command.add_argument("--topic", metavar="NAME", help="of a bag's joint states")
    command.add_argument(
        "--pose-topic", metavar="NAME", help="of a bag's PointStamped, PoseStamped or Transform..."
    )
    command.add_argument("--mass", type=float, metavar="KG", help="as for `init`")
    command.add_argument(
        "--xacro", type=_assignment, action="append", default=[], metavar="NAME=VALUE",
        help="as for `init`",
    )  # fmt: skip


def _robots(command: argparse.ArgumentParser) -> None:
    """Add nothing."""


def _zoo(command: argparse.ArgumentParser) -> None:
    from ..laws import DEFAULT, LAWS

    command.add_argument(
        "--robots",
        type=_names,
        metavar="A,B",
        help="names that `pinadapt robots` lists (default: those for the task)",
    )
    command.add_argument(
        "--law",
        choices=[
            name
            for name, law in LAWS.items()
            if law.adapts and not (law.joint_space or law.set_point)
        ],
        default=DEFAULT,
        metavar="NAME",
        help="one that adapts: %(choices)s (default: %(default)s)",
    )
    command.add_argument(
        "--task",
        choices=("position", "pose"),
        default="position",
        help="the position on a circle, or the pose of chains of six and more joints, the tool "
        "swinging meanwhile (default: %(default)s)",
    )
    command.add_argument(
        "--seed",
        type=partial(_whole_number, least=0),
        default=0,
        metavar="N",
        help="of friction, tools and errors (default: %(default)s)",
    )
    command.add_argument(
        "--processes",
        type=partial(_whole_number, least=1),
        metavar="N",
        help="how many at once (default: one a core)",
    )
    _add_out(command, default=Path("out/zoo"))


_COMMANDS = {
    "demo": ("two showcase scenarios, with report and animation", _demo),
    "init": ("write a scenario for a URDF, xacro, MJCF or a named robot", _init),
    "excite": ("find a motion that tells unknown parameters apart", _excite),
    "run": ("run one scenario", _run),
    "view": ("show a finished run, or run a scenario and show it meanwhile", _view),
    "compare": ("run the laws side by side on one scenario", _compare),
    "identify": ("learn a robot's parameters from a recorded motion, without control", _identify),
    "cite": ("print the BibTeX entries of what a scenario uses", _cite),
    "robots": ("list the robots of the catalogue", _robots),
    "zoo": (
        "run chains of the catalogue with wrong models and default gains, adapted and not, "
        "and print one table",
        _zoo,
    ),
}


def _add_scenario(command: argparse.ArgumentParser) -> None:
    _add_file(command)
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where to write (default: out/ and the scenario's name)",
    )


def _add_file(command: argparse.ArgumentParser) -> None:
    command.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO.toml")
    _add_settings(command)


def _add_settings(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="override a dotted key",
    )


def _add_unadapted(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--unadapted",
        action="store_true",
        help="run the same loop without adaptation as well, to tell its error beside",
    )


def _add_out(command: argparse.ArgumentParser, default: Path) -> None:
    command.add_argument(
        "--out",
        type=Path,
        default=default,
        metavar="DIR",
        help="where to write (default: %(default)s)",
    )


def _names(text: str) -> list[str]:
    """Return the names in a list with commas, each once.

    Raises:
        ArgumentTypeError: there are none.
    """
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise argparse.ArgumentTypeError("at least one name is expected")
    return names


def _signal(text: str) -> tuple[str, list[str]]:
    """Return a signal and the names of its columns.

    Raises:
        ArgumentTypeError: no equals sign, or no names.
    """
    name, columns = _assignment(text)
    return name, _names(columns)


def _assignment(text: str) -> tuple[str, str]:
    """Return name and value.

    Raises:
        ArgumentTypeError: there is no name, or no equals sign.
    """
    name, equals, value = text.partition("=")
    if not (equals and name.strip()):
        raise argparse.ArgumentTypeError(f"name=value is expected, got {text}")
    return name.strip(), value


def _whole_number(text: str, *, least: int) -> int:
    """Return a whole number.

    Raises:
        ArgumentTypeError: it is none, or too small.
    """
    number = int(text) if text.strip().lstrip("+-").isdecimal() else least - 1
    if number < least:
        raise argparse.ArgumentTypeError(
            f"a whole number of at least {least} is expected, got {text}"
        )
    return number
