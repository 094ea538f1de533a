"""Gains by search: the verdict against the defaults, and what is refused."""

import json

import numpy as np
import pytest

from pinadapt.cli.command_line import main
from pinadapt.sweep.sweep_report import percentile, rate
from pinadapt.sweep.tune import Judged, verdict

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
    worse = errors.copy()
    better = errors.copy()
    worse[:4], better[:4] = np.inf, 0.1
    words, answer = verdict(judged(errors), judged(np.where(np.isinf(worse), np.inf, 0.1)))
    assert not answer and "4 more cases are lost" in words
    words, answer = verdict(judged(worse), judged(errors))
    assert answer and "4 cases fewer are lost" in words


def test_a_search_finds_the_minimum_and_reports_it(tmp_path, capsys):
    """The result is the distance of a gain from the place, plus a tenth; the default gain is 1."""
    pytest.importorskip("optuna")
    (tmp_path / "cases.toml").write_text(CASES)
    out = ["--processes", "0", "--objective", "distance", "--out", str(tmp_path)]
    arguments = ["tune", str(tmp_path / "cases.toml"), *out, "--trials", "25"]
    assert main([*arguments, "--validation", "40", "--gain", "gain=uniform(0.0, 4.0)"]) == 0
    found = json.loads((tmp_path / "tune.json").read_text())
    assert found["better"] and found["gains"]["gain"] == pytest.approx(2.0, abs=0.2)
    assert found["cases"] == {"search": 30, "validation": 40}
    assert found["success"]["best"]["total"] == found["success"]["default"]["total"] == 40
    assert len(found["trials"]) == 25 and found["search"]["best"] == min(
        each["objective"] for each in found["trials"]
    )
    assert "The gains found are better" in capsys.readouterr().out
