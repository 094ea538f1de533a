"""Gains by search: the verdict against the defaults, and what is refused."""

import json

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.cli.tune import Judged, searched, verdict
from pinadapt.sweep import Plan
from pinadapt.sweep.sweep_report import percentile, rate

CASES = """
function = "tests.support.swept:valley"
path = "."
samples = 30
[vary]
place = "normal(2.0, 0.1)"
"""


def judged(errors):
    errors = np.asarray(errors, float)
    value = percentile(errors, 0.9).value
    value = value if np.isfinite(value) else 1e6 * (1.0 + np.isinf(errors).mean())
    return Judged({}, value, errors, rate(np.isfinite(errors)))


def test_gains_are_better_only_where_chance_does_not_explain_it():
    rng = np.random.default_rng(0)
    errors = rng.lognormal(size=20)
    for found, better in (
        (0.5 * errors, True),
        (0.97 * errors, False),  # always better, by too little
        (2.0 * errors, False),
        (errors * np.exp(rng.normal(0.0, 1.0, 20)), False),  # better here, worse there
        (errors, False),
    ):
        words, answer = verdict(judged(errors), judged(found))
        assert answer == better, words
        assert words.startswith("The gains found are better" if better else "The defaults are as")
    assert "on other seeds" in words


def test_lost_cases_count_first():
    errors = np.ones(20)
    worse, better = errors.copy(), errors.copy()
    worse[:4], better[:4] = np.inf, 0.1
    words, answer = verdict(judged(errors), judged(np.where(np.isinf(worse), np.inf, 0.1)))
    assert not answer and "4 more cases are lost" in words
    words, answer = verdict(judged(worse), judged(errors))
    assert answer and "4 cases fewer are lost" in words


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        ([], "no gain is searched"),
        (["gain=normal(1, 2)"], "one uniform, loguniform or choice"),
        (["gain=uniform([1, 2], [3, 4])"], "one uniform, loguniform or choice"),
        (["place=uniform(1, 2)"], "varied by the sweep already"),
        (["gain"], "expected key=value"),
    ],
)
def test_invalid_searches_are_refused(gain, words, tmp_path):
    (tmp_path / "cases.toml").write_text(CASES)
    with pytest.raises(pa.InputError, match=words):
        searched(gain, Plan.read(tmp_path / "cases.toml"))


def test_a_gain_of_a_scenario_is_checked_before_anything_runs(tmp_path):
    (tmp_path / "s.toml").write_text('[robot]\nsource = "planar_2r"\n')
    plan = Plan.read(tmp_path / "s.toml", ["truth.payload.mass=[0.1]"])
    assert list(searched(["controller.alpha=loguniform(1, 10)"], plan)) == ["controller.alpha"]
    with pytest.raises(pa.InputError, match="Did you mean 'alpha'"):
        searched(["controller.alhpa=loguniform(1, 10)"], plan)


def test_a_search_finds_the_minimum_and_reports_it(tmp_path, capsys):
    """The result is the distance of a gain from the place, plus a tenth; the default gain is 1."""
    pytest.importorskip("optuna")
    (tmp_path / "cases.toml").write_text(CASES)
    out = ["--processes", "0", "--objective", "distance", "--out", str(tmp_path)]
    arguments = ["tune", str(tmp_path / "cases.toml"), *out, "--trials", "25"]
    arguments += ["--validation", "40"]
    assert main([*arguments, "--gain", "gain=uniform(0.0, 4.0)"]) == 0
    found = json.loads((tmp_path / "tune.json").read_text())
    assert found["better"] and found["gains"]["gain"] == pytest.approx(2.0, abs=0.2)
    assert found["cases"] == {"search": 30, "validation": 40}
    assert found["success"]["best"]["total"] == found["success"]["default"]["total"] == 40
    assert len(found["trials"]) == 25 and found["search"]["best"] == min(
        each["objective"] for each in found["trials"]
    )
    assert "The gains found are better" in capsys.readouterr().out
    assert main([*arguments, "--gain", "gain=uniform(0.9, 1.1)"]) == 0
    found = json.loads((tmp_path / "tune.json").read_text())
    assert not found["better"] and "The defaults are as good" in capsys.readouterr().out


def test_without_optuna_the_error_names_the_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "optuna", None)
    (tmp_path / "cases.toml").write_text(CASES)
    arguments = ["tune", str(tmp_path / "cases.toml"), "--gain", "gain=uniform(0, 4)"]
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    assert "pip install 'pinadapt[tune]'" in capsys.readouterr().err
