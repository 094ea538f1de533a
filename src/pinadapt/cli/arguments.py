"""Arguments that several commands share, and the types of arguments."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Add a scenario file and ``--set``, which overrides its keys."""
    parser.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO.toml")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add ``--set``."""
    parser.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="override keys of the scenario, such as simulation.duration=30.0",
    )


def add_out(parser: argparse.ArgumentParser, default: Path | str) -> None:
    """Add ``--out``, a folder; a default that is not a path describes it in words."""
    parser.add_argument(
        "--out",
        type=Path,
        default=default if isinstance(default, Path) else None,
        metavar="DIR",
        help=f"folder to write to (default: {default})",
    )


def add_out_file(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--out``, a scenario file, and ``--force``."""
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help=f"scenario file to write (default: {default})"
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def add_unadapted(parser: argparse.ArgumentParser) -> None:
    """Add ``--unadapted``."""
    parser.add_argument(
        "--unadapted",
        action="store_true",
        help="run the same loop without adaptation as well and report its error",
    )


def add_description(parser: argparse.ArgumentParser) -> None:
    """Add ``--xacro`` and ``--mass``, which complete a robot description."""
    parser.add_argument(
        "--xacro",
        type=assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an argument of a xacro file; may be repeated",
    )
    parser.add_argument(
        "--mass",
        type=float,
        metavar="KG",
        help="total mass of a robot that has links without inertia in its description",
    )


def add_seed(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--seed``."""
    parser.add_argument(
        "--seed",
        type=not_negative,
        default=0,
        metavar="N",
        help=f"random seed of {what} (default: %(default)s)",
    )


def names(text: str) -> list[str]:
    """Return the names in a comma-separated list, without repetitions.

    Raises:
        ArgumentTypeError: the list is empty.
    """
    found = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        raise argparse.ArgumentTypeError("at least one name is expected")
    return found


def assignment(text: str) -> tuple[str, str]:
    """Return name and value of ``name=value``.

    Raises:
        ArgumentTypeError: the name or the equals sign is missing.
    """
    name, equals, value = text.partition("=")
    if not (equals and name.strip()):
        raise argparse.ArgumentTypeError(f"name=value is expected, got {text}")
    return name.strip(), value


def not_negative(text: str) -> int:
    """Return an integer of at least 0.

    Raises:
        ArgumentTypeError: it is negative or not an integer.
    """
    return _integer(text, least=0)


def positive(text: str) -> int:
    """Return an integer of at least 1.

    Raises:
        ArgumentTypeError: it is smaller or not an integer.
    """
    return _integer(text, least=1)


def _integer(text: str, *, least: int) -> int:
    number = int(text) if text.strip().lstrip("+-").isdecimal() else least - 1
    if number < least:
        raise argparse.ArgumentTypeError(
            f"a whole number of at least {least} is expected, got {text}"
        )
    return number
