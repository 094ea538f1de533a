"""``pinadapt view``: show a finished run, or run a scenario live."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..exceptions import InputError
from ..scenario.scenario import Scenario
from ..view.live import open_in_browser
from .arguments import add_settings
from .command_line import status_of
from .outputs import run_scenario


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "scenario",
        type=Path,
        nargs="?",
        metavar="DIR|SCENARIO.toml",
        help="a folder that `pinadapt run` wrote, or a scenario to run and watch; nothing is "
        "written",
    )
    add_settings(parser)


def view(options: argparse.Namespace) -> int:
    """Show the animation in a folder, or run a scenario live and print its table.

    The address of the page is printed; without a display, nothing else happens. Return 3 if the
    loop diverged, else 0.

    Raises:
        InputError: the folder contains no animation, or the scenario cannot be used.
    """
    if options.scenario.is_dir():
        return _show(options.scenario)
    scenario = Scenario.read(options.scenario, options.set)
    rollout = run_scenario(scenario, live=True)
    print(rollout)
    return status_of(rollout)


def _show(folder: Path) -> int:
    page = folder / "animation.html"
    if not page.is_file():
        raise InputError(
            "holds no animation.html.",
            where=str(folder),
            hint="`pinadapt run` writes one unless --no-html is given.",
        )
    address = page.resolve().as_uri()
    print(address)
    open_in_browser(address)
    return 0
