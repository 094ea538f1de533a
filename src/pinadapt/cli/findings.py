"""What the check before a run says of a scenario that was written."""

from __future__ import annotations

import warnings

from ..scenario.scenario import Scenario


def warn_of_findings(scenario: Scenario) -> None:
    """Tell what the check before a run says of a scenario."""
    found = scenario.findings()
    for finding in found:
        warnings.warn(finding, stacklevel=2)
    if not found:
        dt = scenario.tables.simulation.dt
        print(f"check before a run: {scenario.controller.law.name} suits a period of {dt:g} s.")
