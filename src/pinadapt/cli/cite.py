"""``pinadapt cite``: the BibTeX entries for a scenario."""

from __future__ import annotations

import argparse

from ..citation import citation
from ..scenario.scenario import Scenario
from .arguments import add_scenario


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)


def cite(options: argparse.Namespace) -> int:
    """Print the BibTeX entries of what a scenario's controller uses."""
    print(citation(Scenario.read(options.scenario, options.set).controller), end="")
    return 0
