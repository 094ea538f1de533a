"""The benchmark of the price of ignorance."""

import pytest

import pinadapt as pa
from benchmarks import price_of_ignorance
from benchmarks.price_of_ignorance import TRUTH, column, measure, prices, report
from benchmarks.timing import table_rows


def test_the_best_adaptation_has_a_price_of_at_most_five_after_ten_seconds():
    after = price_of_ignorance.AFTER.index(10.0)
    found = prices(table_rows("price_of_ignorance"))
    for robot in price_of_ignorance.LOADS:
        assert found["separation", robot, "natural-memory"][after] <= 5.0


def test_every_law_is_run_with_the_true_model():
    rows = table_rows("price_of_ignorance")
    known = {(row["law"], row["robot"]) for row in rows if row["adaptation"] == TRUTH}
    assert known == {(row["law"], row["robot"]) for row in rows} and len(known) == 27


@pytest.mark.parametrize("law", ["separation", "slotine-li"])
def test_prices_are_errors_relative_to_those_with_the_true_model(law, monkeypatch):
    monkeypatch.setattr(price_of_ignorance, "AFTER", (0.1, 0.2))
    rows = [
        {"robot": "ur5", "law": law, "adaptation": kind} | measure("ur5", law, kind)
        for kind in (TRUTH, "natural")
    ]
    truth, natural = prices(rows).values()
    assert truth == pytest.approx([1e6 * rows[0][column(end)] for end in (0.1, 0.2)])
    assert natural[1] == rows[1][column(0.2)] / rows[0][column(0.2)] > 2.0
    assert f"| `{law}` |" in report(rows)
    assert pa.laws.LAWS[law].joint_space == (law == "slotine-li")
