"""``pinadapt run``: one scenario from file to report."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..rollout.rollout import Rollout
from ..scenario.scenario import Scenario
from .progress import samples_bar


def run(options: argparse.Namespace) -> int:
    """Run a scenario, print its table, write its outputs; return 3 if the loop diverged, else 0."""
    scenario = Scenario.read(options.scenario, options.set)
    folder = options.out or Path("out") / options.scenario.stem
    rollout = run_and_write(scenario, folder, html=not options.no_html, live=options.live)
    print(rollout)
    print(f"\nwritten to {folder}")
    return 0 if rollout.diverged is None else 3


def run_and_write(scenario: Scenario, folder: Path, *, html: bool, live: bool = False) -> Rollout:
    """Run a scenario and write all that the interface promises into a folder."""
    rollout = scenario.run(samples_bar(scenario.title), view=live)
    rollout.save(folder)
    rollout.plot(folder)
    if html:
        rollout.animate().save(folder / "animation.html")
    return rollout
