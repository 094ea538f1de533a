"""``pinadapt cite``: what to cite for a scenario."""

from __future__ import annotations

import argparse

from ..citation import citation
from ..scenario.scenario import Scenario


def cite(options: argparse.Namespace) -> int:
    """Print the BibTeX entries of what a scenario's controller uses."""
    print(citation(Scenario.read(options.scenario, options.set).controller), end="")
    return 0
