"""Figures of a run: legends, names, limits, curves, and special characters."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pinadapt.plots.figures import overlay_figure
from pinadapt.plots.style import GREY
from tests.support.loops import run

pytestmark = pytest.mark.slow


@cache
def drawn(name):
    """Return a short rollout of a robot and its figures."""
    rollout = run(name, duration=0.05)
    return rollout, rollout.plot()


def test_every_panel_has_a_legend_that_covers_no_curve():
    for figure in drawn("panda")[1]:
        figure.draw_without_rendering()
        for ax in figure.axes:
            box = ax.get_legend().get_window_extent()
            assert box.x0 >= ax.get_window_extent().x1 - 1.0
            assert box.x1 <= figure.bbox.x1 + 1.0


def test_panels_show_the_parameters_that_change_most_and_grey_what_is_not_identified():
    rollout, figures = drawn("panda")
    (inertia,) = [ax for ax in figures.parameters.axes if "inertia [kg m" in ax.get_ylabel()][:1]
    shown = [line for line in inertia.lines if line.get_linestyle() == "-"]
    changes = np.sort(
        [np.ptp(a) for n, a in zip(rollout.dynamic_names, rollout.a_d.T, strict=True) if ".I" in n]
    )
    assert np.allclose(np.sort([np.ptp(line.get_ydata()) for line in shown]), changes[-10:])
    assert "the 10 of 42 that change most" in inertia.get_legend().get_title().get_text()
    lines = [line for ax in figures.parameters.axes for line in ax.lines]
    grey = {line.get_label() for line in lines if line.get_color() == GREY} - {"_child"}
    named = {name for name in grey if not name.startswith("_")}
    assert named <= set(rollout.not_identified) and len(named) > 20
    titles = [ax.get_legend().get_title().get_text() for ax in figures.parameters.axes]
    assert "grey" not in titles[0] and "grey: not identified" in titles[3]


def test_an_overlay_has_a_curve_for_each_law_and_is_not_stretched_by_a_lost_one():
    one, _ = drawn("panda")
    lost = replace(one, law="lost", diverged=0.04, x=one.x + 1e6)
    ax = overlay_figure([one, lost]).axes[0]
    named = [text.get_text().partition(",")[0] for text in ax.get_legend().get_texts()]
    assert named == [one.law, "lost"]
    assert np.allclose(ax.lines[0].get_ydata(), 1e3 * one.distance)
    assert ax.get_ylim()[1] < 3e3 * one.distance.max()
