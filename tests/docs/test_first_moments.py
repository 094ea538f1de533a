"""The benchmark of the first moments."""

import pytest

from benchmarks.first_moments import measure
from benchmarks.timing import table_rows


def test_a_start_from_rest_asks_for_what_the_page_says():
    rows = table_rows("first_moments")
    assert len(rows) == 10
    for row in rows:
        assert row["at speed.lost"] is None and row["from rest.lost"] is None
        assert row["from rest.error"] < row["at speed.error"] / 9
    beside = [row["at speed.beside gravity"] / row["from rest.beside gravity"] for row in rows]
    least, *others = sorted(beside)  # the least is the TALOS arm's, near its limits
    assert least > 18 and min(others) > 45


@pytest.mark.slow
def test_the_row_of_an_arm_is_measured_again():
    (stored,) = [each for each in table_rows("first_moments") if each["robot"] == "z1"]
    again = measure("z1")
    for start in ("at speed", "from rest"):
        for key in ("effort", "beside gravity", "error"):
            assert again[start][key] == pytest.approx(stored[f"{start}.{key}"], rel=0.02)
