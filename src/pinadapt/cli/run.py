"""``pinadapt run``: run a scenario and write its outputs."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..rollout.rollout import Rollout
from ..rollout.summary import sheet
from ..scenario.scenario import Scenario
from .arguments import add_out, add_scenario, add_unadapted
from .command_line import status_of
from .outputs import check_place, run_scenario, write_run


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)
    add_out(parser, "out/ and the scenario's name")
    parser.add_argument("--no-html", action="store_true", help="write no animation")
    parser.add_argument(
        "--live", action="store_true", help="show the run in a browser, at most in real time"
    )
    add_unadapted(parser)


def run(options: argparse.Namespace) -> int:
    """Run a scenario, write its outputs, print its table and, as the last line, its verdict.

    Return 3 if the loop diverged, 130 if it was interrupted, else 0.
    """
    scenario = Scenario.read(options.scenario, options.set)
    without = unadapted(options) if options.unadapted else None
    folder = check_place(options.out or Path("out") / options.scenario.stem)
    rollout = run_beside(scenario, without, live=options.live)
    try:
        write_run(rollout, folder, html=not options.no_html)
    finally:
        print(sheet(rollout))  # even if it could not be written
    print(f"\nwritten to {folder}\n\n{rollout.verdict}")
    return status_of(rollout)


def unadapted(options: argparse.Namespace, *settings: str) -> Scenario:
    """Return the scenario of the options with further settings and without adaptation."""
    return Scenario.read(
        options.scenario, [*options.set, *settings, 'controller.adaptation="none"']
    )


def run_beside(scenario: Scenario, without: Scenario | None, *, live: bool = False) -> Rollout:
    """Return the rollout of a scenario, with the error of the unadapted scenario if one is given.

    The unadapted one runs first; if it is interrupted, its rollout is returned.
    """
    if without is None:
        return run_scenario(scenario, live=live)
    first = run_scenario(without)
    if first.interrupted is not None:
        return first
    return replace(run_scenario(scenario, live=live), unadapted=first.summary()["max_error_last"])
