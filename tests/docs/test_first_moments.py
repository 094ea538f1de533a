"""The benchmark of the first moments, and its table on the page of motions."""

import json

import pytest

from benchmarks.first_moments import FILE, row, table
from tests.support.paths import ROOT


def measured():
    """Return the rows of the file."""
    return json.loads(FILE.read_text())["rows"]


def test_the_page_has_the_measured_table():
    assert table(measured()) in (ROOT / "docs" / "motions.md").read_text()
    assert len(measured()) == 10


def test_a_start_from_rest_asks_for_what_the_page_says():
    for each in measured():
        speed, rest = each["at speed"], each["from rest"]
        assert speed["lost"] is None and rest["lost"] is None
        assert rest["beside gravity"] < speed["beside gravity"] / 20
        assert rest["error"] < speed["error"] / 9


@pytest.mark.slow
def test_the_row_of_an_arm_is_measured_again():
    (stored,) = [each for each in measured() if each["name"] == "z1"]
    again = row("z1")
    for start in ("at speed", "from rest"):
        for key in ("effort", "beside gravity", "error"):
            assert abs(again[start][key] - stored[start][key]) < 0.02 * stored[start][key]
