"""Fixtures of all tests."""

import pytest


@pytest.fixture
def blank_pictures(monkeypatch):
    """Leave pictures blank, in tests of what is written where and not of what it shows."""
    from pinadapt.plots.figures import Figures
    from pinadapt.plots.style import Picture

    blank = Picture(figsize=(0.1, 0.1))
    png, figures = blank.png(), Figures(*[blank] * len(Figures._fields))
    monkeypatch.setattr(Figures, "of", lambda run: figures)
    monkeypatch.setattr(Picture, "png", lambda self, dpi=100: png)
