"""Fixtures of the tests of identification."""

from itertools import islice

import pytest

from pinadapt.identification import identification, torque_check


@pytest.fixture
def shortened(monkeypatch):
    """Ask for online estimates at the ends and the split, and suspect few mistakes: half a fit."""
    monkeypatch.setattr(identification, "_TIMES", 2)
    mistakes = torque_check._mistakes
    # other mountings of the base, and torques without gravity
    monkeypatch.setattr(torque_check, "_mistakes", lambda *given: islice(mistakes(*given), 6))


@pytest.fixture
def offline(shortened, monkeypatch):
    """Leave the description for what would be known online, in tests of other estimates."""

    def described(estimator, motion, *_):
        estimator.a = estimator.dynamics.initial
        return {motion.t[0]: estimator}

    monkeypatch.setattr(identification, "_online", described)
