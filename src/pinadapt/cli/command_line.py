"""The ``pinadapt`` command: its commands, what they share, and signals that end it."""

from __future__ import annotations

import argparse
import io
import signal
import sys
import threading
import warnings
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from enum import IntEnum
from functools import partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

from .._output import check_writable, collect_seldom
from .._version import __version__
from ..exceptions import InputError, PinadaptError


class Exit(IntEnum):
    """Exit status of a command."""

    DONE = 0
    REFUSED = 2
    DIVERGED = 3
    INCOMPLETE = 4
    INTERRUPTED = 130


# Each command is a module of this folder, or shares one, see ``_SHARED``. There,
# ``COMMAND_arguments(parser)`` adds the arguments, and the function of the command's name runs it
# and returns the exit status.
_COMMANDS = {
    "demo": "run two showcase scenarios and write reports and animations",
    "init": "write a scenario for a URDF, xacro or MJCF file or a named robot",
    "excite": "find a motion that excites the unknown parameters of a robot",
    "run": "run a scenario",
    "view": "show a finished run, or run a scenario and show it live",
    "drive": "drive a real or simulated arm in real time",
    "replay": "compute the torques of a log of `drive` again, by its controller or another one",
    "tell": "send a command to a running `drive`",
    "compare": "run several laws on one scenario",
    "sweep": "run a scenario or a function with many values on all cores, as one table",
    "tune": "search gains over many cases and compare them with the defaults",
    "identify": "estimate a robot's parameters from a recorded motion, without control",
    "calibrate": "calibrate a robot's joint placements from recorded positions or poses",
    "cite": "print the BibTeX entries of what a scenario uses",
    "robots": "list the robots of the catalogue",
    "zoo": "run the robots of the catalogue with wrong models and default gains, with and without "
    "adaptation, and print one table",
}


_SHARED = {
    "replay": "drive",
    "tell": "drive",
    "view": "run",
    "cite": "run",
    "demo": "run",
    "calibrate": "identify",
    "robots": "command_line",
}
_ENDING = (signal.SIGTERM, signal.SIGHUP)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0: done; 2: the input was refused, or some outputs could not be written; 3: the closed loop
    diverged; 4: done in part, see the message; 130: interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # of a terminal without UTF-8
    if arguments is None:  # a process of its own, in which nearly all of the many objects stay
        collect_seldom()
        arguments = sys.argv[1:]
    try:
        with stopped_by_signals(), warnings.catch_warnings():
            warnings.showwarning = partial(_show_once, set())
            options = _options(arguments)
            return getattr(_module(options.command), options.command)(options)
    except KeyboardInterrupt:
        print("pinadapt: interrupted.", file=sys.stderr)
        return Exit.INTERRUPTED
    except BrokenPipeError:  # whoever reads the output has closed it
        sys.stderr.close()
        return Exit.DONE
    except (PinadaptError, OSError) as error:  # OSError: outputs that cannot be written
        print(f"pinadapt: {error}", file=sys.stderr)
        return Exit.REFUSED if isinstance(error, InputError | OSError) else Exit.DIVERGED


def _options(arguments: Sequence[str]) -> Namespace:
    """Return the parsed arguments; only the module of the chosen command is imported."""
    parser = ArgumentParser(
        prog="pinadapt", description="Adaptive control of robots whose model is wrong."
    )
    parser.add_argument("--version", action="version", version=f"pinadapt {__version__}")
    commands = parser.add_subparsers(required=True, dest="command", metavar="COMMAND")
    for name, text in _COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text)
        if name in arguments[:1]:
            getattr(_module(name), f"{name}_arguments")(command)
    return parser.parse_args(arguments)


def _module(command: str) -> ModuleType:
    return import_module(f".{_SHARED.get(command, command)}", __package__)


def robots_arguments(parser: ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def robots(options: Namespace) -> int:
    """Print the catalogue: name, number of joints, task, frame, source of the model, remark."""
    from .._output import Table  # here, because no other command needs them at once
    from ..description.catalogue import catalogue

    shown = ("name", "joints", "task", "frame", "origin", "about")
    print(Table(list(map(attrgetter(*shown), catalogue().values())), shown))
    return Exit.DONE


def _show_once(texts: set[str], message: Any, *where: Any, **more: Any) -> None:
    """Print a warning whose text is not among the texts yet, wherever in the code it comes from."""
    if (text := str(message)) not in texts:
        texts.add(text)
        print(f"pinadapt: warning: {text}", file=sys.stderr)


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Let SIGTERM, or the SIGHUP of a closed terminal, stop the work as Ctrl-C does.

    Signals that already have a handler, for example by ``nohup``, are left unchanged.
    """
    main = threading.current_thread() is threading.main_thread()
    with ExitStack() as back:
        for number in _ENDING:
            if main and signal.getsignal(number) is signal.SIG_DFL:
                back.callback(signal.signal, number, signal.SIG_DFL)
                signal.signal(number, signal.default_int_handler)
        yield


# Arguments that several commands share, and the types of arguments


def add_scenario(parser: ArgumentParser) -> None:
    """Add a scenario file and ``--set``, which overrides its keys."""
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.toml")
    add_settings(parser)


def add_settings(parser: ArgumentParser) -> None:
    """Add ``--set``."""
    parser.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="override keys of the scenario, such as simulation.duration=30.0",
    )


def add_out(parser: ArgumentParser, default: str) -> None:
    """Add ``--out``, a folder, whose default is described in words."""
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"folder to write to (default: {default})"
    )


def out_folder(options: Namespace, name: str, files: Sequence[str]) -> Path:
    """Return the folder of ``--out``, by default one of this name in ``out``, for these files.

    Raises:
        InputError: they cannot be written.
    """
    folder = options.out or Path("out") / name
    check_writable(folder, files)
    return folder


def add_out_file(parser: ArgumentParser, default: str) -> None:
    """Add ``--out``, a scenario file, and ``--force``."""
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help=f"scenario file to write (default: {default})"
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def add_description(parser: ArgumentParser) -> None:
    """Add ``--xacro`` and ``--mass``, which complete a robot description."""
    from ..robot.loading import load

    several = {"type": assignment, "action": "append", "default": [], "metavar": "NAME=VALUE"}
    add_arguments_of(parser, load, {"xacro": several, "mass": float})


def add_arguments_of(
    parser: argparse._ActionsContainer, make: Callable[..., Any], types: Mapping[str, Any]
) -> None:
    """Add an option for some arguments of a class or function, explained as in its docstring.

    Args:
        parser: of the command.
        make: the class or function.
        types: of its arguments, by name: what makes a value of a text, ``bool``, the choices, or
            options of ``add_argument``. An option that is not given is None.
    """
    from .._output import meanings  # here, because commands without such options need it not

    about = meanings(make)
    for name, kind in types.items():
        option = kind if isinstance(kind, dict) else {"type": kind}
        if isinstance(kind, tuple):
            option = {"choices": kind}
        elif kind is bool:
            option = {"action": "store_true", "default": None}
        words = about[name].replace("%", "%%")
        parser.add_argument(f"--{name.replace('_', '-')}", help=words, **option)


def given(options: Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Return the values of those of some options that are given."""
    return {name: value for name in names if (value := getattr(options, name)) is not None}


def new_file(options: Namespace, name: str) -> Path:
    """Return the scenario file of ``--out``, by default one of this name in the working directory.

    Raises:
        InputError: it exists and may not be overwritten, or cannot be written.
    """
    file = options.out or Path(f"{name}.toml")
    if file.exists() and not options.force:
        raise InputError(
            "exists already.",
            where=file,
            hint="Overwrite it by --force, or choose another file by --out.",
        )
    check_writable(file.parent, [file.name])
    return file


def names(text: str) -> list[str]:
    """Return the names in a comma-separated list, without repetitions."""
    return list(dict.fromkeys(filter(None, map(str.strip, text.split(",")))))


def word_or_names(text: str) -> str | list[str]:
    """Return ``names``, but one alone as it is: it may be a word such as "all" and no name."""
    found = names(text)
    return found[0] if len(found) == 1 else found


def assignment(text: str) -> tuple[str, str]:
    """Return name and value of ``name=value``.

    Raises:
        ArgumentTypeError: the name or the equals sign is missing.
    """
    name, equals, value = text.partition("=")
    if not (equals and name.strip()):
        raise ArgumentTypeError(f"name=value is expected, got {text}")
    return name.strip(), value


def add_processes(parser: ArgumentParser) -> None:
    """Add ``--processes``."""
    parser.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="number of processes, 0 for none besides this one (default: one per core)",
    )
