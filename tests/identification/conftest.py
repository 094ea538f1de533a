"""Fixtures of the tests of identification."""

import pytest


@pytest.fixture
def few_online_estimates(monkeypatch):
    """Ask for online estimates at the ends and at the split alone, half of the time of a fit."""
    monkeypatch.setattr("pinadapt.identification.identification._TIMES", 2)
