"""The benchmark of the cost of unknown parameters."""

from benchmarks import price_of_ignorance
from benchmarks.price_of_ignorance import TRUTH, prices
from benchmarks.timing import table_rows


def test_the_best_adaptation_has_a_cost_of_at_most_five_after_ten_seconds():
    found = prices(table_rows("price_of_ignorance"))
    for robot in price_of_ignorance.LOADS:
        assert found["separation", robot, "natural-memory"][-1] <= 5.0


def test_every_law_is_run_with_the_true_model():
    rows = table_rows("price_of_ignorance")
    known = {(row["law"], row["robot"]) for row in rows if row["adaptation"] == TRUTH}
    assert known == {(row["law"], row["robot"]) for row in rows} and len(known) == 27
