"""Fixtures of the tests of identification."""

from itertools import islice

import pytest

from pinadapt.identification import report, torque_check


@pytest.fixture
def shortened(monkeypatch):
    """Ask for online estimates at the ends and the split, and suspect few mistakes: half a fit."""
    monkeypatch.setattr(report, "_TIMES", 2)
    mistakes = torque_check._mistakes
    # other mountings of the base, and torques without gravity
    monkeypatch.setattr(torque_check, "_mistakes", lambda *given: islice(mistakes(*given), 6))
