"""The ``pinadapt`` command."""

from __future__ import annotations

import argparse
import io
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from ..exceptions import InputError, PinadaptError
from .arguments import parser
from .status import DIVERGED, DONE, INTERRUPTED, REFUSED, stopped_by_signals


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0: done, 2: the input was refused, or the outputs could not all be written, 3: the closed loop
    diverged, 130: interrupted.
    """
    _degrade_what_cannot_be_shown()
    options = _options(arguments)
    shown, warnings.showwarning = warnings.showwarning, _show_warning
    try:
        with stopped_by_signals():
            return _command(options.command)(options)
    except InputError as error:
        print(f"pinadapt: {error}", file=sys.stderr)
        return REFUSED
    except PinadaptError as error:
        print(f"pinadapt: {error}", file=sys.stderr)
        return DIVERGED
    except KeyboardInterrupt:
        print("pinadapt: interrupted.", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output has ended
        sys.stderr.close()
        return DONE
    except OSError as error:  # outputs that cannot be written
        print(f"pinadapt: {error}", file=sys.stderr)
        return REFUSED
    finally:
        warnings.showwarning = shown


def _degrade_what_cannot_be_shown() -> None:
    """Let a terminal without UTF-8 show a question mark for what it does not know."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed arguments; in ``--set key=value scenario.toml`` the file is no setting."""
    commands = parser()
    options = commands.parse_args(arguments)
    if getattr(options, "scenario", options) is None:
        files = [text for text in options.set if "=" not in text]
        if len(files) != 1:
            commands.error("exactly one SCENARIO.toml is required")
        options.scenario = Path(files[0])
        options.set.remove(files[0])
    return options


def _command(name: str) -> Callable[[argparse.Namespace], int]:
    """Return the function of a command; the modules of the others are not imported."""
    command: Callable[[argparse.Namespace], int] = getattr(
        import_module(f".{name}", __package__), name
    )
    return command


def _show_warning(
    message: Any, category: Any, filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    print(f"pinadapt: warning: {message}", file=sys.stderr)
