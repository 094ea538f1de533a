"""``pinadapt view``: a finished run, or one watched live."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..exceptions import InputError
from ..scenario.scenario import Scenario
from ..view.live import open_in_browser
from .outputs import run_scenario
from .status import status_of


def view(options: argparse.Namespace) -> int:
    """Show the animation in a folder, or run a scenario live and print its table.

    Without a display the address of what there is to see is all that is printed. Return 3 if the
    loop diverged, else 0.

    Raises:
        InputError: the folder holds no animation, or the scenario cannot be used.
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
            hint="`pinadapt run` writes one, unless it is told --no-html.",
        )
    address = page.resolve().as_uri()
    print(address)
    open_in_browser(address)
    return 0
