"""The ``pinadapt`` command."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from .._version import __version__
from ..exceptions import InputError, PinadaptError
from ..laws import LAWS

DONE, REFUSED, DIVERGED = 0, 2, 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status: 0 done, 2 the input was refused, 3 the closed loop diverged."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if (
        getattr(options, "scenario", options) is None
    ):  # ``--set key=value scenario.toml`` takes the file for a setting
        files = [text for text in options.set if "=" not in text]
        if len(files) != 1:
            parser.error("exactly one SCENARIO.toml is required")
        options.scenario = Path(files[0])
        options.set.remove(files[0])
    shown, warnings.showwarning = warnings.showwarning, _show_warning
    try:
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except InputError as error:
        print(f"pinadapt: {error}", file=sys.stderr)
        return REFUSED
    except PinadaptError as error:
        print(f"pinadapt: {error}", file=sys.stderr)
        return DIVERGED
    except BrokenPipeError:  # the reader of our output went away
        sys.stderr.close()
        return DONE
    except OSError as error:  # an output folder that cannot be made or written
        print(f"pinadapt: {error}", file=sys.stderr)
        return REFUSED
    finally:
        warnings.showwarning = shown


def _show_warning(
    message: Any, category: Any, filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    print(f"pinadapt: warning: {message}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    from .compare import compare
    from .demo import demo
    from .init import init
    from .robots import robots
    from .run import run
    from .zoo import zoo

    parser = argparse.ArgumentParser(
        prog="pinadapt", description="Adaptive control of robots whose model is wrong."
    )
    parser.add_argument("--version", action="version", version=f"pinadapt {__version__}")
    add = partial(_command, parser.add_subparsers(required=True, metavar="COMMAND"))
    command = add("demo", demo, "two showcase scenarios, with report and animation")
    command.add_argument(
        "--out",
        type=Path,
        default=Path("out/demo"),
        metavar="DIR",
        help="where to write (default: %(default)s)",
    )
    command = add("init", init, "write a scenario for a URDF or a robot of the catalogue")
    command.add_argument(
        "source", metavar="ROBOT", help="URDF file, or a name that `pinadapt robots` lists"
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
    command.add_argument("--force", action="store_true", help="overwrite the file")
    command = add("run", run, "run one scenario")
    _scenario_arguments(command)
    command.add_argument("--no-html", action="store_true", help="write no animation")
    command = add("compare", compare, "run the laws side by side on one scenario")
    _scenario_arguments(command)
    command.add_argument(
        "--laws", type=_names, metavar="A,B", help=f"of {', '.join(LAWS)} (default: all)"
    )
    add("robots", robots, "list the robots of the catalogue")
    about = "run chains of the catalogue with wrong models and default gains, adapted and not, and print one table"
    _zoo_arguments(add("zoo", zoo, about))
    return parser


def _command(
    commands: Any, name: str, function: Callable[[argparse.Namespace], int], text: str
) -> argparse.ArgumentParser:
    """Add a command that calls a function, and return its parser."""
    command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
    command.set_defaults(command=function)
    return command


def _names(text: str) -> list[str]:
    """Return the names in a list with commas, each once.

    Raises:
        ArgumentTypeError: there are none.
    """
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise argparse.ArgumentTypeError("at least one name is expected")
    return names


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


def _zoo_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--robots",
        type=_names,
        metavar="A,B",
        help="names that `pinadapt robots` lists (default: all)",
    )
    command.add_argument(
        "--law",
        choices=[name for name, law in LAWS.items() if law.adapts],
        default="adaptive-jacobian",
        metavar="NAME",
        help="one that adapts: %(choices)s (default: %(default)s)",
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
    command.add_argument(
        "--out",
        type=Path,
        default=Path("out/zoo"),
        metavar="DIR",
        help="where to write (default: %(default)s)",
    )


def _scenario_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO.toml")
    command.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="override a dotted key",
    )
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where to write (default: out/ and the scenario's name)",
    )
