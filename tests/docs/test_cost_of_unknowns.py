"""The benchmark of the cost of unknown parameters."""

from benchmarks.cost_of_unknowns import LOADS, TRUTH, prices
from benchmarks.shared import table_rows


def test_the_best_adaptation_costs_at_most_five_times_the_error_of_the_true_model():
    found = prices(table_rows("cost_of_unknowns"))  # every law was run with the true model
    assert all(price == 1.0 for (*_, kind), price in found.items() if kind == TRUTH)
    assert len(found) == 81
    for robot in LOADS:
        assert found["separation", robot, "natural-memory"] <= 5.0
