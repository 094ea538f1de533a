"""Figures of a run: legends, names, limits, curves, and special characters."""

import json
from dataclasses import replace
from functools import cache

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

from pinadapt.plots.figures import overlay_figure
from pinadapt.plots.style import GREY
from tests.support.chains import catalogue_robot
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


def test_torque_legends_have_names_and_limits_of_joints():
    rollout, figures = drawn("panda")
    torques, shares, _ = figures.torque.axes
    named = [text.get_text() for text in torques.get_legend().get_texts()]
    assert named[:7] == catalogue_robot("panda").joint_names
    limits = [line for line in shares.lines if line.get_linestyle() == "-."]
    assert [line.get_ydata()[0] for line in limits] == [-100.0, 100.0]
    assert np.allclose(shares.lines[6].get_ydata(), 100.0 * rollout.tau[:, 6] / 12.0)
    low, high = shares.get_ylim()
    assert low < -100.0 and high > 100.0


def test_curves_of_a_panel_differ_in_colour_or_marker():
    """But for those that the motion does not excite, which are all grey."""
    for figure in drawn("panda")[1]:
        for ax in figure.axes:
            looks = [
                (line.get_color(), line.get_marker())
                for line in ax.lines
                if line.get_marker() not in ("None", "") and line.get_color() != GREY
            ]
            assert len(set(looks)) == len(looks)


def test_every_parameter_is_in_a_panel():
    rollout, figures = drawn("panda")
    curves = [
        line.get_ydata()
        for ax in figures.parameters.axes
        for line in ax.lines
        if line.get_linestyle() == "-"
    ]
    assert len(curves) == rollout.a_k.shape[1] + rollout.a_d.shape[1]


def test_parameters_that_the_motion_does_not_excite_are_grey():
    rollout, figures = drawn("panda")
    lines = [line for ax in figures.parameters.axes for line in ax.lines]
    grey = [ax for ax in lines if ax.get_color() == GREY and ax.get_linestyle() == "-"]
    assert len(grey) == len(rollout.not_excited) > 20
    titles = [ax.get_legend().get_title().get_text() for ax in figures.parameters.axes]
    assert "grey" not in titles[0] and "grey: not excited" in titles[3]


SIGNS = "Größe $5, $x_{ </title> _机器人 \\frac"


def test_figures_are_displayed_once_with_special_characters_as_they_are(tmp_path, monkeypatch):
    """They are not kept open either."""
    import IPython.display

    shown = []
    monkeypatch.setattr(IPython.display, "display", lambda data, raw: shown.append(data))
    strange = replace(
        run("planar_2r", duration=0.01),
        title=f"{SIGNS} \udcff",
        joint_names=("_a$b", "$x^{"),
        marks=((0.005, "$"),),
    )
    named = replace(strange, kinematic_names=("_l$1", "$x_{"))
    named.plot()._ipython_display_()
    assert [list(data) for data in shown] == [["image/png"]] * 3
    pictures = [data["image/png"] for data in shown]
    assert all(each.startswith(b"\x89PNG") and len(each) > 5000 for each in pictures)
    assert pyplot.get_fignums() == [] and matplotlib.rcParams["font.size"] != 9
    named.save(tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["joint_names"] == ["_a$b", "$x^{"]


def test_joints_are_named_beside_their_torque():
    from pinadapt.plots.figures import torque_figure

    rollout = replace(run("planar_2r", duration=0.01), joint_names=("_shoulder", "el$bow$"))
    labels = [text.get_text() for text in torque_figure(rollout).axes[0].get_legend().get_texts()]
    assert labels == [" _shoulder", r"el\$bow\$"]
    assert "N m (joint1)" in str(rollout) or "N m (joint2)" in str(rollout)


def test_an_overlay_has_a_curve_for_each_law_and_is_not_stretched_by_a_lost_one():
    one, _ = drawn("panda")
    lost = replace(one, law="lost", diverged=0.04, x=one.x + 1e6)
    ax = overlay_figure([one, lost]).axes[0]
    named = [text.get_text().partition(",")[0] for text in ax.get_legend().get_texts()]
    assert named == [one.law, "lost"]
    assert np.allclose(ax.lines[0].get_ydata(), 1e3 * one.distance)
    assert ax.get_ylim()[1] < 3e3 * one.distance.max()
    assert [line.get_marker() for line in ax.lines][-1] == "x"
