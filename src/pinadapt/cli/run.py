"""``pinadapt run``: one scenario from file to report."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..rollout.rollout import Rollout
from ..rollout.summary import sheet
from ..scenario.scenario import Scenario
from .outputs import check_place, run_scenario, write_run
from .status import status_of


def run(options: argparse.Namespace) -> int:
    """Run a scenario, write its outputs, print its table and in the last line its verdict.

    Return 3 if the loop diverged, 130 if it was interrupted, else 0.
    """
    scenario = Scenario.read(options.scenario, options.set)
    without = unadapted(options) if options.unadapted else None
    folder = check_place(options.out or Path("out") / options.scenario.stem)
    rollout = run_beside(scenario, without, live=options.live)
    try:
        write_run(rollout, folder, html=not options.no_html)
    finally:
        print(sheet(rollout))  # what the disk does not keep, the terminal shows
    print(f"\nwritten to {folder}\n\n{rollout.verdict}")
    return status_of(rollout)


def unadapted(options: argparse.Namespace, *settings: str) -> Scenario:
    """Return the scenario of the options with further settings, and without adaptation."""
    return Scenario.read(
        options.scenario, [*options.set, *settings, 'controller.adaptation="none"']
    )


def run_beside(scenario: Scenario, without: Scenario | None, *, live: bool = False) -> Rollout:
    """Return the rollout of a scenario, which knows the error of the same loop unadapted, if given.

    The latter runs first; if it is interrupted, it is the one that is returned.
    """
    if without is None:
        return run_scenario(scenario, live=live)
    first = run_scenario(without)
    if first.interrupted is not None:
        return first
    return replace(run_scenario(scenario, live=live), unadapted=first.summary()["max_error_last"])
