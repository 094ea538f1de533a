"""The benchmark of the price of ignorance, and its page."""

import json

import pytest

import pinadapt as pa
from benchmarks import price_of_ignorance
from benchmarks.price_of_ignorance import TRUTH, Run, measured, report, rows, runs
from tests.support.paths import ROOT


def test_the_page_has_the_measured_table():
    table = json.loads((ROOT / "benchmarks" / "price_of_ignorance.json").read_text())["rows"]
    assert report(table) in (ROOT / "docs" / "price.md").read_text()


def test_the_best_adaptation_has_a_price_of_at_most_five_after_ten_seconds():
    table = json.loads((ROOT / "benchmarks" / "price_of_ignorance.json").read_text())["rows"]
    after = price_of_ignorance.AFTER.index(10.0)
    prices = {row["name"]: row["price"][after] for row in table if row["law"] == "separation"}
    for robot in price_of_ignorance.LOADS:
        assert prices[f"separation, {robot}, natural-memory"] <= 5.0


def test_every_law_is_run_with_the_true_model():
    planned = runs(["separation", "craig"], ["ur5"])
    assert [run.law for run in planned if run.adaptation == TRUTH] == ["separation", "craig"]
    assert len(planned) == len(set(planned)) == 8 + 3


@pytest.mark.parametrize("law", ["separation", "slotine-li"])
def test_prices_are_errors_relative_to_those_with_the_true_model(law, monkeypatch):
    monkeypatch.setattr(price_of_ignorance, "AFTER", (0.1, 0.2))
    found = {run: measured(run) for kind in (TRUTH, "natural") for run in [Run("ur5", law, kind)]}
    truth, natural = rows(found)
    assert truth["price"] == [1.0, 1.0] and natural["unit"] == (
        "rad" if pa.laws.LAWS[law].joint_space else "m"
    )
    assert natural["price"][1] == natural["error"][1] / truth["error"][1] > 2.0
    assert "| `separation` |" in report([truth]) or law != "separation"
